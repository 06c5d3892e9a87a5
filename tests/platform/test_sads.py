"""The shipped dumbbell: what its README promises about numbers, looks and behaviour."""

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.processes import PATIENCE
from twin import rotation
from twin.model import compile_model, mass_properties
from twin.platform import load_platform, variants_of

SADS = Path(__file__).parents[2] / "models" / "sads"


@pytest.fixture(scope="module")
def shipped() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(SADS / "platform.xml"))


def test_the_fixed_numbers_are_those_of_the_machine():
    platform = load_platform("sads")
    assert platform.control_rate == 20.0
    assert platform.gravity == 9.81
    assert platform.mass == 95.0
    np.testing.assert_array_equal(platform.inertia, np.diag([3.0, 12.0, 12.0]))
    np.testing.assert_allclose(platform.center_of_mass_offset / 95.0, [1e-5, -1e-5, -3e-5])
    assert [wheel.name for wheel in platform.wheels] == ["w1", "w2", "w3"]
    np.testing.assert_array_equal([wheel.axis for wheel in platform.wheels], np.eye(3))
    np.testing.assert_array_equal([stage.axis for stage in platform.stages], np.eye(3))
    assert {(w.inertia, w.momentum_limit, w.torque_limit) for w in platform.wheels} == {
        (0.028, 5.0, 0.5)
    }
    assert [stage.travel for stage in platform.stages] == [(-0.1, 0.1), *[(-0.15, 0.15)] * 2]


def test_variants_carry_the_papers_offsets_and_hang_below_the_centre_of_rotation():
    assert variants_of(SADS) == ("table1", "table1_noise", "table3")
    first, third = load_platform("sads:table1"), load_platform("sads:table3")
    noisy = load_platform("sads:table1_noise")
    np.testing.assert_array_equal(noisy.center_of_mass_offset, first.center_of_mass_offset)
    np.testing.assert_allclose(np.rad2deg(noisy.sensors["attitude"].noise), 2.0, rtol=1e-3)
    np.testing.assert_allclose(np.rad2deg(noisy.sensors["gyro"].noise), 0.25, rtol=1e-3)
    np.testing.assert_allclose(first.center_of_mass_offset / 95.0, [1e-4, -1e-4, -3e-4])
    np.testing.assert_allclose(
        third.center_of_mass_offset / 95.0, [-1.30e-4, 1.424e-4, -1.102e-4], rtol=1e-12
    )
    assert first.center_of_mass_offset[2] < 0 > third.center_of_mass_offset[2]


def test_gravity_asks_at_level_for_the_torques_that_the_readme_tells():
    for variant, torque in {"table1": 0.13, "table3": 0.18}.items():
        in_plane = load_platform(f"sads:{variant}").center_of_mass_offset[:2]
        assert 9.81 * np.linalg.norm(in_plane) == pytest.approx(torque, abs=0.005)


def test_every_body_is_one_that_could_be_built(shipped: mujoco.MjModel):
    """Before MuJoCo rounds: each principal moment at most the sum of the other two."""
    for name in ("sads", *(f"sads:{variant}" for variant in variants_of(SADS))):
        model = compile_model(load_platform(name)).model
        moments = np.sort(model.body_inertia[1:], axis=1)
        assert np.all(moments[:, 0] > 0.0)
        assert np.all(moments[:, 0] + moments[:, 1] > moments[:, 2])
    assert np.all(shipped.body_mass[1:] > 0.0)


def test_what_is_drawn_weighs_nothing_and_only_the_stop_can_touch(shipped: mujoco.MjModel):
    assert not shipped.geom_contype.any()
    assert not shipped.geom_conaffinity.any()
    assert [shipped.pair(i).name for i in range(shipped.npair)] == ["tilt_stop"]
    spec = mujoco.MjSpec.from_file(str(SADS / "platform.xml"))
    assert all(geom.mass == 0.0 for geom in spec.geoms)


def test_the_file_as_shipped_is_the_machine_that_a_simulation_compiles(shipped: mujoco.MjModel):
    machine = compile_model(load_platform("sads"))
    a = mass_properties(shipped, shipped.body("bus").id)
    b = mass_properties(machine.model, machine.base_body)
    np.testing.assert_allclose(a.inertia, b.inertia, atol=1e-12)
    np.testing.assert_allclose(a.center_of_mass_offset, b.center_of_mass_offset, atol=1e-14)
    assert machine.model.opt.timestep == shipped.opt.timestep


def test_the_viewers_sliders_move_the_stages_and_nothing_drifts(shipped: mujoco.MjModel):
    data = mujoco.MjData(shipped)
    wanted = np.array([0.05, -0.1, 0.15])
    data.ctrl[[shipped.actuator(name).id for name in ("s1", "s2", "s3")]] = wanted
    mujoco.mj_step(shipped, data, 500)
    stages = [shipped.jnt_qposadr[shipped.joint(name).id] for name in ("s1", "s2", "s3")]
    np.testing.assert_allclose(data.qpos[stages], wanted, atol=1e-6)


@pytest.mark.parametrize("azimuth", [0.0, 1.0, 2.5, 4.0])
def test_the_tilt_stop_holds_a_machine_that_runs_into_it(azimuth: float):
    """It goes half a degree deep at most; what is left is the slide along the smooth stop."""
    machine = compile_model(load_platform("sads"))
    model, data = machine.model, mujoco.MjData(machine.model)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    data.qpos[machine.base_qpos] = rotation.from_rotation_vector(np.deg2rad(28.0) * axis)
    data.qvel[machine.base_dof] = 0.3 * axis
    mujoco.mj_forward(model, data)
    brought = data.energy[1]
    worst = 0.0
    for _ in range(300):
        mujoco.mj_step(model, data)
        worst = max(worst, float(rotation.tilt(data.qpos[machine.base_qpos])))
    assert 30.0 < np.rad2deg(worst) < 30.5
    assert data.energy[1] < 0.5 * brought
    assert np.abs(data.qpos[machine.stage_qpos]).max() < 1e-6, "the blow must not move a screw"


def test_the_tilt_stop_leaves_yaw_free():
    machine = compile_model(load_platform("sads"))
    data = mujoco.MjData(machine.model)
    data.qvel[machine.base_dof] = (0.0, 0.0, 1.0)
    for _ in range(700):
        mujoco.mj_step(machine.model, data)
        assert data.ncon == 0
    assert data.time > 2.0 * np.pi


def test_a_picture_can_be_drawn_where_there_is_something_to_draw_with(tmp_path: Path):
    out = tmp_path / "sads.png"
    done = subprocess.run(
        [sys.executable, "-m", "twin", "check", "sads", "--picture", str(out)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    if "MuJoCo cannot draw here" in done.stderr:
        assert "set MUJOCO_GL=egl" in done.stderr, "the remedy is told"
        pytest.skip(done.stderr)
    assert done.returncode == 0, done.stderr
    assert out.read_bytes().startswith(b"\x89PNG")


def test_the_shipped_picture_is_small():
    assert (SADS / "sads.png").stat().st_size < 200_000
