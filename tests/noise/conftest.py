"""Streams whose noise is known, because it was put there."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.recording import Recording, Series
from twin.reference import Multisine
from twin.stream.recorder import MemoryRecorder


@pytest.fixture(scope="session")
def sads() -> Platform:
    """The shipped dumbbell."""
    return load_platform("sads")


@pytest.fixture(scope="session")
def flown(sads) -> Callable[..., Recording]:
    """A log of `sads` tracking a multisine for 60 s: flown(noise by stream, rate by stream)."""

    def fly_once(noise: dict[str, float], rate: dict[str, float], seed: int = 0) -> Recording:
        sensors = {
            name: dataclasses.replace(
                sensor,
                noise=np.full(len(sensor.noise), noise.get(name, 0.0)),
                rate=rate.get(name, sensor.rate),
            )
            for name, sensor in sads.sensors.items()
        }
        platform = dataclasses.replace(sads, sensors=sensors)
        memory = MemoryRecorder(platform)
        fly(
            SimulatedPlant(platform, seed=seed),
            load_estimator("filter"),
            load_controller("quaternion_pd"),
            Multisine(),
            SimulatedClock(),
            duration=60.0,
            observers=[memory],
        )
        return memory.recording().without_truth()

    return fly_once


@pytest.fixture
def draw(drawn_seed: int) -> np.random.Generator:
    """Of the test's seed."""
    return np.random.default_rng(drawn_seed)


@pytest.fixture
def swing() -> Callable[..., Series]:
    """A gyro that swings at 0.3 Hz by 0.05 rad/s, with white noise: swing(draw, noise)."""

    def series(draw: np.random.Generator, noise: float, count: int = 6000) -> Series:
        time = np.arange(count) * 0.01
        motion = 0.05 * np.sin(2.0 * np.pi * np.array([0.2, 0.3, 0.37]) * time[:, None])
        value = motion + noise * draw.standard_normal((count, 3))
        return Series(time, value, ("x", "y", "z"), "rad/s")

    return series
