"""Logs of machines flown with a base that platform.toml does not know."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.contrast import ExcitingLaw
from twin.controller import AnyController, load_controller
from twin.effects import parse_effects, with_effects
from twin.estimators import load_estimator
from twin.estimators.estimator import Passthrough
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.predict.base import ENTRIES
from twin.recording import Recording
from twin.reference import Hold, parse_reference
from twin.rotation import from_euler_zyx
from twin.stream.recorder import MemoryRecorder


@dataclass(frozen=True)
class Campaign:
    """Runs of one hidden base."""

    stated: Platform
    """As the identification is told."""
    truth: np.ndarray
    """(9,) J and m r, as flown."""
    logs: list[Recording]


def hidden_base(stated: Platform, rng: np.random.Generator) -> Platform:
    """Principal moments 4 % off, products of inertia and an offset that nobody stated."""
    inertia = np.diag(np.diag(stated.inertia) * (1.0 + rng.choice([-0.04, 0.04], 3)))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        inertia[i, j] = inertia[j, i] = rng.uniform(-0.15, 0.15)
    offset = stated.center_of_mass_offset + rng.normal(0.0, 5e-4, 3)
    return replace(stated, inertia=inertia, center_of_mass_offset=offset)


def fly_campaign(
    runs: int,
    seed: int,
    duration: float,
    *,
    gyro: float = 1e-3,
    attitude: float = 1e-3,
    wheel_speed: float = 0.1,
    vertical: float | None = None,
) -> Campaign:
    """Fly `quaternion_pd` on a multisine, all runs as one batch; noise as 1 sigma a sample."""
    stated = load_platform("sads")
    if vertical is not None:
        offset = stated.center_of_mass_offset.copy()
        offset[2] = vertical * stated.mass
        stated = replace(stated, center_of_mass_offset=offset)
    true = hidden_base(stated, np.random.default_rng(seed))
    noise = {"gyro": gyro, "attitude": attitude, "wheel_speed": wheel_speed}
    sensors = {
        name: replace(sensor, noise=np.full(3, noise[name])) if name in noise else sensor
        for name, sensor in true.sensors.items()
    }
    plant = SimulatedPlant(replace(true, sensors=sensors), runs=range(runs), seed=seed)
    recorder = MemoryRecorder(plant.platform, {"platform": "sads", "source": f"seed {seed}"})
    fly(
        plant,
        load_estimator("filter"),
        load_controller("quaternion_pd"),
        parse_reference("multisine:5"),
        SimulatedClock(),
        duration=duration,
        observers=[recorder],
    )
    assert not plant.stopped
    return as_flown(stated, true, recorder, runs)


def as_flown(stated: Platform, true: Platform, recorder: MemoryRecorder, runs: int) -> Campaign:
    """What was flown."""
    entries = [true.inertia[i, j] for i, j in ENTRIES]
    return Campaign(
        stated,
        np.concatenate([entries, true.center_of_mass_offset]),
        [recorder.recording(run) for run in range(runs)],
    )


def fly_machine(
    stated: Platform, runs: int, seed: int, duration: float, effects: str = ""
) -> Campaign:
    """Fly a machine open loop, all that it has at work, all runs as one batch; effects as
    `twin run --effects` takes them, which the machine as stated lacks."""
    true = nearby_base(stated, np.random.default_rng(seed))
    true = with_effects(true, parse_effects(effects)) if effects else true
    speeds = [0.05 * wheel.speed_limit + wheel.home for wheel in stated.wheels]
    start = InitialState(rate_body=np.array([0.004, -0.002, 0.05]), wheel_speed=np.array(speeds))
    return open_loop(stated, true, ExcitingLaw(), start, runs, seed, duration)


def swing(stated: Platform, seed: int, duration: float) -> Campaign:
    """Let a machine swing from a few degrees aside, its CM 70 um below the CR, nothing else at
    work; J is up to 10 % off."""
    rng = np.random.default_rng(seed)
    inertia = stated.inertia.copy()
    inertia[np.diag_indices(3)] *= 1.0 + rng.uniform(-0.1, 0.1, 3)
    below = np.array([0.0, 0.0, -7e-5]) * stated.mass
    offset = below + rng.normal(0.0, 1e-7, 3) * stated.mass
    true = replace(stated, inertia=inertia, center_of_mass_offset=offset)
    roll, pitch = np.radians(rng.uniform(2.0, 3.0, 2) * rng.choice([-1.0, 1.0], 2))
    start = InitialState(attitude=from_euler_zyx(0.0, pitch, roll))
    return open_loop(stated, true, load_controller("free_float"), start, 1, seed, duration)


def open_loop(
    stated: Platform,
    true: Platform,
    law: AnyController,
    start: InitialState,
    runs: int,
    seed: int,
    duration: float,
) -> Campaign:
    """Fly a law that looks at nothing."""
    plant = SimulatedPlant(true, runs=range(runs), seed=seed, initial=start)
    recorder = MemoryRecorder(plant.platform, {"platform": stated.name, "source": f"seed {seed}"})
    fly(
        plant,
        Passthrough(),
        law,
        Hold(),
        SimulatedClock(),
        duration=duration,
        observers=[recorder],
    )
    assert not plant.stopped
    return as_flown(stated, true, recorder, runs)


def nearby_base(stated: Platform, rng: np.random.Generator) -> Platform:
    """Principal moments 3 % off, products by up to 1 % of a mean one, m r by some um and 10 %."""
    inertia = stated.inertia.copy()
    inertia[np.diag_indices(3)] *= 1.0 + rng.choice([-0.03, 0.03], 3)
    size = np.trace(stated.inertia) / 3.0
    for i, j in ((0, 1), (0, 2), (1, 2)):
        inertia[i, j] += rng.uniform(-0.01, 0.01) * size
        inertia[j, i] = inertia[i, j]
    offset = stated.center_of_mass_offset * (1.0 + rng.uniform(-0.1, 0.1, 3))
    offset = offset + rng.normal(0.0, 2e-6, 3) * stated.mass
    return replace(stated, inertia=inertia, center_of_mass_offset=offset)


@pytest.fixture(scope="session")
def flown() -> Callable[..., Campaign]:
    """Logs on demand."""
    return fly_campaign


@pytest.fixture(scope="session")
def excited() -> Callable[..., Campaign]:
    """Logs of any machine on demand."""
    return fly_machine


@pytest.fixture(scope="session")
def swung() -> Callable[..., Campaign]:
    """Swings on demand."""
    return swing


@pytest.fixture(scope="session")
def campaign() -> Campaign:
    """Two logs of 50 s at the middle grade of noise."""
    return fly_campaign(2, seed=7, duration=50.0)
