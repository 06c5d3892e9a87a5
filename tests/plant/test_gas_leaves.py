"""What leaves a tank takes its mass, its m r and its inertia along."""

from dataclasses import replace

import numpy as np
import pytest

from twin.effects import parse_effects, with_effects
from twin.errors import PlatformError
from twin.plant.forces import STANDARD_GRAVITY
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, Tank, load_platform

SEED = 20261130
USED = 0.0283
"""[kg]."""


def with_tanks(platform: Platform, *tanks: Tank, mass: float | None = None) -> Platform:
    assert platform.gas is not None
    gas = replace(platform.gas, tanks=tanks, mass=mass or platform.gas.mass)
    return replace(platform, gas=gas)


def used(platform: Platform, mass: float, runs: tuple[int, ...] = (0,)) -> SimulatedPlant:
    """Of each run but the first so much gas is used [kg], by forces that cancel; of one run too."""
    plant = SimulatedPlant(platform, runs=runs)
    assert platform.gas is not None
    force = np.zeros((len(runs), len(platform.thrusters)))
    force[-1] = 0.4
    rate = force[-1].sum() / (platform.gas.specific_impulse * STANDARD_GRAVITY)
    ticks = int(np.ceil(mass / rate / platform.tick))
    plant.read(0.0)
    plant.write({"command_thruster": force * mass / (rate * ticks * platform.tick)})
    plant.read(ticks * platform.tick)
    return plant


def parallel_axis(mass: float, place: np.ndarray) -> np.ndarray:
    return mass * (place @ place * np.eye(3) - np.outer(place, place))


def six(tensor: np.ndarray) -> np.ndarray:
    return tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def test_28_3_grams_from_a_tank_0_3_m_off_take_their_moment_and_inertia_along():
    place = np.array([0.0, 0.3, 0.0])
    platform = with_tanks(load_platform("astros"), Tank(place))
    truth = used(platform, USED).truth()
    left = truth["truth_gas_mass"].value[0, 0, 0]
    offset = truth["truth_center_of_mass_offset"].value[0, 0]
    inertia = truth["truth_inertia"].value[0, 0]
    assert platform.gas is not None
    assert platform.gas.mass - left == pytest.approx(USED, abs=1e-12)
    moved = offset - platform.center_of_mass_offset
    np.testing.assert_allclose(moved, -USED * place, atol=1e-12)
    assert moved[1] == pytest.approx(-8.5e-3, abs=5e-5)
    expected = six(platform.inertia - parallel_axis(USED, place))
    np.testing.assert_allclose(inertia, expected, atol=1e-12)


def test_a_machine_that_lost_gas_moves_as_one_that_was_built_so():
    draw = np.random.default_rng(SEED)
    tanks = [Tank(draw.uniform(-0.4, 0.4, 3), draw.uniform(1.0, 5.0)) for _ in range(2)]
    stated = with_tanks(load_platform("astros:mode_c"), *tanks)
    assert stated.gas is not None
    volume = np.array([tank.volume for tank in tanks])
    masses = USED * volume / volume.sum()
    pairs = list(zip(masses, (tank.place for tank in tanks), strict=True))
    lighter = replace(
        stated,
        mass=stated.mass - USED,
        center_of_mass_offset=stated.center_of_mass_offset - sum(m * r for m, r in pairs),
        inertia=stated.inertia - sum(parallel_axis(m, r) for m, r in pairs),
    )
    burnt, built = used(stated, USED), SimulatedPlant(lighter)
    first = built.state
    built.read(burnt.time)
    for plant in (burnt, built):
        attitude = np.array([0.99, 0.1, -0.05, 0.08])
        plant._qpos[:], plant._qvel[:] = first
        plant._qpos[:, plant.machine.base_qpos] = attitude / np.linalg.norm(attitude)
        plant._qvel[:, plant.machine.base_dof] = [0.05, -0.1, 0.2]
        plant.write({"command_thruster": np.zeros((1, 12))})
        plant.read(plant.time + 2.0)  # before it leans against its stop
    attitude = [plant.truth()["truth_attitude"].value[0, 0] for plant in (burnt, built)]
    place = [plant.truth()["truth_position"].value[0, 0] for plant in (burnt, built)]
    np.testing.assert_allclose(attitude[0], attitude[1], atol=1e-11)
    np.testing.assert_allclose(place[0], place[1], atol=1e-11)
    for name in ("truth_center_of_mass_offset", "truth_inertia"):
        ends = [plant.truth()[name].value[0, 0] for plant in (burnt, built)]
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)


def test_a_run_whose_gas_stays_has_the_bits_of_one_alone():
    place = np.array([0.1, 0.3, 0.0])
    platform = with_tanks(load_platform("astros"), Tank(place))
    both = used(platform, USED, runs=(0, 1))
    alone = SimulatedPlant(load_platform("astros"))
    alone.read(both.time)
    for whole, single in zip(both.state, alone.state, strict=True):
        np.testing.assert_array_equal(whole[0], single[0])


def test_a_leak_takes_the_mass_of_its_gas_along_and_shows_on_the_gauge():
    place, rate = np.array([0.0, 0.3, 0.0]), 1e-3
    platform = with_tanks(load_platform("astros"), Tank(place))
    quiet = replace(platform.sensors["gas_pressure"], noise=np.zeros(1), bias=np.zeros(1))
    platform = replace(platform, sensors={"gas_pressure": quiet})
    plant = SimulatedPlant(with_effects(platform, parse_effects(f"gas_consumption={rate}")))
    plant.read(0.0)
    shown = plant.read(10.0).streams["gas_pressure"]
    truth = plant.truth()
    moved = truth["truth_center_of_mass_offset"].value[0, 0] - platform.center_of_mass_offset
    assert platform.gas is not None
    np.testing.assert_allclose(moved, -10.0 * rate * place, atol=1e-12)
    assert truth["truth_gas_mass"].value[0, 0, 0] == pytest.approx(platform.gas.mass - 0.01)
    part = shown.value[0, -1, 0] / platform.gas.pressure
    assert part == pytest.approx(1.0 - rate * shown.time[0, -1] / platform.gas.mass)


def test_more_gas_than_the_bus_weighs_is_refused():
    platform = with_tanks(load_platform("astros"), Tank(np.zeros(3)), mass=200.0)
    with pytest.raises(PlatformError, match="could not lose its 200 kg of gas"):
        SimulatedPlant(platform)


def test_gas_whose_tanks_have_no_place_weighs_nothing():
    platform = load_platform("astros")
    platform = with_tanks(platform)
    truth = used(platform, USED, runs=(0, 1)).truth()
    offset = truth["truth_center_of_mass_offset"].value
    np.testing.assert_array_equal(offset[0], offset[1])
