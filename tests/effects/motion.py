"""Motion under effects, simulated and by an integrator that knows nothing of MuJoCo."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from twin.controller import Controller
from twin.effects import Effect, with_effects
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform
from twin.rotation import conjugate, multiply, rotate, tilt, to_rotation_vector
from twin.signals import Command, Estimate, Target

Torque = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
"""From time [s], attitude (4,) and rate (3,) to the torque (3,), body axes [N m]."""


@dataclass(frozen=True)
class Kicks(Controller[Platform]):
    """Wheels that push to and fro at half their limit: what hangs on the machine rings."""

    periods: tuple[float, ...] = (3.0, 4.2, 5.3)
    """Of three wheels [s]; forth, back, back, forth, so that none leaves a mean rate or turn."""

    def init(self, platform: Platform, n: int) -> Platform:
        return platform

    def update(
        self, state: Platform, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Platform]:
        quarter = np.floor(4.0 * (time / np.array(self.periods) % 1.0)).astype(int)
        size = 0.5 * np.array([wheel.torque_limit for wheel in state.wheels])
        torque = size * np.array([1.0, -1.0, -1.0, 1.0])[quarter]
        return {"command_wheel_torque": np.tile(torque, (len(estimate.valid), 1))}, state


def flown(
    platform: Platform, effects: tuple[Effect, ...], seconds: float, start: InitialState
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, true attitudes and true rates, tick by tick, without a command."""
    plant = SimulatedPlant(with_effects(platform, effects), initial=start)
    rows = []
    for k in range(round(seconds / platform.tick) + 1):
        plant.read(k * platform.tick)
        truth = plant.truth()
        rows.append([truth["truth_attitude"].value[0, 0], truth["truth_rate"].value[0, 0]])
    time = np.arange(len(rows)) * platform.tick
    attitude, rate = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    assert tilt(attitude).max() < platform.tilt_limit, "it may touch something"
    return time, attitude, rate


def integrated(
    platform: Platform, torque: Torque, seconds: float, start: InitialState
) -> tuple[np.ndarray, np.ndarray]:
    """Attitude and rate at the end, by Euler's equations under gravity and a torque.

    No command and no friction: each wheel keeps the momentum that it has about its axis, so the
    body turns as if it lacked the wheels' moments of inertia and carried that momentum.
    """
    axes = np.stack([wheel.axis for wheel in platform.wheels])
    rotor = axes.T @ np.diag([wheel.inertia for wheel in platform.wheels]) @ axes
    inertia, kept = platform.inertia - rotor, rotor @ start.rate_body
    weight = np.array([0.0, 0.0, -platform.gravity])

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        q, rate = state[:4] / np.linalg.norm(state[:4]), state[4:]
        external = np.cross(platform.center_of_mass_offset, rotate(conjugate(q), weight))
        external = external + torque(time, q, rate)
        change = np.linalg.solve(inertia, external - np.cross(rate, inertia @ rate + kept))
        return np.concatenate([0.5 * multiply(q, np.array([0.0, *rate])), change])

    first = np.concatenate([start.attitude, start.rate_body])
    done = solve_ivp(slope, (0.0, seconds), first, method="DOP853", rtol=1e-11, atol=1e-13)
    end = done.y[:, -1]
    return end[:4] / np.linalg.norm(end[:4]), end[4:]


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Angle between two attitudes [rad]."""
    return float(np.linalg.norm(to_rotation_vector(multiply(conjugate(one), other))))
