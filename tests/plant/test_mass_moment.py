"""Where a simulation says that its centre of mass is, held against what gravity does to it."""

import shutil
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from twin.effects import BodyEffect, State, effect_named, parse_effects, with_effects
from twin.model import compile_model, mass_properties
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.rotation import conjugate, from_rotation_vector, rotate

Array = np.ndarray

AS_GRAVITY = ("center_of_mass_drift", "structural_sag")
"""Effects whose push or torque stands for gravity's; those of all others are none of it."""
MOVING = (*AS_GRAVITY, "liquid_slosh", "wheel_imbalance", "gimbal_center_of_mass_offset")
GYRO_MASS = 13.0
"""Of a gimbal of `tas2` with its rotor [kg]."""

DRIFT, SAG, SLOSH = "center_of_mass_drift=1e-3/-2e-3/3e-3", "structural_sag=0.1", "liquid_slosh"
GYRO = "gimbal_center_of_mass_offset"
GYROS = f"{GYRO}=0.3/-0.2"
WHEELS, SLIGHT = "wheel_imbalance=0.02/1e-3", "wheel_imbalance=3e-7/0"
CASES = {
    "sads": (DRIFT, SAG, SLOSH, WHEELS, SLIGHT, f"{DRIFT},{SAG},{SLOSH},wheel_imbalance:w2=0.02/0",
             "flexible_appendage", "residual_dipole", "wheel_misalignment=0.1/-0.2/0.3"),
    "cubesat": (DRIFT, SAG, "liquid_slosh=0.05/0.03/0.01/0.02/0/-0.02"),
    "whorl2": (DRIFT, SAG, WHEELS),
    "tas2": (f"{GYRO}=3e-7/-2e-7", f"{GYRO}:g2=0.3/-0.2", f"{GYROS},{DRIFT},{SAG},{SLOSH}"),
    "astros": (GYROS, f"{GYROS},{WHEELS},{SLOSH}", f"{DRIFT},{SAG}"),
    "astros:mode_c": (f"{GYROS},{SAG}",),
}  # fmt: skip


def finely(platform: Platform) -> Platform:
    """In a field, and with a step that follows any wheel and any liquid."""
    return replace(platform, step=platform.step / 16.0, magnetic_field=np.array([2e-5, 0.0, -4e-5]))


def starts(platform: Platform, rng: np.random.Generator, n: int) -> InitialState:
    """Of n runs that stand askew, with masses, gimbals and wheels anywhere."""
    low, high = np.array([stage.travel for stage in platform.stages]).T
    lean = 0.5 * min(platform.stop_angle, 0.5)
    return InitialState(
        attitude=from_rotation_vector(rng.uniform(-lean, lean, (n, 3)) / np.sqrt(2.0)),
        stage_position=rng.uniform(low, high, (n, len(low))),
        gimbal_angle=rng.uniform(-3.0, 3.0, (n, len(platform.gimbals))),
        wheel_speed=rng.uniform(0.1, 1.0, (n, len(platform.wheels)))
        * [wheel.speed_limit for wheel in platform.wheels],
    )


def gravity_torque(plant: SimulatedPlant) -> Array:
    """(3,) on the base of a lone run as if it stood still, body axes [N m]."""
    machine, model = plant.machine, plant.machine.model
    data = mujoco.MjData(model)
    data.qpos = plant.state[0][0]
    mujoco.mj_forward(model, data)
    force = -data.qfrc_bias
    attitude, still = data.qpos[machine.base_qpos][None], np.zeros((1, 3))
    state = State(attitude, still, np.zeros((1, len(machine.wheel_dof))), np.array([plant.time]))
    for effect in machine.effects:
        if effect.name not in AS_GRAVITY:
            continue
        assert isinstance(effect, BodyEffect)
        for push in effect.pushes(machine.platform):
            wrench = push.wrench(state.time)[0] if callable(push.wrench) else push.wrench
            body = model.body(push.body).id
            mujoco.mj_applyFT(model, data, wrench[:3], wrench[3:], data.xipos[body], body, force)
        law = effect.torque(machine.platform)
        if law is not None:
            force[machine.base_dof] += law(state)[0]
    return force[machine.base_dof]


def told(plant: SimulatedPlant) -> tuple[Array, Array]:
    """(3,) m r [kg m], and its gravity torque [N m], of a lone run."""
    truth = plant.truth()
    moment = truth["truth_center_of_mass_offset"].value[0, 0]
    down = np.array([0.0, 0.0, -plant.platform.gravity])
    weight = rotate(conjugate(truth["truth_attitude"].value[0, 0]), down)
    return moment, np.cross(moment, weight)


def compare(platform: Platform) -> None:
    """Hold what some runs tell, at first and a while later, against MuJoCo."""
    rng = np.random.default_rng(2)
    for _ in range(4):
        plant = SimulatedPlant(platform, initial=starts(platform, rng, 1))
        for tick in range(5):
            plant.read(tick * platform.tick)
            torque = gravity_torque(plant)
            wrong = np.abs(told(plant)[1] - torque).max()
            assert wrong <= 1e-12 * np.abs(torque).max(), (tick, wrong, torque)


@pytest.mark.parametrize(
    ("name", "text"), [(name, text) for name, texts in CASES.items() for text in ("", *texts)]
)
def test_gravity_turns_a_machine_at_rest_by_the_true_m_r(name: str, text: str):
    effects = parse_effects(text) if text else ()
    compare(with_effects(finely(load_platform(name)), effects))


def test_gyros_that_a_mjcf_has_out_of_balance_turn_m_r(tmp_path: Path):
    """Gimbals and rotors alike, and the first of them on a mass that slides."""
    shipped = load_platform("tas2")
    folder = tmp_path / "tas2"
    shutil.copytree(shipped.folder, folder)
    tree = ElementTree.parse(folder / "platform.xml")
    bodies = {body.get("name"): body for body in tree.iter("body")}
    for number, at in enumerate(("0.01 0.02 -0.03", "0 0 0.04", "0.05 -0.02 0"), start=1):
        for part in ("g", "r"):
            inertial = bodies[f"{part}{number}"].find("inertial")
            assert inertial is not None
            inertial.set("pos", at)
    bodies["bus"].remove(bodies["g1"])
    bodies["s1"].append(bodies["g1"])
    bodies["g1"].set("pos", "-0.49 -0.25 0.13")  # where it was
    tree.write(folder / "platform.xml")
    first, *rest = shipped.stages
    stages = (replace(first, mass=first.mass + GYRO_MASS), *rest)
    compare(replace(load_platform(folder), stages=stages))


def test_a_bus_whose_own_centre_is_less_than_a_micrometre_off_its_origin_is_felt():
    platform = load_platform("whorl1")
    machine = compile_model(platform)
    bus, model = machine.base_body, machine.model
    model.body_ipos[bus], model.body_iquat[bus] = (3e-7, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    wanted = mass_properties(model, bus)
    offset = wanted.center_of_mass_offset
    exact = replace(platform, inertia=wanted.inertia, center_of_mass_offset=offset)
    felt = mass_properties(compile_model(exact).model, bus).center_of_mass_offset
    np.testing.assert_allclose(felt, offset, rtol=0.0, atol=1e-14)
    each = InitialState(center_of_mass_offset=np.stack([offset, offset + 1e-3]))
    plants = [SimulatedPlant(exact), SimulatedPlant(exact, runs=[0, 1], initial=each)]
    for plant in plants:
        plant.read(0.0)
        plant.read(1.0)
    alone, among = (plant.truth()["truth_rate"].value[0] for plant in plants)
    np.testing.assert_allclose(among, alone, rtol=1e-9)


def test_a_drift_is_in_the_true_m_r():
    rate = np.array([1e-5, 0.0, 0.0])
    effects = parse_effects("center_of_mass_drift=1e-5/0/0")
    plant = SimulatedPlant(with_effects(load_platform("sads"), effects))
    plant.read(0.0)
    first = told(plant)[0]
    np.testing.assert_array_equal(first, plant.platform.center_of_mass_offset)
    plant.read(30.0)
    np.testing.assert_allclose(told(plant)[0] - first, 30.0 * rate, atol=1e-15)


@pytest.mark.parametrize("name", ["sads", "tas2", "astros"])
def test_a_lone_run_tells_the_same_bits_as_among_others(name: str):
    """With values of their own; in the first run they are those at which an effect is gone."""
    plain = finely(load_platform(name))
    kinds = [effect_named(kind) for kind in MOVING]
    typical = [kind.typical() for kind in kinds if not kind.typical().unfit(plain)]
    assert len(typical) >= 4
    each = [
        tuple(effect.absent() for effect in typical),
        tuple(typical),
        tuple(effect.with_values(1.1 * effect.values) for effect in typical),
    ]
    start = starts(plain, np.random.default_rng(5), len(each))
    nominal = with_effects(plain, typical)
    batch = SimulatedPlant(nominal, runs=range(len(each)), initial=start, effects=each)
    lone = [
        SimulatedPlant(
            with_effects(plain, own),
            runs=(run,),
            initial=InitialState(
                attitude=start.attitude[run],
                stage_position=np.asarray(start.stage_position)[run],
                gimbal_angle=np.asarray(start.gimbal_angle)[run],
                wheel_speed=np.asarray(start.wheel_speed)[run],
            ),
        )
        for run, own in enumerate(each)
    ]
    for tick in range(4):
        for plant in (batch, *lone):
            plant.read(tick * plain.tick)
        told_by_all = batch.truth()["truth_center_of_mass_offset"].value[:, 0]
        alone = np.array([told(plant)[0] for plant in lone])
        assert np.array_equal(told_by_all, alone), np.abs(told_by_all - alone).max()
        assert len(np.unique(told_by_all, axis=0)) == len(each)
