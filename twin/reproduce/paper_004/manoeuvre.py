"""Flights of the paper: the dumbbell hangs, and wheels under a quaternion PD law swing it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.clock import SimulatedClock
from twin.controller import Controller, load_controller
from twin.effects import with_effects
from twin.estimators import load_estimator
from twin.estimators.estimator import Passthrough
from twin.loop import fly
from twin.plant.initial import InitialState, hanging
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.recording import Recording, Series
from twin.reference import Hold, Multisine
from twin.reproduce.flown import About
from twin.reproduce.inertia import tensor
from twin.reproduce.paper_004.uncertain_torque import UncertainTorque
from twin.signals import Command, Estimate, Target
from twin.stream.recorder import MemoryRecorder

Array = NDArray[np.float64]

GAINS = {"proportional": 0.5, "derivative": 0.88}
"""Paper, "Mass properties identification"."""


@dataclass(frozen=True)
class RecordedTorques(Controller[None]):
    """Wheel torques as they were recorded, whatever the machine does."""

    torque: Series

    def init(self, platform: Platform, n: int) -> None:
        """Nothing is remembered."""

    def update(
        self, state: None, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, None]:
        """What was held at this time."""
        # a tick's stamp is a multiple of the period to the last bit or two
        return {"command_wheel_torque": self.torque.held_at(np.array([time + 1e-6]))}, None


def machine(variant: str) -> Platform:
    """A variant of `sads`, without the tilt stop, of which the paper's simulation knows nothing."""
    return replace(load_platform(variant), tilt_limit=np.inf)


def as_guessed(platform: Platform) -> Platform:
    """What an identification is told: the paper's initial values, (3, 12, 12, 0, 0, 0) and no r."""
    inertia = load_platform("sads").inertia
    return replace(platform, inertia=inertia, center_of_mass_offset=np.zeros(3))


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
    """Fly a batch from where it hangs, about which it follows a motion; from a start, about that.

    Args:
        platform: the machine.
        motion: to follow.
        duration: [s].
        runs: how many.
        seed: of noise and disturbance.
        torque: bound of a disturbance [N m].
        start: of the machine; hanging at rest unless given.
    """
    start = start or InitialState(attitude=hanging(platform.center_of_mass_offset))
    disturbed = UncertainTorque(torque, seed=seed)
    plant = SimulatedPlant(
        with_effects(platform, [disturbed]) if torque else platform,
        runs=range(runs),
        seed=seed,
        initial=start,
    )
    recorder = MemoryRecorder(plant.platform, {"platform": platform.name, "source": "paper 004"})
    fly(
        plant,
        load_estimator("filter"),
        load_controller("quaternion_pd", GAINS),
        About(start.attitude, motion),
        SimulatedClock(),
        duration=duration,
        observers=[recorder],
    )
    return [recorder.recording(run) for run in range(runs)]


def resimulated(platform: Platform, theta: Array, log: Recording) -> Series:
    """Rates of a machine with such J and m r (9,) under a log's wheel torques, from rest where it
    hangs (Fig. 9)."""
    result = replace(platform, inertia=tensor(theta[:6]), center_of_mass_offset=theta[6:9])
    start = InitialState(attitude=hanging(result.center_of_mass_offset))
    plant = SimulatedPlant(result, initial=start)
    recorder = MemoryRecorder(plant.platform, {"platform": result.name, "source": "paper 004"})
    fly(
        plant,
        Passthrough(),
        RecordedTorques(log["command_wheel_torque"]),
        Hold(),
        SimulatedClock(),
        duration=float(log["command_wheel_torque"].time[-1]),
        observers=[recorder],
    )
    return recorder.recording()["truth_rate"]
