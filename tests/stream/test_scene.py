"""The machine is drawn where the streams say it is, and the plots say what the streams say."""

import mujoco
import numpy as np
import pytest
from rerun.chunk import Chunk

from twin import rotation
from twin.platform import Platform, load_platform
from twin.platform.mjcf import load_mjcf
from twin.stream import blueprint
from twin.stream.blueprint import Plots, Scene
from twin.stream.vectors import GRAVITY, MOMENTUM, THRUST, Vectors


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


def placed(chunks: list[Chunk]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Last translation and quaternion (scalar first) by entity path."""
    poses: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if "Transform3D:quaternion" not in batch.schema.names:
            continue  # arrows and markers
        position = np.array(batch.column("Transform3D:translation")[-1].as_py()[0])
        quat = np.array(batch.column("Transform3D:quaternion")[-1].as_py()[0])
        poses[chunk.entity_path] = position, quat[[3, 0, 1, 2]]
    return poses


def in_world(poses: dict[str, tuple[np.ndarray, np.ndarray]], path: str) -> np.ndarray:
    """Where a body's origin is, by the transforms along its entity path."""
    point = np.zeros(3)
    while path != "/world":
        position, quat = poses[path]
        point = position + rotation.rotate(quat, point)
        path = path.rpartition("/")[0]
    return point


def test_bus_and_stages_stand_where_mujoco_puts_them(sads):
    quat = rotation.from_euler_zyx(np.array(0.3), np.array(-0.2), np.array(0.1))
    travel = np.array([0.02, -0.03, 0.04])
    model = load_mjcf(sads.model_path)
    data = mujoco.MjData(model)
    data.joint(sads.base.joint).qpos[:] = quat
    for stage, position in zip(sads.stages, travel, strict=True):
        data.joint(stage.name).qpos[0] = position
    mujoco.mj_kinematics(model, data)

    time = np.array([0.0, 1.0])
    poses = placed(
        Scene(sads).motion(
            {
                "estimate_attitude": (time, np.stack([rotation.IDENTITY, quat])),
                "stage_position": (time, np.stack([np.zeros(3), travel])),
            }
        )
    )
    for joint in (sads.base.joint, *(stage.name for stage in sads.stages)):
        body = model.body(int(model.joint(joint).bodyid[0]))
        path = next(p for p in poses if p.endswith("/" + body.name))
        # Rerun's transforms are float32
        assert np.allclose(in_world(poses, path), data.xpos[body.id], atol=1e-6), body.name


def test_gimbals_and_what_floats_away_stand_where_mujoco_puts_them():
    astros = load_platform("astros:mode_c")
    model = load_mjcf(astros.model_path)
    data = mujoco.MjData(model)
    quat = rotation.from_euler_zyx(np.array(0.3), np.array(-0.2), np.array(0.1))
    angle = np.array([0.3, -0.4, 0.5, 1.2])
    data.joint("bearing").qpos[:] = quat
    data.joint("x").qpos[0], data.joint("y").qpos[0] = 0.4, -0.3
    for gimbal, delta in zip(astros.gimbals, angle, strict=True):
        data.joint(gimbal.name).qpos[0] = delta
    mujoco.mj_kinematics(model, data)
    place = np.array([0.4, -0.3, data.body("bus").xpos[2]])
    time = np.zeros(1)
    poses = placed(
        Scene(astros).motion(
            {
                "attitude": (time, quat[None]),
                "position": (time, place[None]),
                "gimbal_angle": (time, angle[None]),
            }
        )
    )
    for name in ("column", "bus", "g1", "g4", "s3"):
        path = next(p for p in poses if p.endswith("/" + name))
        assert np.allclose(in_world(poses, path), data.body(name).xpos, atol=1e-6), name
    path = next(p for p in poses if p.endswith("/g4"))
    turned = rotation.multiply(quat, poses[path][1])
    assert np.allclose(np.abs(turned @ data.body("g4").xquat), 1.0, atol=1e-6)


def test_a_hinge_turns_about_its_axis():
    pendulum = load_platform("dfki_pendulum")
    model = load_mjcf(pendulum.model_path)
    data = mujoco.MjData(model)
    data.joint(pendulum.base.joint).qpos[:] = 0.7
    mujoco.mj_kinematics(model, data)
    poses = placed(Scene(pendulum).motion({"joint_angle": (np.zeros(1), np.array([[0.7]]))}))
    ((_, quat),) = poses.values()
    assert np.allclose(quat, data.body(pendulum.base.body).xquat, atol=1e-6)


def test_a_machine_whose_streams_are_missing_stands_as_its_mjcf_has_it(sads):
    poses = placed(Scene(sads).motion({"gyro": (np.zeros(1), np.zeros((1, 3)))}))
    assert len(poses) == 1 + len(sads.stages) + len(sads.wheels)
    model = load_mjcf(sads.model_path)
    assert np.allclose(in_world(poses, "/world/bus"), model.body(sads.base.body).pos, atol=1e-6)


def test_everything_mujocos_viewer_shows_is_drawn(sads):
    model = load_mjcf(sads.model_path)
    shown = np.count_nonzero(model.geom_group < 3)
    drawn = 0
    for path, archetype in Scene(sads).shapes():
        if path.rpartition("/")[2] in ("boxes", "cylinders", "capsules", "planes", "spheres"):
            drawn += max(len(b.as_arrow_array()) for b in archetype.as_component_batches())
    assert drawn == shown


def test_tilt_and_gravity_torque_are_those_of_the_attitude(sads):
    time = np.array([0.0])
    attitude = rotation.from_euler_zyx(np.array([0.0]), np.array([0.0]), np.radians([6.0]))
    offset = np.array([[0.0, 0.0, -2e-3]])
    derived = Plots(sads).derived(
        {
            "truth_attitude": (time, attitude),
            "truth_center_of_mass_offset": (time, offset),
        }
    )
    assert derived[blueprint.TILT][1][0, 0] == pytest.approx(6.0)
    # a pendulum: m g r sin(tilt)
    expected = 1e3 * 2e-3 * sads.gravity * np.sin(np.radians(6.0))
    assert derived[blueprint.GRAVITY_TORQUE][1][0, 0] == pytest.approx(expected)


def test_a_reference_is_held_between_blocks(sads):
    tenth = rotation.from_rotation_vector(np.array([[0.0, 0.0, 0.1]]))
    level = rotation.IDENTITY[None]
    drawn = Plots(sads)
    drawn.derived({"reference_attitude": (np.array([0.0]), tenth)})
    derived = drawn.derived({"estimate_attitude": (np.array([1.0]), level)})
    error = derived[blueprint.ATTITUDE_ERROR][1]
    assert np.allclose(error, [[0.0, 0.0, -np.degrees(0.1)]])


def drawn(chunks: list[Chunk], kind: str) -> np.ndarray:
    """(rows, arrows, 3) vectors of one kind of arrow."""
    (chunk,) = (chunk for chunk in chunks if chunk.entity_path.endswith(f"/{kind}"))
    return np.array(chunk.to_record_batch().column("Arrows3D:vectors").to_pylist())


def direction(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def vectors_of(platform: Platform) -> Vectors:
    return Vectors(platform, load_mjcf(platform.model_path), "/world/bus")


def test_arrows_point_along_the_momentum_and_the_torque_of_gravity(sads, drawn_seed: int):
    draw = np.random.default_rng(drawn_seed)
    time = np.arange(4.0)
    attitude = rotation.from_rotation_vector(draw.normal(0.0, 0.3, (4, 3)))
    rate, speed = draw.normal(0.0, 0.1, (4, 3)), draw.normal(0.0, 10.0, (4, len(sads.wheels)))
    moment = draw.normal(0.0, 1e-2, (4, 3))
    chunks = vectors_of(sads).chunks(
        {
            "attitude": (time, attitude),
            "gyro": (time, rate),
            "wheel_speed": (time, speed),
            "truth_center_of_mass_offset": (time, moment),
        }
    )
    spin = np.array([wheel.inertia * wheel.axis for wheel in sads.wheels])
    momentum = rate @ sads.inertia + speed @ spin
    assert np.allclose(direction(drawn(chunks, MOMENTUM)[:, 0]), direction(momentum), atol=1e-5)
    weight = rotation.rotate(rotation.conjugate(attitude), np.array([0.0, 0.0, -sads.gravity]))
    torque = np.cross(moment, weight)
    assert np.allclose(direction(drawn(chunks, GRAVITY)[:, 0]), direction(torque), atol=1e-5)


def test_a_gyros_momentum_turns_with_its_gimbal():
    tas2 = load_platform("tas2")
    time, turned = np.zeros(1), np.array([[0.0, 0.5 * np.pi, 0.0]])
    chunks = vectors_of(tas2).chunks(
        {"attitude": (time, rotation.IDENTITY[None]), "gimbal_angle": (time, turned)}
    )
    arrows = direction(drawn(chunks, "wheel_momentum")[0])
    first, second = tas2.rotors[:2]
    assert np.allclose(arrows[0], first.axis, atol=1e-5)
    assert np.allclose(arrows[1], np.cross(tas2.gimbals[1].axis, second.axis), atol=1e-5)


def test_thrusters_blow_against_the_force_on_the_body():
    sads = load_platform("sads")
    force = np.zeros((1, len(sads.thrusters)))
    force[0, 2] = sads.thrusters[2].force_limit
    chunks = vectors_of(sads).chunks(
        {
            "attitude": (np.zeros(1), rotation.IDENTITY[None]),
            "command_thruster": (np.zeros(1), force),
        }
    )
    (plumes,) = drawn(chunks, THRUST)
    assert np.allclose(direction(plumes[2]), -sads.thrusters[2].direction, atol=1e-6)
    assert not np.delete(plumes, 2, axis=0).any()


def test_wheels_turn_by_the_integral_of_their_speed_over_blocks(sads):
    scene, rate = Scene(sads), 0.5 * sads.wheels[0].speed_limit
    for start in (0.0, 0.1):
        time = start + np.linspace(0.0, 0.1, 6)
        poses = placed(scene.motion({"wheel_speed": (time, np.full((6, len(sads.wheels)), rate))}))
    turn = rotation.to_rotation_vector(poses["/world/bus/w1"][1])
    assert np.allclose(turn, 0.5 * np.pi * 0.2 * sads.wheels[0].axis, atol=1e-6)


def test_a_ghost_stands_where_the_prediction_is_and_else_at_the_target(sads):
    level, leaning = rotation.IDENTITY[None], rotation.from_rotation_vector(np.array([[0.2, 0, 0]]))
    time = np.zeros(1)
    rows = {"attitude": (time, level), "reference_attitude": (time, leaning)}
    for streams, quat in ((rows, leaning), ({**rows, "predicted_attitude": (time, level)}, level)):
        scene = Scene(sads)
        poses = placed(scene.motion(streams))
        assert "world/ghost/w1/cylinders" in [path for path, _ in scene.appeared()]
        assert np.allclose(poses["/world/ghost"][1], quat[0], atol=1e-6)
        scene.motion(streams)
        assert scene.appeared() == [], "once"


def test_a_limit_is_drawn_only_where_a_curve_comes_near_it(sads):
    limit = min(wheel.speed_limit for wheel in sads.wheels)
    time = np.arange(3.0)
    speed = np.outer([0.01, 0.1, 0.6], np.full(len(sads.wheels), limit))
    derived = Plots(sads).derived({"wheel_speed": (time, speed)})
    rpm = limit * 30.0 / np.pi
    assert derived[blueprint.WHEEL_SPEED][1][2, 0] == pytest.approx(0.6 * rpm)
    lines = derived[f"{blueprint.WHEEL_SPEED}/limit"]
    assert lines[0].tolist() == [2.0]
    assert np.allclose(lines[1], [[rpm, -rpm]])
