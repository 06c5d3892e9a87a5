"""What leaves a tank takes its mass, its m r and its inertia along."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from twin.effects import parse_effects, with_effects
from twin.errors import PlatformError
from twin.plant.forces import STANDARD_GRAVITY
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, Tank, load_platform
from twin.rotation import conjugate, multiply, normalized, vertical_body

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


def test_a_leaking_machine_moves_as_an_integrator_without_mujoco_has_it():
    """H = J_b w + sum a_i h_i, with J and m r of the gas that is left, over each control tick."""
    place, leak, seconds = np.array([0.1, 0.3, 0.05]), 2e-3, 4.0
    stated = with_tanks(load_platform("astros"), Tank(place))
    platform = with_effects(stated, parse_effects(f"gas_consumption={leak}"))
    attitude, rate = normalized(np.array([0.999, 0.02, -0.03, 0.02])), np.array([0.05, -0.03, 0.2])
    start = InitialState(attitude=attitude, rate_body=rate, wheel_speed=0.0)
    plant = SimulatedPlant(platform, initial=start)
    for tick in range(round(seconds / platform.tick) + 1):
        plant.read(tick * platform.tick)
    axes = np.array([wheel.axis for wheel in platform.wheels])
    spin = np.array([wheel.inertia for wheel in platform.wheels])
    held = axes.T @ (spin * (axes @ rate))  # no motor turns, so that each wheel keeps its own

    def slope(_: float, y: np.ndarray, gone: float) -> np.ndarray:
        w = y[4:]
        inertia = platform.inertia - parallel_axis(gone, place) - (axes.T * spin) @ axes
        moment = platform.center_of_mass_offset - gone * place
        torque = np.cross(moment, -platform.gravity * vertical_body(y[:4]))
        turning = np.linalg.solve(inertia, torque - np.cross(w, inertia @ w + held))
        return np.append(0.5 * multiply(y[:4], np.append(0.0, w)), turning)

    y = np.append(attitude, rate)
    for tick in range(round(seconds / platform.tick)):
        gone = leak * (tick + 0.5) * platform.tick
        y = solve_ivp(
            slope, (0.0, platform.tick), y, "DOP853", args=(gone,), rtol=1e-12, atol=1e-14
        ).y[:, -1]
    found = plant.truth()["truth_attitude"].value[0, 0]
    off = 2.0 * np.linalg.norm(multiply(conjugate(y[:4]), found)[1:])
    print(f"{np.degrees(off):.1e} deg after {seconds:g} s")
    assert off < 1e-11
