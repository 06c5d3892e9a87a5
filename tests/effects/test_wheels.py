"""Effects on wheels against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from tests.effects.motion import apart
from twin.effects import EffectError, effect_named, parse_effects, with_effects
from twin.model import compile_model, mass_properties
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.rotation import from_rotation_vector, rotate

SECONDS = 20.0


def driven(platform, text, torque, start=None, seconds=SECONDS):
    """Times, rates (m, 3) and wheel speeds (m, 3) under constant wheel torques."""
    plant = SimulatedPlant(
        with_effects(platform, parse_effects(text) if text else ()), initial=start
    )
    rates, speeds = [], []
    for k in range(round(seconds / platform.tick) + 1):
        plant.read(k * platform.tick)
        plant.write({"command_wheel_torque": np.array([torque])})
        truth = plant.truth()
        rates.append(truth["truth_rate"].value[0, 0])
        speeds.append(truth["truth_wheel_speed"].value[0, 0])
    return np.arange(len(rates)) * platform.tick, np.array(rates), np.array(speeds)


def alone(platform, axis):
    """Moments of inertia of body without rotor and of rotor, about a principal axis."""
    rotor = platform.wheels[axis].inertia
    return platform.inertia[axis, axis] - rotor, rotor


def test_viscous_friction_lets_a_wheel_slow_down_against_the_body(balanced, agrees):
    start = InitialState(wheel_speed=np.array([0.0, 0.0, 50.0]))
    time, rate, speed = driven(balanced, "wheel_friction:w3=1e-3/0", [0.0] * 3, start)
    body, rotor = alone(balanced, 2)
    decay = 1e-3 * (1.0 / rotor + 1.0 / body)
    error = np.max(np.abs(speed[:, 2] / (50.0 * np.exp(-decay * time)) - 1.0))
    agrees("wheel_friction, viscous: exponential decay against the body", error, 1e-12)
    given = rotor * (50.0 - speed[:, 2]) / (body + rotor)
    np.testing.assert_allclose(rate[:, 2], given, rtol=1e-9, atol=1e-12)


def test_dry_friction_lets_a_wheel_slow_down_evenly_and_stop(balanced, agrees):
    start = InitialState(wheel_speed=np.array([0.0, 0.0, 5.0]))
    time, _, speed = driven(balanced, "wheel_friction:w3=0/0.01", [0.0] * 3, start)
    body, rotor = alone(balanced, 2)
    slope = 0.01 * (1.0 / rotor + 1.0 / body)
    expected = np.maximum(5.0 - slope * time, 0.0)
    error = np.abs(speed[:, 2] - expected).max()
    agrees("wheel_friction, dry: linear decay, then rest", error, 5e-4, "rad/s")


def test_a_torque_gain_makes_a_wheel_accelerate_in_proportion(balanced, agrees):
    time, _, speed = driven(balanced, "wheel_torque_gain:w3=0.05", [0.0, 0.0, 0.02])
    body, rotor = alone(balanced, 2)
    expected = 1.05 * 0.02 * (1.0 / rotor + 1.0 / body) * time
    error = np.abs(speed[:, 2] - expected).max() / expected[-1]
    agrees("wheel_torque_gain: spin-up against the body", error, 1e-12)
    _, rate, speed = driven(balanced, "", [0.0, 0.01, 0.01])
    _, more, faster = driven(balanced, "wheel_torque_gain:w2=0.05", [0.0, 0.01, 0.01])
    assert more[-1, 1] / rate[-1, 1] == pytest.approx(1.05, rel=1e-4)
    assert faster[-1, 2] / speed[-1, 2] == pytest.approx(1.0, rel=1e-4)


def test_a_heavier_rotor_takes_the_torque_more_slowly(balanced, agrees):
    time, rate, speed = driven(balanced, "wheel_inertia_error:w3=0.1", [0.0, 0.0, 0.02])
    rotor = 1.1 * balanced.wheels[2].inertia
    body = balanced.inertia[2, 2] - rotor
    np.testing.assert_allclose(rate[:, 2], -0.02 / body * time, rtol=1e-9, atol=1e-15)
    spin = 0.02 * (1.0 / rotor + 1.0 / body)
    error = np.abs(speed[:, 2] - spin * time).max() / speed[-1, 2]
    agrees("wheel_inertia_error: exchange of momentum with the body", error, 1e-12)


def test_an_askew_wheel_turns_the_body_about_the_axis_it_really_has(balanced, agrees):
    """From rest J w = -u t a, where wheels that spin freely add nothing about their axes to J."""
    round_body = replace(balanced, inertia=12.0 * np.eye(3))
    turn = np.array([0.02, -0.03, 0.5])
    _, rate, _ = driven(
        round_body, "wheel_misalignment:w3=0.02/-0.03/0.5", [0.0, 0.0, 0.01], seconds=1.0
    )
    axis = rotate(from_rotation_vector(turn), np.array([0.0, 0.0, 1.0]))
    axes = np.stack([balanced.wheels[0].axis, balanced.wheels[1].axis, axis])
    rotors = np.array([wheel.inertia for wheel in balanced.wheels])
    expected = -np.linalg.solve(12.0 * np.eye(3) - axes.T @ (rotors[:, None] * axes), 0.01 * axis)
    error = np.abs(rate[-1] - expected).max() / np.abs(expected).max()
    agrees("wheel_misalignment: the body's answer", error, 1e-9)
    straight = np.array([0.0, 0.0, expected[2]])
    assert np.abs(expected - straight).max() > 1e-2 * abs(expected[2])


@pytest.mark.parametrize(
    "text", ["wheel_misalignment", "wheel_inertia_error:w1", "wheel_imbalance", "liquid_slosh"]
)
def test_the_whole_keeps_the_mass_properties_that_are_stated(sads, text):
    fine = replace(sads, step=1e-3)
    machine = compile_model(with_effects(fine, parse_effects(text)))
    found = mass_properties(machine.model, machine.base_body)
    np.testing.assert_allclose(found.inertia, sads.inertia, atol=1e-10)
    np.testing.assert_allclose(found.center_of_mass_offset, sads.center_of_mass_offset, atol=1e-12)


@pytest.mark.parametrize(("kind", "tolerance"), [("static", 2e-5), ("dynamic", 5e-7)])
def test_an_unbalanced_wheel_shakes_the_body_at_its_own_speed(kind, tolerance, balanced, agrees):
    """Across the axis w = i U W^2 / (A W - h) (e^(i W t) - e^(i h t / A)), h = I_s W.

    U is the product of inertia, or the mass moment times the wheel's height above the CR. A is the
    body's moment across the axis without its two other wheels, which do not follow.
    """
    fine = replace(balanced, step=1e-3, gravity=0.0, inertia=12.0 * np.eye(3), sensors={})
    spin, size, height = 60.0, 1e-4, 0.12
    text = f"wheel_imbalance:w3={size}/0" if kind == "static" else f"wheel_imbalance:w3=0/{size}"
    plant = SimulatedPlant(
        with_effects(fine, parse_effects(text)),
        initial=InitialState(wheel_speed=np.array([0.0, 0.0, spin])),
    )
    dt, rates = 0.01, []
    for k in range(1000):
        plant.read(k * dt)
        rates.append(plant.truth()["truth_rate"].value[0, 0])
    time = dt * np.arange(len(rates))
    rotor = fine.wheels[2].inertia
    across, momentum = 12.0 - fine.wheels[0].inertia, rotor * spin
    whirl = np.exp(1j * spin * time) - np.exp(1j * momentum / across * time)
    product = size * height if kind == "static" else size
    expected = 1j * product * spin**2 / (across * spin - momentum) * whirl
    found = np.array(rates) @ np.array([1.0, 1j, 0.0])
    error = np.abs(found - expected).max() / np.abs(expected).max()
    agrees(f"wheel_imbalance, {kind}: whirl of the body", error, tolerance)


def test_a_step_that_cannot_follow_an_imbalance_is_refused(sads):
    with pytest.raises(EffectError, match="set simulation.step to 0.0018 s or less"):
        with_effects(sads, parse_effects("wheel_imbalance"))


def test_a_harness_is_at_rest_where_it_is_told(balanced):
    rest = from_rotation_vector(np.array([0.02, -0.01, 0.1]))
    effect = effect_named("harness_stiffness")(stiffness=0.5, reference=tuple(rest))
    plant = SimulatedPlant(with_effects(balanced, (effect,)), initial=InitialState(attitude=rest))
    for k in range(100):
        plant.read(k * balanced.tick)
    assert apart(plant.truth()["truth_attitude"].value[0, 0], rest) < 1e-10


def test_a_turn_whose_smallest_equal_is_out_of_bounds_stays_as_it_is(sads):
    wide = effect_named("wheel_misalignment")(target="w1", rotation=(-1.2, -1.5, 1.4))
    assert wide.least(sads) is wide
    slight = replace(wide, rotation=(0.2, 0.1, 0.0))
    assert np.linalg.norm(slight.least(sads).values) < np.linalg.norm(slight.values)
