"""What a sensor or a drive does to a series, and that it can be undone."""

from dataclasses import replace

import numpy as np
import pytest

from twin.effects import SeriesEffect, catalogue, effect_named, series_effects
from twin.effects.effect import targets
from twin.platform import Platform, Sensor, load_platform
from twin.rotation import from_rotation_vector, multiply, normalized, to_rotation_vector
from twin.signals import STREAMS, Samples

SERIES = [kind for kind in catalogue() if issubclass(kind, SeriesEffect)]
OTHERS = {
    "inclinometer": 2,
    "accelerometer": 3,
    "magnetometer": 3,
    "gimbal_angle": 3,
    "gas_pressure": 1,
}
MANY_TO_ONE = ("stage_backlash", "gimbal_backlash", "gimbal_friction")
"""Within a play, or against friction, many commands end in one motion."""


@pytest.fixture(scope="module")
def equipped(sads: Platform) -> Platform:
    """With the sensors and the parts that some effects act on."""
    more = {name: Sensor(name, 20.0, np.zeros(k), np.zeros(k)) for name, k in OTHERS.items()}
    return replace(
        sads,
        sensors={**sads.sensors, **more},
        base=replace(sads.base, kind="hinge", joint="pivot", actuator="motor"),
        gimbals=load_platform("tas2").gimbals,
        magnetorquers=load_platform("cubesat").magnetorquers,
        gas=load_platform("astros").gas,
    )


def aimed(kind: type[SeriesEffect], platform: Platform) -> SeriesEffect:
    """At its typical size."""
    known = targets(kind.takes, platform)
    return kind.typical("wheel_speed" if "wheel_speed" in known else "")


def smooth(stream: str, platform: Platform, seed: int = 0) -> Samples:
    """A smooth series of two runs, at 50 Hz with a gap."""
    generator = np.random.default_rng(seed)
    time = np.delete(np.arange(400) / 50.0, slice(100, 130))
    width = 3 if stream == "attitude" else len(platform.columns(stream))
    size = 0.2 if STREAMS[stream].unit in ("rad", "1") else 1.0
    wave = generator.uniform(0.1, 1.0, (2, 1, width)) * size
    phase = generator.uniform(0.0, 6.0, (2, 1, width))
    value = wave * np.sin(2.0 * np.pi * 0.3 * time[:, None] + phase)
    if stream == "attitude":
        value = multiply(normalized(np.array([0.9, 0.1, -0.2, 0.3])), from_rotation_vector(value))
    stamps = np.broadcast_to(time, (2, len(time)))
    return Samples(value, stamps, np.ones(stamps.shape, dtype=np.bool_))


def apart(stream: str, one: np.ndarray, other: np.ndarray) -> float:
    if stream == "attitude":
        turn = multiply(other * np.array([1.0, -1.0, -1.0, -1.0]), one)
        return float(np.abs(to_rotation_vector(turn)).max())
    return float(np.abs(one - other).max() / np.abs(other).max())


@pytest.mark.parametrize("kind", SERIES, ids=lambda kind: kind.name)
def test_what_a_machine_shows_can_be_undone(kind, equipped, agrees):
    effect = aimed(kind, equipped)
    true = smooth(effect.stream, equipped)
    shown = effect.apply(true, equipped)
    again = effect.undo(shown, equipped)
    if kind.name in MANY_TO_ONE:
        again, true = effect.apply(again, equipped), shown
    left = apart(effect.stream, again.value, true.value)
    left = max(left, float(np.abs(again.time - true.time).max()))
    agrees(kind.name, left, 1e-12)
    changed = apart(effect.stream, shown.value, smooth(effect.stream, equipped).value) > 1e-9
    assert changed or np.any(shown.time != true.time), "at its typical size it does nothing"


@pytest.mark.parametrize("kind", SERIES, ids=lambda kind: kind.name)
def test_what_is_done_first_can_be_done_last(kind, equipped):
    effect = aimed(kind, equipped)
    shown = smooth(effect.stream, equipped)
    true = effect.undo(shown, equipped)
    again = effect.apply(true, equipped)
    assert apart(effect.stream, again.value, shown.value) < 1e-12
    np.testing.assert_allclose(again.time, shown.time, atol=1e-12)


@pytest.mark.parametrize("kind", SERIES, ids=lambda kind: kind.name)
def test_a_stream_that_comes_in_pieces_becomes_the_same(kind, equipped):
    effect = aimed(kind, equipped)
    true = smooth(effect.stream, equipped)
    live = effect.live(equipped)
    pieces = [
        live(Samples(true.value[:, a:b], true.time[:, a:b], true.valid[:, a:b]))
        for a, b in ((0, 1), (1, 7), (7, 7), (7, 370))
    ]
    value = np.concatenate([piece.value for piece in pieces], axis=1)
    np.testing.assert_array_equal(value, effect.apply(true, equipped).value)


def test_effects_act_in_the_order_that_the_design_states(equipped):
    names = ("clock_lag", "sensor_lag", "gyro_bias", "gyro_scale_factor", "gyro_misalignment")
    effects = [
        effect_named(name).typical("gyro" if effect_named(name).takes else "") for name in names
    ]
    assert [one.name for one in series_effects(effects, "gyro")] == list(reversed(names))


def test_a_low_pass_forgets_a_step_exponentially(equipped):
    effect = effect_named("sensor_lag")(constant=0.5, target="gyro")
    time = np.concatenate([[0.0, 1e-9], np.linspace(0.05, 3.0, 60)])
    value = np.ones((1, len(time), 3))
    value[:, 0] = 0.0
    samples = Samples(value, time[None], np.ones((1, len(time)), dtype=np.bool_))
    shown = effect.apply(samples, equipped).value[0, :, 0]
    np.testing.assert_allclose(shown, 1.0 - np.exp(-time / 0.5), atol=1e-8)


def test_an_askew_inclinometer_reads_the_elevation_of_its_own_axes(equipped):
    effect = effect_named("inclinometer_misalignment")(rotation=(0.1, -0.05, 0.3))
    level = Samples(np.zeros((1, 1, 2)), np.zeros((1, 1)), np.ones((1, 1), dtype=np.bool_))
    roll, pitch = effect.apply(level, equipped).value[0, 0]
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([0.1, -0.05, 0.3]).as_matrix()  # the sensor's axes as columns
    assert roll == pytest.approx(np.arcsin(turn[2, 1]), abs=1e-12)
    assert pitch == pytest.approx(-np.arcsin(turn[2, 0]), abs=1e-12)


def test_a_gimbal_waits_for_its_gear_after_a_reversal(equipped):
    effect = effect_named("gimbal_backlash")(width=0.02)
    tick = equipped.tick
    rate = np.repeat([0.1, -0.1], 40)[None, :, None] * np.ones(3)
    stamps = tick * np.arange(80)[None]
    samples = Samples(rate, stamps, np.ones(stamps.shape, dtype=np.bool_))
    turned = tick * np.cumsum(effect.apply(samples, equipped).value[0, :, 0])
    gear = tick * np.cumsum(rate[0, :, 0])
    # up on one side of the play, down on the other, in between it stands
    assert turned[39] == pytest.approx(gear[39] - 0.01, abs=1e-12)
    np.testing.assert_allclose(turned[40:43], turned[39], atol=1e-12)
    assert turned[-1] == pytest.approx(gear[-1] + 0.01, abs=1e-12)


def test_friction_stops_a_gimbal_that_is_told_to_creep(equipped):
    effect = effect_named("gimbal_friction")(torque=0.1, stiffness=10.0, target="g2")
    rate = np.array([[[0.005, 0.005, 0.5], [0.005, -0.3, 0.005]]])
    samples = Samples(rate, np.zeros((1, 2)), np.ones((1, 2), dtype=np.bool_))
    shown = effect.apply(samples, equipped).value
    np.testing.assert_allclose(shown, [[[0.005, 0.0, 0.5], [0.005, -0.29, 0.005]]], atol=1e-15)
