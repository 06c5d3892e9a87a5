"""Flights of the paper: the dumbbell hangs, and wheels under a quaternion PD law swing it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.effects import with_effects
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.simulated import InitialState, SimulatedPlant
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.reference import Multisine, Reference
from twin.reproduce.paper_004.uncertain_torque import UncertainTorque
from twin.signals import Target
from twin.stream.recorder import MemoryRecorder

Array = NDArray[np.float64]

GAINS = {"proportional": 0.5, "derivative": 0.88}
"""Paper, "Mass properties identification"."""


@dataclass(frozen=True)
class About(Reference):
    """A motion about another attitude than level."""

    attitude: Array
    """(4,)."""
    motion: Reference

    def at(self, time: float | Array) -> Target:
        """The motion's, seen from that attitude: rates in body axes stay as they are."""
        target = self.motion.at(time)
        return replace(target, attitude=rotation.multiply(self.attitude, target.attitude))


def machine(variant: str) -> Platform:
    """A variant of `sads`, without the tilt stop, of which the paper's simulation knows nothing."""
    return replace(load_platform(variant), tilt_limit=np.inf)


def hanging(platform: Platform) -> Array:
    """(4,) the attitude at which its CM hangs below the CR, by the shortest turn from level."""
    down = platform.center_of_mass_offset / np.linalg.norm(platform.center_of_mass_offset)
    across = np.cross(down, [0.0, 0.0, -1.0])
    angle = np.arctan2(np.linalg.norm(across), -down[2])
    return rotation.from_rotation_vector(across / np.linalg.norm(across) * angle)


def flown(
    platform: Platform,
    motion: Multisine,
    *,
    duration: float,
    runs: int,
    seed: int,
    torque: float = 0.0,
    start: InitialState | None = None,
) -> list[Recording]:
    """Fly a batch from where it hangs, about which it follows a motion.

    Args:
        platform: the machine.
        motion: to follow.
        duration: [s].
        runs: how many.
        seed: of noise and disturbance.
        torque: bound of a disturbance [N m].
        start: of the machine; hanging at rest unless given.
    """
    middle = hanging(platform)
    disturbed = UncertainTorque(torque, seed=seed)
    plant = SimulatedPlant(
        with_effects(platform, [disturbed]) if torque else platform,
        runs=range(runs),
        seed=seed,
        initial=start or InitialState(attitude=middle),
    )
    recorder = MemoryRecorder(plant.platform, {"platform": platform.name, "source": "paper 004"})
    fly(
        plant,
        load_estimator("filter"),
        load_controller("quaternion_pd", GAINS),
        About(middle, motion),
        SimulatedClock(),
        duration=duration,
        observers=[recorder],
    )
    return [recorder.recording(run) for run in range(runs)]
