"""Short flights of the platforms, and their predictors."""

from functools import cache

from twin.clock import SimulatedClock
from twin.flight import prepare
from twin.model import compile_model
from twin.platform import load_platform
from twin.predict.body import Body, body_of
from twin.predict.logs import motion_of
from twin.recording import Recording
from twin.stream.recorder import MemoryRecorder

LAWS = {
    "tas2": "cmg_pd",
    "astros": "mass_pid",
    "whorl1": "quaternion_pd",
    "sads": "quaternion_pd",
    "cubesat": "mass_magnetic_pid",
}


@cache
def flown(name: str, seed: int, duration: float = 20.0, law: str = "") -> Recording:
    """A simulated flight of a platform as it is, on a multisine, by its own law or another."""
    flight = prepare(
        name,
        controller=law or LAWS[name.partition(":")[0]],
        estimator="filter",
        plant="sim",
        reference="multisine:3",
        duration=duration,
        seed=seed,
    )
    recorder = MemoryRecorder(flight.platform, {"platform": name, "source": f"{name} {seed}"})
    flight.fly(SimulatedClock(), [recorder])
    return recorder.recording().without_truth()


def predictor(log: Recording, name: str) -> Body:
    """Of a log, on the platform of that name."""
    platform = load_platform(name)
    return body_of(compile_model(platform), log, motion_of(log, platform))
