"""The simulated machine against physics written down a second time, and against what is kept."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import DOP853

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import AttitudeFilter
from twin.loop import fly
from twin.model import compile_model, mass_properties
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.reference import Multisine
from twin.rotation import conjugate, multiply, to_rotation_vector
from twin.stream.recorder import MemoryRecorder

SECONDS = 300.0


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return np.array([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1])


def upwards(q: np.ndarray) -> np.ndarray:
    """The room's vertical in body axes."""
    w, x, y, z = q.tolist()
    return np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])


def gyrostat(platform: Platform) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Euler's equations of a body with wheels under gravity, of a state q, w, Omega and torques."""
    axes = np.stack([wheel.axis for wheel in platform.wheels])
    rotor = np.array([wheel.inertia for wheel in platform.wheels])
    body = np.linalg.inv(platform.inertia - axes.T @ np.diag(rotor) @ axes)
    inertia, offset = platform.inertia, platform.center_of_mass_offset

    def slope(state: np.ndarray, torque: np.ndarray) -> np.ndarray:
        q, rate, spin = state[:4] / np.sqrt(state[:4] @ state[:4]), state[4:7], state[7:]
        momentum = inertia @ rate + (rotor * spin) @ axes
        external = cross(offset, -platform.gravity * upwards(q))
        acceleration = body @ (external - cross(rate, momentum) - torque @ axes)
        (w, x, y, z), (a, b, c) = q.tolist(), rate.tolist()
        turn = [-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c,
                w * c + x * b - y * a]  # fmt: skip
        return np.concatenate(
            [0.5 * np.array(turn), acceleration, torque / rotor - axes @ acceleration]
        )

    return slope


def integrate(platform: Platform, state: np.ndarray, torques: np.ndarray) -> np.ndarray:
    """The state after holding each row of `torques` for one control period."""
    slope = gyrostat(platform)
    for torque in torques:
        solver = DOP853(
            lambda _, y, u=torque: slope(y, u),
            0.0,
            state,
            platform.tick,
            first_step=platform.tick,
            rtol=1e-12,
            atol=1e-14,
        )
        while solver.status == "running":
            solver.step()
        state = solver.y
    return state


def test_closed_loop_attitude_agrees_with_an_independent_integration_after_300_s(agrees):
    platform = load_platform("sads")
    memory = MemoryRecorder(platform)
    fly(
        SimulatedPlant(platform),
        AttitudeFilter(),
        load_controller("quaternion_pd"),
        Multisine(),
        SimulatedClock(),
        duration=SECONDS,
        observers=[memory],
    )
    recording = memory.recording()
    applied = recording["command_wheel_torque"]
    assert applied.time[-1] == pytest.approx(SECONDS)
    start = np.concatenate([[1.0], np.zeros(9)])
    end = integrate(platform, start, applied.value[:-1])

    attitude = recording["truth_attitude"].value[-1]
    error = to_rotation_vector(multiply(conjugate(end[:4] / np.linalg.norm(end[:4])), attitude))
    degrees = float(np.degrees(np.linalg.norm(error)))
    agrees("sads: attitude after 300 s of closed loop, against DOP853", degrees, 5e-8, "deg")
    np.testing.assert_allclose(recording["truth_rate"].value[-1], end[4:7], atol=1e-7)
    np.testing.assert_allclose(recording["truth_wheel_speed"].value[-1], end[7:], atol=1e-5)


def test_compiled_machine_has_the_stated_mass_properties_in_every_variant():
    for name in ("sads", "sads:table1", "sads:table3"):
        platform = load_platform(name)
        machine = compile_model(platform)
        found = mass_properties(machine.model, machine.base_body)
        assert found.mass == pytest.approx(platform.mass, rel=1e-12)
        np.testing.assert_allclose(found.inertia, platform.inertia, atol=1e-12 * 12)
        np.testing.assert_allclose(
            found.center_of_mass_offset, platform.center_of_mass_offset, atol=1e-14
        )
