"""The next experiment, in a sentence and for JSON."""

from collections.abc import Mapping
from typing import Any

from twin.diagnosis.experiment import Experiment

_FRICTION = (
    "let it turn fast and run down to rest, for the laws differ in how the torque falls with rate"
)
_CLOCK = "mark one event in both streams, or log for longer: a drift grows and a lag does not"

OUT_OF_REACH = {
    "residual_dipole": "turn, reverse or switch off the magnetic field, which moves the dipole's "
    "torque and no other",
    "bearing_swirl_torque": "change the pressure of the air, which changes the bearing's own "
    "torque and no other",
    "bearing_viscous_friction": _FRICTION,
    "bearing_coulomb_friction": _FRICTION,
    "aerodynamic_drag": _FRICTION,
    "harness_stiffness": "take the cable off",
    "room_draft": "shield the machine from the room's air",
    "clock_lag": _CLOCK,
    "clock_drift": _CLOCK,
    "sensor_lag": "move it fast and slowly by turns: a filter delays the fast motion otherwise",
    "gyro_scale_factor": "turn it by an angle that is known otherwise",
    "attitude_misalignment": "turn it about one axis at a time before a reference outside of it",
    "attitude_reference_tilt": "set a level before what measures the attitude, or turn the machine "
    "by half a turn about the vertical: what is fixed in the room stays",
    "wheel_misalignment": "spin up one wheel at a time, the others at rest",
    "wheel_inertia_error": "mount a body of known inertia",
}
"""What no run of the library does, by the cause that it sets apart."""


def experiment_sentence(found: Experiment) -> str:
    """What to do next, what it should bring, and beside what."""
    nearest, split = _least(found.splits)
    _, again = _least(found.repeated)
    bar = f"where {found.needed:g} would do"
    if found.enough:
        return (
            f"To tell them apart, make on the machine the run that this rehearses: "
            f"{found.command}. With its log beside these, {nearest} as the nearest should be "
            f"{split:.1f} behind in evidence, {bar}; the same logs made once more would leave "
            f"{again:.1f}."
        )
    if again >= found.needed:
        return (
            f"To tell them apart, make the same logs once more: that should leave none of them "
            f"less than {again:.1f} behind, {bar}; no other run that was tried does as well "
            f"({split:.1f})."
        )
    close = [label for label, size in found.splits.items() if size < found.needed]
    ways = dict.fromkeys(_way(found, label) for label in close)
    said = "; ".join(way for way in ways if way)
    return (
        f"No run that was tried tells them apart: the best, {found.command}, would leave "
        f"{nearest} {split:.1f} behind, {bar}, and the same logs made once more {again:.1f}."
        + (f" What could: {said}." if said else "")
    )


def experiment_document(found: Experiment) -> dict[str, Any]:
    """For `--json`; the command is null where no run splits the ties."""
    return {
        "command": found.command if found.enough else None,
        "splits": dict(found.splits),
        "repeated": dict(found.repeated),
        "sentence": experiment_sentence(found),
    }


def _least(sizes: Mapping[str, float]) -> tuple[str, float]:
    return min(sizes.items(), key=lambda one: one[1])


def _way(found: Experiment, label: str) -> str:
    """To set a tied cause, or else the one named in its place, apart."""
    names = [label.partition(":")[0], *(one.partition(":")[0] for one in found.named)]
    return next((OUT_OF_REACH[name] for name in names if name in OUT_OF_REACH), "")
