"""Place and attitude held and changed by thrusters, alone and beside gyros or wheels."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq, linprog

from tests.controllers.flight import simulate
from twin.api import fly
from twin.controller import load_controller
from twin.controller.exchange import Gyros
from twin.controller.thrusters import Wrenches
from twin.drives import travelling_mass
from twin.effects import parse_effects, with_effects
from twin.errors import ControllerError, UsageError
from twin.estimators.estimator import blank
from twin.plant.forces import STANDARD_GRAVITY
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.reference import parse_reference

SEED = 20261130
DRAWS = 60


@pytest.mark.parametrize(
    ("name", "price"),
    [
        ("astros:mode_c", np.inf),
        ("astros:mode_c", 0.5),
        ("sads", np.inf),
        ("astros:mode_a", np.inf),
    ],
)
def test_a_wrench_is_met_with_the_gas_of_a_linear_program(name, price):
    platform = load_platform(name)
    nozzles = Wrenches.of(platform, "a law", price=price)
    draw = np.random.default_rng(SEED)
    size = draw.uniform(0.0, 3.0 * platform.thrusters[0].force_limit, size=(DRAWS, 1))
    wrench, exchange = size * draw.normal(size=(DRAWS, 6)), draw.uniform(0.0, 1.0, size=DRAWS)
    found = nozzles.allocate(wrench, exchange if np.isfinite(price) else None)
    given = nozzles.wrench(found.force)
    given[:, 3:] += found.exchange
    asked, limit = wrench @ nozzles.rows.T, nozzles.limit[:-1].copy()
    np.testing.assert_allclose(given @ nozzles.rows.T, found.scale[:, None] * asked, atol=1e-9)
    assert 0.1 < np.mean(found.scale < 1.0) < 0.95, "both sides of the limits are drawn"
    gas = np.append(np.ones(nozzles.thrusters), np.full(len(limit) - nozzles.thrusters, price))
    for run in range(DRAWS):
        if np.isfinite(price):
            limit[nozzles.thrusters :] = exchange[run]
        columns = np.hstack([nozzles.effect[:, :-1], -asked[run][:, None]])
        most = linprog(
            np.append(0.0 * limit, -1.0),
            A_eq=columns,
            b_eq=np.zeros(len(columns)),
            bounds=[(0.0, top) for top in (*limit, 1.0)],
        )
        assert found.scale[run] == pytest.approx(most.x[-1], abs=1e-9), f"seed {SEED}, run {run}"
        least = linprog(
            gas,
            A_eq=columns[:, :-1],
            b_eq=asked[run] * min(found.scale[run], 1.0) * (1.0 - 1e-9),
            bounds=[(0.0, top) for top in limit],
        )
        spent = found.force[run].sum()
        if np.isfinite(price):
            spent += price * np.abs(found.exchange[run]).sum()
        assert np.all(found.force[run] <= limit[: nozzles.thrusters])
        assert spent <= 1.01 * least.fun, f"seed {SEED}, run {run}"


def test_thrusters_that_do_not_push_all_round_are_refused():
    platform = load_platform("astros:mode_c")
    with pytest.raises(ControllerError, match="thrusters that only push"):
        Wrenches.of(replace(platform, thrusters=platform.thrusters[:9]), "a law")
    sensors = {k: v for k, v in platform.sensors.items() if k != "position"}
    with pytest.raises(ControllerError, match=r"\[sensors.position\]"):
        load_controller("thruster_five").init(replace(platform, sensors=sensors), 1)


@pytest.mark.parametrize("gains", [{}, {"torque": 0.0}], ids=["beside gyros", "thrusters alone"])
def test_a_place_is_held_within_five_millimetres(gains):
    law, platform = load_controller("thruster_five", gains), load_platform("astros:mode_c")
    run = simulate(law, platform, 20.0, estimator="filter", seed=SEED)
    place = np.linalg.norm(run.true["position"][:, :2], axis=1)
    print(f"seed {SEED}: {1e3 * place.max():.2f} mm")
    assert place.max() < 5e-3
    moving = InitialState(velocity=np.array([0.02, 0.0, 0.0]))
    reference = parse_reference(law.reference)
    run = simulate(
        law, platform, 40.0, estimator="filter", seed=SEED, start=moving, reference=reference
    )
    place = np.linalg.norm(run.true["position"][:, :2], axis=1)
    assert place[run.time > 20.0].max() < 5e-3, "once it is back"


def test_a_metre_from_rest_to_rest_takes_the_time_and_gas_of_full_thrust():
    law, platform = load_controller("thruster_five"), load_platform("astros:mode_c")
    force, mass = 10.0, travelling_mass(platform)
    assert platform.gas is not None
    seconds = 2.0 * np.sqrt(mass / force)
    gas = force * seconds / (platform.gas.specific_impulse * STANDARD_GRAVITY)
    assert (seconds, gas) == (pytest.approx(8.9, abs=0.05), pytest.approx(0.151, abs=5e-4))
    reference = parse_reference(f"hold+move:1,0@{force / mass}")
    run = simulate(law, platform, 12.0, estimator="filter", seed=SEED, reference=reference)
    target = reference.at(run.time).position
    assert target is not None
    error = np.linalg.norm((run.true["position"] - target)[:, :2], axis=1)
    there = np.linalg.norm((run.true["position"] - [1.0, 0.0, 0.0])[:, :2], axis=1)
    spent = run.true["gas_mass"][0, 0] - np.interp(seconds, run.time, run.true["gas_mass"][:, 0])
    print(f"seed {SEED}: {spent:.4f} kg, {1e3 * error.max():.2f} mm behind")
    assert spent == pytest.approx(gas, rel=0.02), "gyros hold the attitude without gas"
    assert error.max() < 6e-3
    assert there[run.time > seconds].max() < 6e-3
    assert np.degrees(np.abs(2.0 * run.true["attitude"][:, 1:]).max()) < 0.5


def test_a_slope_of_the_floor_is_held_without_an_offset():
    law = load_controller("thruster_five")
    platform = with_effects(load_platform("astros:mode_c"), parse_effects("floor_slope=1e-3/-5e-4"))
    reference = parse_reference(law.reference)
    run = simulate(law, platform, 40.0, estimator="filter", seed=SEED, reference=reference)
    settled = run.true["position"][run.time > 25.0, :2]
    assert np.abs(settled.mean(axis=0)).max() < 5e-4
    assert np.linalg.norm(settled, axis=1).max() < 5e-3


def test_full_wheels_are_emptied_in_the_time_that_the_torque_of_the_thrusters_takes():
    law = load_controller("thruster_five", {"full": 4.9})
    platform = load_platform("sads")
    upright = np.array([float(abs(wheel.axis[2]) > 0.99) for wheel in platform.wheels])
    inertia = np.array([wheel.inertia for wheel in platform.wheels])
    start = InitialState(wheel_speed=5.0 / inertia * upright)
    run = simulate(law, platform, 14.0, estimator="filter", seed=SEED, start=start)
    held = np.linalg.norm(run.true["wheel_speed"] * inertia, axis=1)
    empty = float(run.time[np.flatnonzero(held < 0.05)[0]])
    most = platform.wheels[0].torque_limit
    print(f"seed {SEED}: {empty:.2f} s")
    assert empty == pytest.approx(5.0 / most, abs=0.2), "the motors give less than `emptying`"
    assert np.degrees(np.abs(2.0 * run.true["attitude"][:, 1:]).max()) < 0.5


def test_full_gyros_are_emptied_by_a_newton_at_0_6_m_in_8_3_seconds():
    law, platform = load_controller("thruster_five", {"full": 4.9}), load_platform("astros")
    gyros = Gyros.of(platform, "a law")
    speed, leaning = np.full(4, 350.0), np.array([-1.0, -1.0, 1.0, 1.0])

    def held(angles, speeds):
        shown = replace(blank(platform, len(angles)), gimbal_angle=angles, wheel_speed=speeds)
        return np.linalg.norm(gyros.momentum(shown), axis=1)

    def excess(angle):
        return held(angle * leaning[None], speed[None])[0] - 5.0

    angle = brentq(excess, 0.0, 1.5)
    start = InitialState(wheel_speed=speed, gimbal_angle=angle * leaning)
    run = simulate(law, platform, 12.0, estimator="filter", seed=SEED, start=start)
    size = held(run.true["gimbal_angle"], run.true["wheel_speed"])
    empty = float(run.time[np.flatnonzero(size < 0.1)[0]])
    print(f"seed {SEED}: {size[0]:.3f} N m s, empty at {empty:.2f} s")
    assert size[0] == pytest.approx(5.0)
    assert empty == pytest.approx(5.0 / (1.0 * 0.6), abs=0.35)
    assert np.degrees(np.abs(2.0 * run.true["attitude"][:, 1:]).max()) < 1.0


def test_a_place_that_nobody_can_follow_is_told_before_the_flight():
    with pytest.raises(UsageError, match="stays where it is"):
        fly("astros", "thruster_five", reference="hold+move:1,0", duration=0.1)
    flown = fly("astros:mode_c", "thruster_pd", reference="hold+move:1,0", duration=0.1)
    assert "ThrusterPD steers none" in flown.warnings[0]
    flown = fly("astros:mode_c", "thruster_five", reference="hold+move:1,0@0.2", duration=0.1)
    assert "it will lag behind" in flown.warnings[0]
    flown = fly("astros:mode_c", "thruster_five", reference="hold+move:1,0@0.05", duration=0.2)
    assert not flown.warnings
    assert flown.metrics["place_error_max_m"] < 5e-3
    streams = {"reference_position", "reference_velocity", "estimate_position", "estimate_velocity"}
    assert streams <= set(flown.recording)
    assert not fly("astros", "thruster_five", duration=0.1).warnings, "its own reference"
