"""A rigid body with wheels and sliding masses, so that a law meets physics that is not ours."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from twin.controller import AnyController
from twin.platform import Platform, load_platform
from twin.reference import Hold, Reference
from twin.rotation import from_rotation_vector, matrix, multiply
from twin.signals import Estimate


@dataclass
class Flight:
    """One row a tick."""

    time: np.ndarray
    attitude: np.ndarray
    momentum: np.ndarray
    """Of each wheel, relative to the body [N m s]."""
    stage: np.ndarray


def _slope(y: np.ndarray, platform: Platform, rotor_torque: np.ndarray, moment: np.ndarray):
    """Euler's equation about the CR of y = (attitude, rate, momentum of each wheel)."""
    q, w, h = y[:4], y[4:7], y[7:]
    axes = np.array([wheel.axis for wheel in platform.wheels])
    gravity = -platform.gravity * matrix(q)[2]
    torque = _skew(moment) @ gravity - rotor_torque @ axes
    torque -= _skew(w) @ (platform.inertia @ w + h @ axes)
    turn = 0.5 * multiply(q, np.array([0.0, *w]))
    return np.concatenate([turn, np.linalg.solve(platform.inertia, torque), rotor_torque])


def _skew(v: np.ndarray) -> np.ndarray:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _fly(
    law: AnyController,
    platform: Platform,
    *,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rate: tuple[float, float, float] = (0.0, 0.0, 0.0),
    duration: float = 60.0,
    reference: Reference | None = None,
) -> Flight:
    """One run from a rotation vector [rad] and a rate [rad/s]; RK4, one step a tick."""
    reference = reference or Hold()
    wheels, stages = len(platform.wheels), len(platform.stages)
    y = np.concatenate([from_rotation_vector(np.array(start)), rate, np.zeros(wheels)])
    rotor_torque, stage = np.zeros(wheels), np.zeros(stages)
    slides = np.array([part.mass * part.axis for part in platform.stages]).reshape(-1, 3)
    times = np.arange(round(duration / platform.tick)) * platform.tick
    states, positions = np.empty((len(times), len(y))), np.empty((len(times), stages))
    memory = law.init(platform, 1)
    for row, time in enumerate(times):
        estimate = Estimate(
            time=time,
            attitude=y[None, :4].copy(),
            rate_body=y[None, 4:7].copy(),
            wheel_speed=np.zeros((1, wheels)),
            stage_position=stage[None],
            joint_angle=np.zeros((1, 0)),
            joint_rate=np.zeros((1, 0)),
            gyro_bias=np.zeros((1, 3)),
            valid=np.ones(1, dtype=bool),
        )
        command, memory = law.update(memory, estimate, reference.at(time), time)
        rotor_torque = command.get("command_wheel_torque", rotor_torque[None])[0]
        stage = command.get("command_stage_position", stage[None])[0]
        states[row], positions[row] = y, stage
        moment, h = platform.center_of_mass_offset + stage @ slides, platform.tick
        k1 = _slope(y, platform, rotor_torque, moment)
        k2 = _slope(y + 0.5 * h * k1, platform, rotor_torque, moment)
        k3 = _slope(y + 0.5 * h * k2, platform, rotor_torque, moment)
        k4 = _slope(y + h * k3, platform, rotor_torque, moment)
        y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        y[:4] /= np.linalg.norm(y[:4])
    return Flight(times, states[:, :4], states[:, 7:], positions)


@pytest.fixture
def fly() -> Callable[..., Flight]:
    """Fly a law: `fly(law, platform, start=..., rate=..., duration=..., reference=...)`."""
    return _fly


@pytest.fixture(scope="session")
def sads() -> Platform:
    """The shipped dumbbell."""
    return load_platform("sads")
