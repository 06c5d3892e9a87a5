"""What wanders in logs beside their causes, in a lab's words."""

from twin.predict.whitening.noise_model import NoiseModel
from twin.units import printed


def wander_sentences(noise: NoiseModel) -> list[str]:
    """One for each thing that wanders."""
    said: list[str] = []
    if noise.torque.rms > 0.0:
        said.append(
            f"Besides, a torque of {printed(noise.torque.rms, 'N m')} rms about each axis wanders "
            f"over {printed(noise.torque.time_constant, 's')}: draughts, cables, the air film."
        )
    for stream, error in noise.errors.items():
        if error.rms > 0.0:
            said.append(
                f"Besides, {stream} is wrong by {printed(error.rms, 'rad')} rms, which wanders "
                f"over {printed(error.time_constant, 's')}: its filter, or what it is measured by."
            )
    for stream, walk in noise.walks.items():
        if walk > 0.0:
            said.append(
                f"Besides, the bias of {stream} walks by {printed(walk * 60.0**0.5, 'rad/s')} in "
                "a minute."
            )
    return said
