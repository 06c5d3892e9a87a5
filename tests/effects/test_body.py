"""Effects on the machine against closed forms and against an independent integration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad_vec, solve_ivp

from tests.effects.motion import apart, flown, integrated
from twin.effects import State, effect_named, parse_effects, with_effects
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.rotation import (
    conjugate,
    from_rotation_vector,
    multiply,
    rotate,
    to_rotation_vector,
    vertical_body,
)

SPIN = InitialState(rate_body=np.array([0.0, 0.0, 0.3]))
TUMBLE = InitialState(
    attitude=from_rotation_vector(np.array([0.05, -0.04, 0.4])),
    rate_body=np.array([0.004, -0.003, 0.1]),
)
SECONDS = 60.0


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.max(np.abs(found / expected - 1.0)))


def about_z(platform):
    return platform.inertia[2, 2] - platform.wheels[2].inertia


def test_viscous_friction_lets_a_spin_decay_exponentially(balanced, agrees):
    effect = effect_named("bearing_viscous_friction")(damping=0.5)
    time, _, rate = flown(balanced, (effect,), SECONDS, SPIN)
    expected = 0.3 * np.exp(-0.5 * time / about_z(balanced))
    agrees("bearing_viscous_friction: exponential decay", relative(rate[:, 2], expected), 1e-12)


def test_dry_friction_lets_a_spin_fall_linearly_and_stop(balanced, agrees):
    effect = effect_named("bearing_coulomb_friction")(torque_size=0.1)
    time, _, rate = flown(balanced, (effect,), SECONDS, SPIN)
    expected = np.maximum(0.3 - 0.1 * time / about_z(balanced), 0.0)
    error = np.abs(rate[:, 2] - expected).max()
    agrees("bearing_coulomb_friction: linear decay, then rest", error, 2e-4, "rad/s")


@pytest.mark.parametrize("length", [0.0, 1e-9, 1e-4, 1.0])
def test_dry_friction_over_a_step_is_the_mean_of_what_it_is_at_every_instant(balanced, length):
    rng = np.random.default_rng(20261129)
    law = effect_named("bearing_coulomb_friction")(torque_size=0.1, smoothing=1e-3).torque(balanced)
    rate, change = rng.normal(0.0, 1e-3, (40, 3)), length * rng.standard_normal((40, 3))
    rate[:4] = 0.5 * change[:4]  # from rest
    state = State(np.zeros((40, 4)), rate, np.zeros((40, 0)), np.zeros(40))
    found = law(replace(state, change=change))

    def at(share: float) -> np.ndarray:
        return law(replace(state, rate=rate + share * change))

    whole, _ = quad_vec(at, -0.5, 0.5, epsabs=1e-12, limit=10_000)
    np.testing.assert_allclose(found, whole, atol=1e-9)


# the law is first carried on to a step's middle in the second step of a run
@pytest.mark.parametrize(("variant", "tolerance"), [("axes", 1e-12), ("norm", 2e-6)])
def test_drag_lets_a_spin_decay_hyperbolically(balanced, variant, tolerance, agrees):
    effect = effect_named("aerodynamic_drag")(drag=5.0, variant=variant)
    time, _, rate = flown(balanced, (effect,), SECONDS, SPIN)
    expected = 0.3 / (1.0 + 5.0 * 0.3 * time / about_z(balanced))
    error = relative(rate[:, 2], expected)
    agrees(f"aerodynamic_drag, {variant}: hyperbolic decay", error, tolerance)


WEIGHT, FIELD = np.array([0.0, 0.0, -9.81]), np.array([2.2e-5, 0.0, -4.2e-5])


def _swirl(k):
    return lambda t, q, w: k * vertical_body(q)


def _dipole(m):
    return lambda t, q, w: np.cross(m, rotate(conjugate(q), FIELD))


def _drift(rate):
    return lambda t, q, w: np.cross(np.array(rate) * t, rotate(conjugate(q), WEIGHT))


def _draft(point, force, frequency, phase):
    def torque(t, q, w):
        push = np.array(force) * np.sin(2.0 * np.pi * frequency * t + phase)
        return np.cross(point, rotate(conjugate(q), push))

    return torque


def _harness(k):
    def torque(t, q, w):
        return -k * to_rotation_vector(multiply(conjugate(TUMBLE.attitude), q))

    return torque


def _sag(k):
    def torque(t, q, w):
        g = rotate(conjugate(q), WEIGHT)
        return np.cross(k * np.array([g[0], g[1], 0.0]), g)

    return torque


def _dry(c):
    return lambda t, q, w: -c * w / np.sqrt(w @ w + 1e-8)


def _viscous(c):
    return lambda t, q, w: -c * w


def _drag(b):
    return lambda t, q, w: -b * np.abs(w) * w


CASES = {
    "bearing_viscous_friction": ((0.5,), _viscous(0.5), 2e-10),
    "bearing_coulomb_friction": ((0.01,), _dry(0.01), 2e-7),
    "aerodynamic_drag": ((2.0,), _drag(2.0), 2e-10),
    "bearing_swirl_torque": ((3e-3,), _swirl(3e-3), 2e-10),
    "residual_dipole": ((30.0, -20.0, 50.0), _dipole([30.0, -20.0, 50.0]), 2e-10),
    "center_of_mass_drift": ((2e-5, -1e-5, 4e-5), _drift([2e-5, -1e-5, 4e-5]), 2e-8),
    "room_draft": (
        (0.1, 0.2, 0.3, 0.01, -0.02, 0.01, 0.2, 0.5),
        _draft([0.1, 0.2, 0.3], [0.01, -0.02, 0.01], 0.2, 0.5),
        2e-7,
    ),
    "harness_stiffness": ((0.05,), _harness(0.05), 2e-10),
    "structural_sag": ((1e-4,), _sag(1e-4), 2e-7),
}
"""Values, the torque written down a second time, and how far apart the attitudes may be [rad]."""


@pytest.mark.parametrize("name", CASES)
def test_tumbling_under_an_effect_agrees_with_an_independent_integration(sads, name, agrees):
    values, torque, tolerance = CASES[name]
    kind = effect_named(name)
    effect = kind(**kind.named(values))
    _, attitude, rate = flown(sads, (effect,), SECONDS, TUMBLE)
    expected, expected_rate = integrated(sads, torque, SECONDS, TUMBLE)
    without, _ = integrated(sads, lambda t, q, w: np.zeros(3), SECONDS, TUMBLE)
    error = apart(expected, attitude[-1])
    agrees(f"{name}: attitude after 60 s of tumbling, against DOP853", error, tolerance, "rad")
    np.testing.assert_allclose(rate[-1], expected_rate, atol=tolerance)
    assert apart(expected, without) > 1e4 * tolerance, "the case would not show the effect"


def test_an_appendage_rings_faster_than_with_the_bus_held_fast(balanced, agrees):
    kind = effect_named("flexible_appendage")
    effect = kind(frequency=1.0, damping_ratio=0.0, inertia=2.0, axis=(0.0, 0.0, 0.5))
    platform = replace(balanced, sensors={})
    time, _, rate = _rung(platform, effect)
    share = effect.inertia / about_z(platform)
    turn = 2.0 * np.pi / np.sqrt(1.0 - share)
    # the bus starts alone at rate w0; the mean is that of both together
    expected = 0.3 * (1.0 - share) + 0.3 * share * np.cos(turn * time)
    error = np.abs(rate[:, 2] - expected).max()
    agrees("flexible_appendage: ringing of two inertias on a spring", error, 2e-6, "rad/s")


def _rung(platform, effect):
    """The bus turns at first, the appendage stands still in the room."""
    plant = SimulatedPlant(with_effects(platform, (effect,)), initial=SPIN)
    joint = plant.machine.model.joint(effect.label)
    plant._batch.bind("qvel")[:, joint.dofadr[0]] = -0.3
    rates = []
    for k in range(round(10.0 / platform.tick) + 1):
        plant.read(k * platform.tick)
        rates.append(plant.truth()["truth_rate"].value[0, 0])
    return np.arange(len(rates)) * platform.tick, None, np.array(rates)


def test_sloshing_liquid_moves_as_lagrange_says(sads, agrees):
    mass, length, height = 3.0, 0.2, 0.4
    effect = effect_named("liquid_slosh")(
        mass=mass, length=length, damping_ratio=0.01, pivot=(0.0, 0.0, -height)
    )
    damping = 2.0 * 0.01 * mass * length**1.5 * np.sqrt(sads.gravity)
    hanging = replace(sads, center_of_mass_offset=np.array([0.0, 0.0, -1.5]))
    start = InitialState(attitude=from_rotation_vector(np.array([0.2, 0.0, 0.0])))
    _, attitude, rate = flown(hanging, (effect,), 10.0, start)

    arm = hanging.inertia[0, 0] - hanging.wheels[0].inertia - mass * (height + length) ** 2
    moment = 1.5 - mass * (height + length)  # of what does not slosh, below the CR
    g = hanging.gravity

    def slope(_, y):
        """Angles of body and liquid from the vertical: a double pendulum."""
        body, liquid, body_rate, liquid_rate = y
        apart = body - liquid
        coupling = mass * height * length * np.cos(apart)
        matrix = [[arm + mass * height**2, coupling], [coupling, mass * length**2]]
        spin = mass * height * length * np.sin(apart)
        brake = damping * (body_rate - liquid_rate)
        torque = [
            -spin * liquid_rate**2 - (moment + mass * height) * g * np.sin(body) - brake,
            spin * body_rate**2 - mass * length * g * np.sin(liquid) + brake,
        ]
        return [body_rate, liquid_rate, *np.linalg.solve(matrix, torque)]

    done = solve_ivp(slope, (0.0, 10.0), [0.2, 0.2, 0.0, 0.0], "DOP853", rtol=1e-11, atol=1e-12)
    error = abs(to_rotation_vector(attitude[-1])[0] - done.y[0, -1])
    agrees("liquid_slosh: double pendulum by Lagrange, against DOP853", error, 3e-7, "rad")
    assert rate[-1, 0] == pytest.approx(done.y[2, -1], abs=1e-5)


def test_a_run_of_many_moves_as_one_alone(sads):
    effects = parse_effects("bearing_coulomb_friction=0.01,room_draft,residual_dipole,gyro_bias")
    alone = SimulatedPlant(with_effects(sads, effects), runs=(2, 2), initial=TUMBLE, seed=1)
    among = SimulatedPlant(with_effects(sads, effects), runs=range(5), initial=TUMBLE, seed=1)
    for k in range(40):
        one, many = (plant.read(k * sads.tick).streams for plant in (alone, among))
        for stream, samples in one.items():
            np.testing.assert_array_equal(samples.value[0], many[stream].value[2])


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (  # the length of the axis
            "flexible_appendage=2/0.01/0.05/0.3/0.2/0.4",
            "flexible_appendage=2/0.01/0.05/0.6/0.4/0.8",
        ),
        (  # force and arm, their product the same
            "room_draft=0.1/0.05/0.3/6e-4/2e-4/1e-4/0.05/0.5",
            "room_draft=0.2/0.1/0.6/3e-4/1e-4/5e-5/0.05/0.5",
        ),
        (  # a turn about the wheel's own axis
            "wheel_misalignment:w2=3e-3/0/5e-3",
            "wheel_misalignment:w2=3e-3/5e-4/5e-3",
        ),
    ],
)
def test_what_no_log_can_show_of_an_effect_moves_nothing(sads, one, other):
    ends = [flown(sads, parse_effects(text), 2.0, TUMBLE) for text in (one, other)]
    apart_from_none = flown(sads, (), 2.0, TUMBLE)
    changed = np.abs(ends[0][2] - apart_from_none[2]).max()
    assert np.abs(ends[0][2] - ends[1][2]).max() < 1e-3 * changed
