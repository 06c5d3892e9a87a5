"""The torque of gimballed rotors against A(delta) d(delta)/dt + w x h, term by term."""

import mujoco
import numpy as np
import pytest

from twin.model import Machine, compile_model
from twin.platform import load_platform
from twin.rotation import matrix, normalized


def odd_in_speed(
    machine: Machine,
    angle: np.ndarray,
    gimbal_rate: np.ndarray,
    rate: np.ndarray,
    speed: np.ndarray,
) -> np.ndarray:
    """(3,) the part of the torque on the body that turns round with the rotors [N m, body]."""
    draw = np.random.default_rng(3)
    attitude = normalized(draw.normal(size=4))
    torques = []
    for sign in (1.0, -1.0):
        data = mujoco.MjData(machine.model)
        data.qpos[machine.base_qpos] = attitude
        data.qpos[machine.gimbal_qpos] = angle
        data.qvel[machine.gimbal_dof] = gimbal_rate
        data.qvel[machine.base_dof] = rate
        spinning = [*machine.rotor_dof, *machine.wheel_dof]
        data.qvel[spinning] = sign * speed
        mujoco.mj_forward(machine.model, data)
        torques.append(data.qfrc_bias[machine.base_dof].copy())
    return 0.5 * (torques[0] - torques[1])


@pytest.mark.parametrize("name", ["tas2", "tas2:skew70", "astros"])
def test_a_gimballed_rotor_turns_the_body_with_a_times_the_gimbal_rate(name: str, agrees):
    platform = load_platform(name)
    machine = compile_model(platform)
    draw = np.random.default_rng(4)
    carried = (*platform.rotors, *platform.wheels)
    spin = {part.gimbal: part for part in carried}
    speed = draw.uniform(50.0, 200.0, len(carried))
    angle, turning = draw.uniform(-3.0, 3.0, (2, len(platform.gimbals)))
    rate = draw.normal(size=3)
    expected = np.zeros(3)
    for gimbal, delta, speed_of_gimbal in zip(platform.gimbals, angle, turning, strict=True):
        part = spin[gimbal.name]
        a, b = part.axis, np.cross(gimbal.axis, part.axis)
        size = part.inertia * speed[carried.index(part)]
        expected += size * (b * np.cos(delta) - a * np.sin(delta)) * speed_of_gimbal
        expected += np.cross(rate, size * (a * np.cos(delta) + b * np.sin(delta)))
    found = odd_in_speed(machine, angle, turning, rate, speed)
    error = np.abs(found - expected).max() / np.abs(expected).max()
    agrees(f"{name}: torque of its gyros, A d(delta)/dt + w x h", error, 5e-12)


@pytest.mark.parametrize(("name", "beta"), [("tas2", 90.0), ("tas2:skew70", 70.0)])
def test_the_array_of_tas2_is_that_of_its_paper(name: str, beta: float):
    """Eq. 41, in the paper's axes, for a momentum of one unit."""
    platform = load_platform(name)
    spin = {rotor.gimbal: rotor.axis for rotor in platform.rotors}
    one, two, three = angle = np.array([0.4, -1.1, 2.0])
    c, s = np.cos(np.radians(beta)), np.sin(np.radians(beta))
    printed = np.array(
        [
            [-c * np.cos(one), np.sin(two), c * np.cos(three)],
            [-np.sin(one), -c * np.cos(two), np.sin(three)],
            [s * np.cos(one), s * np.cos(two), s * np.cos(three)],
        ]
    )
    columns = [
        np.cross(g.axis, spin[g.name]) * np.cos(delta) - spin[g.name] * np.sin(delta)
        for g, delta in zip(platform.gimbals, angle, strict=True)
    ]
    np.testing.assert_allclose(
        matrix(platform.paper_from_body) @ np.array(columns).T, printed, atol=1e-12
    )


def test_home_of_tas2_has_no_momentum_and_is_not_singular():
    platform = load_platform("tas2")
    spin = {rotor.gimbal: rotor.axis for rotor in platform.rotors}
    momentum, columns = np.zeros(3), []
    for g in platform.gimbals:
        a, b = spin[g.name], np.cross(g.axis, spin[g.name])
        momentum += a * np.cos(g.home) + b * np.sin(g.home)
        columns.append(b * np.cos(g.home) - a * np.sin(g.home))
    np.testing.assert_allclose(momentum, 0.0, atol=1e-12)
    assert abs(np.linalg.det(columns)) == pytest.approx(np.sqrt(0.75), abs=1e-9)
