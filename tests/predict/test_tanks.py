"""A tank's gauge falls by what the thrusters take, and by what leaks besides."""

from dataclasses import replace

import numpy as np
import pytest

from papers.flown import flown
from twin.api import fly
from twin.controller import load_controller
from twin.diagnosis import diagnose
from twin.diagnosis.baseline import baseline_of
from twin.effects import effect_named, with_effects
from twin.plant.forces import STANDARD_GRAVITY
from twin.platform import Tank, load_platform
from twin.predict.inputs import pressure
from twin.reference import parse_reference

SEED = 20261123


def test_a_steady_thrust_empties_the_tanks_by_its_specific_impulse():
    platform = load_platform("whorl1")
    gas = platform.gas
    assert gas is not None
    edges, thrust = np.linspace(0.0, 40.0, 401), np.tile([0.05, 0.0, 0.03, 0.0], (400, 1))
    found = pressure(platform, edges, thrust)
    assert found is not None
    taken = 0.08 * 40.0 / (gas.specific_impulse * STANDARD_GRAVITY)
    assert found.value[-1, 0] == pytest.approx(gas.pressure * (1.0 - taken / gas.mass))
    assert pressure(replace(platform, gas=None), edges, thrust) is None


def test_what_leaks_is_told_from_what_the_thrusters_take():
    leak = effect_named("gas_consumption")(rate=2e-4)
    platform, law = load_platform("whorl1"), load_controller("thruster_pd")
    leaking, reference = with_effects(platform, [leak]), parse_reference("multisine:2")
    run = flown(leaking, law, 20.0, reference=reference, seed=SEED, record=True)
    log = run.recordings[0].without_truth()
    assert np.sum(log["command_thruster"].value) > 0.0
    plain = baseline_of([log], platform)
    found = plain.instead([replace(leak, rate=1e-5)])
    (effect,), sigma = found.effects, float(np.sqrt(found.covariances[0][0, 0]))
    print(f"seed {SEED}: {effect.values[0]:.3g} +- {sigma:.2g} kg/s")
    assert abs(effect.values[0] - 2e-4) < 4.0 * sigma
    assert plain.cost - found.cost > 30.0


def test_gas_that_thrusters_take_is_no_drift_of_the_centre_of_mass():
    platform, law = load_platform("astros"), load_controller("thruster_pd")
    assert platform.gas is not None
    gas = replace(platform.gas, tanks=(Tank(np.array([0.0, 0.3, 0.0])),))
    platform = replace(platform, gas=gas)
    run = flown(
        platform, law, 8.0, reference=parse_reference("multisine:4"), seed=SEED, record=True
    )
    log = run.recordings[0].without_truth()
    drift = effect_named("center_of_mass_drift")(rate=(1e-9, -1e-9, 1e-9))
    gains = {}
    for name, machine in (
        ("known", platform),
        ("weightless", replace(platform, gas=replace(gas, tanks=()))),
    ):
        plain = baseline_of([log], machine)
        found = plain.instead([drift])
        (effect,), sigma = found.effects, np.sqrt(np.diag(found.covariances[0]))
        gains[name] = plain.cost - found.cost
        print(f"seed {SEED}, {name}: {effect.values} +- {sigma} kg m/s, gain {gains[name]:.1f}")
        if name == "known":
            assert np.all(np.abs(effect.values[:2]) < 4.0 * sigma[:2])
    assert gains["weightless"] > gains["known"] + 20.0


@pytest.mark.slow
def test_a_leak_from_a_tank_with_a_place_is_told_by_gauge_and_gravity_together():
    platform, law = load_platform("astros"), load_controller("thruster_pd")
    leak = effect_named("gas_consumption")(rate=1e-3)
    leaking, reference = with_effects(platform, [leak]), parse_reference("multisine:2")
    run = flown(leaking, law, 10.0, reference=reference, seed=SEED, record=True)
    log = run.recordings[0].without_truth()
    plain = baseline_of([log], platform)
    found = plain.instead([replace(leak, rate=1e-5)])
    drift = plain.instead([effect_named("center_of_mass_drift")(rate=(1e-9, -1e-9, 1e-9))])
    (effect,), sigma = found.effects, float(np.sqrt(found.covariances[0][0, 0]))
    print(f"seed {SEED}: {effect.values[0]:.4g} +- {sigma:.2g} kg/s")
    assert abs(effect.values[0] - 1e-3) < 4.0 * sigma
    assert sigma < 2e-5, "the gauge alone would leave more"
    assert found.cost < drift.cost - 20.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(SEED, SEED + 2))
def test_gas_that_leaks_is_named_and_not_a_drift_of_the_centre_of_mass(seed: int):
    stated = load_platform("astros")
    assert stated.gas is not None
    tank = Tank(np.array([0.0, 0.3, 0.0]))
    stated = replace(stated, gas=replace(stated.gas, tanks=(tank,)))
    leak = effect_named("gas_consumption")(rate=28.3e-4)
    log = fly(
        with_effects(stated, [leak]),
        "thruster_pd",
        reference="multisine:3",
        duration=10.0,
        seed=seed,
    ).recording.without_truth()
    found = diagnose([log], stated)
    assert [cause.effect.name for cause in found.causes] == ["gas_consumption"], str(found)[:200]
