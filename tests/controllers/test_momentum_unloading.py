"""Wheels and gyros emptied by masses or magnetorquers while the attitude holds."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from papers.flown import perfect
from tests.controllers.flight import simulate
from twin.controller import load_controller
from twin.errors import ControllerError
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.rotation import rotate, tilt

SPEEDS = np.array([0.5, -0.4, 0.3])
"""Momentum of the wheels at the start [N m s]."""


def wheel_momentum(platform, run):
    return run.true["wheel_speed"] * [wheel.inertia for wheel in platform.wheels]


@pytest.mark.parametrize("name", ["sads", "whorl1"])
def test_masses_empty_wheels_across_the_vertical_while_the_attitude_holds(name):
    """h'' + k h' + k_I h = 0 with h' = m r x g at the start: its solution, and the balance left."""
    # An attitude loop so fast that the body holds nothing of the momentum.
    law = load_controller("momentum_unloading", {"proportional": 50.0, "derivative": 40.0})
    platform = replace(perfect(load_platform(name)), control_rate=20.0)
    start = InitialState(wheel_speed=SPEEDS / [wheel.inertia for wheel in platform.wheels])
    run = simulate(law, platform, 150.0, start=start)
    held = wheel_momentum(platform, run)
    gravity = np.cross(platform.center_of_mass_offset, [0.0, 0.0, -platform.gravity])[:2]
    roots = np.roots([1.0, law.unloading, law.integral]).astype(complex)
    first = np.stack([SPEEDS[:2], gravity - law.unloading * SPEEDS[:2]])
    weights = np.linalg.solve(np.vander(roots, 2, increasing=True).T, first)
    expected = np.real(np.exp(np.outer(run.time, roots)) @ weights)
    assert np.abs(held[:, :2] - expected).max() < 0.05 * np.abs(SPEEDS).max()
    assert np.linalg.norm(held[-1, :2]) < 0.15 * np.linalg.norm(SPEEDS[:2])
    assert held[-1, 2] == pytest.approx(SPEEDS[2], rel=0.02), "masses cannot turn it about z"
    # What the masses put in, k h, tilts the body against the stiffness K_p / 2.
    most = 2.0 * law.unloading * np.linalg.norm(SPEEDS[:2]) / law.proportional
    assert tilt(run.true["attitude"]).max() < most


def test_masses_that_balance_a_table_stay_where_they_were_put():
    law, platform = load_controller("momentum_unloading"), perfect(load_platform("sads"))
    place = np.array([0.004, -0.003, 0.001])
    moment = sum(s.mass * d * s.axis for s, d in zip(platform.stages, place, strict=True))
    below = np.array([0.0, 0.0, platform.center_of_mass_offset[2]])
    platform = replace(platform, center_of_mass_offset=below - moment)
    run = simulate(law, platform, 5.0, start=InitialState(stage_position=place))
    assert np.abs(run.true["stage_position"] - place).max() < 1e-5
    assert tilt(run.true["attitude"]).max() < 1e-5


def test_masses_empty_gyros_and_bring_them_home():
    law, platform = load_controller("momentum_unloading"), perfect(load_platform("tas2"))
    home = np.array([gimbal.home for gimbal in platform.gimbals])
    away = home + np.array([0.02, 0.03, -0.02])
    run = simulate(law, platform, 150.0, start=InitialState(gimbal_angle=away))
    axis = np.array([gimbal.axis for gimbal in platform.gimbals])
    spin = np.array([rotor.axis for rotor in platform.rotors])

    def momentum(angle):
        turned = np.cos(angle)[:, None] * spin + np.sin(angle)[:, None] * np.cross(axis, spin)
        return np.array([rotor.momentum for rotor in platform.rotors]) @ turned

    first, last = (momentum(run.true["gimbal_angle"][tick]) for tick in (0, -1))
    assert np.linalg.norm(last[:2]) < 0.15 * np.linalg.norm(first[:2])
    assert np.abs(run.true["gimbal_angle"][-1] - home).max() < 0.15 * np.abs(away - home).max()


@pytest.fixture
def magnetic(tmp_path: Path):
    """`sads` with three coils in a field that is not upright."""
    folder = tmp_path / "magnetic"
    shutil.copytree(load_platform("sads").folder, folder, ignore=shutil.ignore_patterns("logs"))
    stated, model = folder / "platform.toml", folder / "platform.xml"
    names, places = ("mx", "my", "mz"), ("0.1 0 0", "0 0.1 0", "0 0 0.1")
    sites = "".join(f'<site name="{m}" pos="{at}"/>' for m, at in zip(names, places, strict=True))
    motor = '<general name="{0}" site="{0}" refsite="room" gear="0 0 1 0 0 0"/>'
    motors = "".join(motor.format(name) for name in names)
    text = model.read_text(encoding="utf-8").replace('<site name="imu"', sites + '<site name="imu"')
    text = text.replace("<worldbody>", '<worldbody><site name="room"/>')
    model.write_text(text.replace("</actuator>", motors + "</actuator>"), encoding="utf-8")
    coils = "".join(f'[[magnetorquers]]\nname = "{m}"\ndipole_limit = 30.0\n' for m in names)
    text = stated.read_text(encoding="utf-8")
    text = text.replace("[environment]\n", "[environment]\nmagnetic_field = [3e-4, 0.0, 4e-4]\n")
    stated.write_text(text.replace("[tilt_stop]", coils + "\n[tilt_stop]"), encoding="utf-8")
    return perfect(load_platform(str(folder)))


def test_magnetorquers_empty_wheels_across_the_field_at_the_gain(magnetic):
    gains = {"proportional": 5.0, "derivative": 8.0, "unloading": 0.02}
    law = load_controller("momentum_unloading", gains)
    balanced = replace(magnetic, center_of_mass_offset=np.zeros(3))
    start = InitialState(wheel_speed=SPEEDS / [wheel.inertia for wheel in balanced.wheels])
    run = simulate(law, balanced, 100.0, start=start)
    assert np.abs(run.applied["command_dipole"]).max() < 30.0
    field = balanced.magnetic_field / np.linalg.norm(balanced.magnetic_field)
    held = rotate(run.true["attitude"], wheel_momentum(balanced, run))
    across = np.linalg.norm(np.cross(held, field), axis=1)
    np.testing.assert_allclose(across, across[0] * np.exp(-0.02 * run.time), atol=0.02 * across[0])
    assert held[-1] @ field == pytest.approx(held[0] @ field, rel=0.02)
    most = 2.0 * 0.02 * across[0] / law.proportional
    assert tilt(run.true["attitude"]).max() < most


@pytest.mark.parametrize(
    ("lacking", "sentence"),
    [({"wheels": ()}, "the 0 wheels of sads do not"), ({"stages": ()}, "the 0 stages of sads")],
)
def test_machine_without_what_unloads_or_is_unloaded_is_refused(sads, lacking, sentence):
    with pytest.raises(ControllerError, match=sentence):
        load_controller("momentum_unloading").init(replace(sads, **lacking), 1)
