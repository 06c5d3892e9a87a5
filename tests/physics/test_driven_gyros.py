"""Gyros whose gimbals are driven at a rate, against their momentum integrated apart from MuJoCo."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.effects.motion import apart
from tests.physics.motion import run
from twin.plant.initial import InitialState
from twin.platform import Platform, load_platform
from twin.rotation import conjugate, matrix, multiply, rotate

SECONDS, PIECE = 100.0, 5.0
"""Of the run, and that each command is held [s]."""
MOMENTS = {"tas2": (0.1, 0.055, 0.06), "astros": (0.01, 0.0055, 0.01)}
"""Of rotor or wheel about its axis and across it, and of the gimbal, the same about all axes, as
the MJCF has them [kg m^2]."""

Array = np.ndarray


def commands(platform: Platform, time: float) -> dict[str, Array]:
    """Rates of the gimbals and torques of the wheels, new in every piece."""
    draw = np.random.default_rng(int(time / PIECE + 1e-9))
    told = {"command_gimbal_rate": draw.uniform(-0.1, 0.1, (1, len(platform.gimbals)))}
    if platform.wheels:
        told["command_wheel_torque"] = draw.uniform(-0.02, 0.02, (1, len(platform.wheels)))
    return told


def stretches(rate: Array, step: float) -> list[tuple[int, int]]:
    """First and last step of each stretch of a piece in which all gimbals accelerate evenly."""
    acceleration = np.diff(rate, axis=0)
    every = round(PIECE / step)
    ends = [
        k
        for k in range(1, len(acceleration))
        if k % every == 0 or not np.allclose(acceleration[k], acceleration[k - 1], atol=1e-12)
    ]
    return list(zip([0, *ends], [*ends, len(acceleration)], strict=True))


def integrate(platform: Platform, start: Array, angle: Array, rate: Array, speed: Array) -> Array:
    """(4,) attitude at the end.

    In body axes (J(delta) - sum I_s a a^T) w = R^T L - sum I_g d(delta)/dt g - sum p a, where only
    weight changes the momentum L of all, and only its motor the momentum p of a wheel about its
    axis a. A rotor held at its speed adds I_s W a, and its I_s stays in J.
    """
    along, across, gimbal = MOMENTS[platform.name]
    turns = np.array([one.axis for one in platform.gimbals])
    spin = {part.gimbal: part.axis for part in (*platform.rotors, *platform.wheels)}
    first = np.array([spin[one.name] for one in platform.gimbals])
    other = np.cross(turns, first)
    free = bool(platform.wheels)
    weight = np.array([0.0, 0.0, -platform.gravity])
    home = platform.inertia - (along - across) * first.T @ first

    def tensor(axes: Array) -> Array:
        """Without what wheels that spin freely have about their axes."""
        return home + ((0.0 if free else along) - across) * axes.T @ axes

    def axes_at(delta: Array) -> Array:
        return first * np.cos(delta)[:, None] + other * np.sin(delta)[:, None]

    axes = axes_at(angle[0])
    turning = (gimbal + across) * turns
    own = along * (speed + axes @ start[4:] if free else speed)
    momentum = tensor(axes) @ start[4:] + rate[0] @ turning + own @ axes
    state = np.concatenate([start[:4], rotate(start[:4], momentum), own])
    for begin, end in stretches(rate, platform.step):
        span = (end - begin) * platform.step
        push = (rate[end] - rate[begin]) / span
        told = commands(platform, begin * platform.step)
        motor = told["command_wheel_torque"][0] if free else np.zeros(len(turns))

        def slope(t: float, y: Array, k: int = begin, push: Array = push, motor: Array = motor):
            q = y[:4] / np.linalg.norm(y[:4])
            axes = axes_at(angle[k] + rate[k] * t + 0.5 * push * t * t)
            left = rotate(conjugate(q), y[4:7]) - (rate[k] + push * t) @ turning - y[7:] @ axes
            w = np.linalg.solve(tensor(axes), left)
            torque = np.cross(matrix(q) @ platform.center_of_mass_offset, weight)
            return np.concatenate([0.5 * multiply(q, np.array([0.0, *w])), torque, motor])

        done = solve_ivp(slope, (0.0, span), state, method="DOP853", rtol=1e-11, atol=1e-13)
        state = done.y[:, -1]
    return state[:4] / np.linalg.norm(state[:4])


@pytest.mark.parametrize(("name", "tolerance"), [("tas2", 5e-7), ("astros", 8e-8)])
def test_a_machine_whose_gimbals_are_driven_turns_as_its_momentum_says(name, tolerance, agrees):
    platform = replace(
        load_platform(name), tilt_limit=np.inf, sensors={}, effects=(), control_rate=100.0
    )
    assert platform.tick == platform.step
    rate = np.array([0.01, -0.02, 0.03])
    time, true = run(
        platform, InitialState(rate_body=rate), SECONDS, lambda now: commands(platform, now)
    )
    parts = platform.rotors or platform.wheels
    speed = np.array([getattr(part, "speed", getattr(part, "home", 0.0)) for part in parts])
    start = np.concatenate([true["attitude"][0], rate])
    expected = integrate(platform, start, true["gimbal_angle"], true["gimbal_rate"], speed)
    error = np.degrees(apart(expected, true["attitude"][-1]))
    swept = np.degrees(np.ptp(true["gimbal_angle"], axis=0)).round(0)
    print(f"gimbals sweep {swept} deg, the body turns {np.degrees(apart(start[:4], expected)):.0f}")
    agrees(f"{name}, gimbals driven: attitude after 100 s, against DOP853", error, tolerance, "deg")
    assert time[-1] == pytest.approx(SECONDS)
