"""Effects that a body's prediction does not see are found again by simulating anew.

Of sensors that no prediction uses, drives between command and motion, gimbals, coils, thrusters.
`pytest -m slow tests/effects/test_refit.py -s` prints truth, estimate and interval of each.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from twin.contrast import EDGE, difference, moved, undisturbed
from twin.effects import Effect, able, effect_named, parse_effects
from twin.platform import Platform, Sensor, load_platform
from twin.recording import Recording

SEED = 20261121
SECONDS = 10.0
LOUD = 20.0
"""An effect is hidden with at least so many of its own standard deviations."""
NOISELESS = 1e-7
"""1 sigma taken of a sensor that states none [SI]."""
STEP = 1e-3
"""Of finite differences, of a component's scale."""

HIDDEN = {
    "stage_scale:s1": "sads",
    "stage_step_loss:s2": "sads",
    "stage_backlash:s3=2e-4": "sads",
    "wheel_imbalance:w3=1e-6/3e-5": "sads",  # at the usual sizes the static part hides the other
    "accelerometer_bias": "tas2",
    "accelerometer_scale": "tas2",
    "inclinometer_bias": "tas2",
    "inclinometer_misalignment": "tas2",
    "magnetometer_bias": "tas2",
    "magnetometer_scale": "tas2",
    "gimbal_offset:g1": "tas2",
    "gimbal_friction:g2": "tas2",
    "gimbal_backlash:g3": "tas2",
    "gimbal_center_of_mass_offset:g1": "tas2",
    "magnetorquer_gain": "cubesat",
    "joint_torque_gain": "dfki_pendulum",
    "joint_torque_delay": "dfki_pendulum",
    "encoder_error": "dfki_pendulum",
    "thruster_misalignment": "whorl1",
    "gas_consumption": "astros",
}
SCATTERED = ("stage_vibration",)
"""Found by how much more a sensor scatters."""
QUICK = ("gimbal_offset:g1",)


def residual(platform: Platform, measured: Recording, predicted: Recording) -> np.ndarray:
    """(m,) measured less predicted over noise, all streams in a row."""
    parts = []
    for stream, sensor in platform.sensors.items():
        if stream not in measured:
            continue
        time = measured[stream].time
        time = time[(time > EDGE) & (time < SECONDS - EDGE)]
        apart = difference(stream, predicted[stream], measured[stream], time)
        parts.append((apart / np.maximum(sensor.noise, NOISELESS)).ravel())
    return np.concatenate(parts)


def scattering(sensor: Sensor) -> Sensor:
    """Without a constant error, its grid made a scatter: rounding repeats its error at rest."""
    noise = np.hypot(sensor.noise, sensor.resolution / np.sqrt(12.0))
    return replace(sensor, bias=0.0 * sensor.bias, noise=noise, resolution=0.0)


def slopes(platform: Platform, effect: Effect, measured: Recording, now: np.ndarray) -> np.ndarray:
    """(m, p) d residual / d values, by differences."""
    columns = []
    _, high = effect.bounds()
    for i, size in enumerate(STEP * np.maximum(effect.scale(), np.abs(effect.values))):
        values = effect.values
        step = size if values[i] + size <= high[i] else -size
        values[i] += step
        there = moved(undisturbed(platform), (effect.with_values(values),), SECONDS)
        columns.append((residual(platform, measured, there) - now) / step)
    return np.stack(columns, axis=1)


def loud(platform: Platform, effect: Effect, without: Recording) -> Effect:
    """Of a drawn size near the usual one, or as much larger as it takes to show."""
    generator = np.random.default_rng(SEED)
    effect = effect.with_values(effect.values * generator.uniform(0.5, 1.5, len(effect.values)))
    there = moved(undisturbed(platform), (effect,), SECONDS)
    shown = float(np.linalg.norm(residual(platform, there, without)))
    low, high = effect.bounds()
    return effect.with_values(np.clip(effect.values * max(1.0, LOUD / shown), low, high))


@pytest.mark.parametrize(
    "text", [pytest.param(t, marks=() if t in QUICK else pytest.mark.slow) for t in HIDDEN]
)
def test_a_hidden_effect_is_found_to_within_its_interval(text):
    (effect,) = parse_effects(text)
    platform = able(replace(load_platform(HIDDEN[text]), effects=()), effect)
    sensors = {name: scattering(sensor) for name, sensor in platform.sensors.items()}
    platform = replace(platform, sensors=sensors, tilt_limit=np.pi)
    truth = loud(platform, effect, moved(undisturbed(platform), (), SECONDS))
    measured = moved(platform, (truth,), SECONDS, seed=SEED)
    found = truth.with_values(0.9 * truth.values)
    low, high = truth.bounds()
    for _ in range(4):
        now = residual(platform, measured, moved(undisturbed(platform), (found,), SECONDS))
        matrix = slopes(platform, found, measured, now)
        step = -np.linalg.lstsq(matrix, now, rcond=None)[0]
        found = found.with_values(np.clip(found.values + step, low, high))
        information = matrix.T @ matrix
        if step @ information @ step < 1e-2:
            break
    error = found.values - truth.values
    sigma = np.sqrt(np.diag(np.linalg.inv(information)))
    for name, true, value, one in zip(truth.names, truth.values, found.values, sigma, strict=True):
        inside = "" if abs(value - true) < 1.96 * one else "  outside"
        print(f"{truth.label} {name}: {true:.4g}, found {value:.4g} +- {1.96 * one:.2g}{inside}")
    distance = float(error @ information @ error)
    print(f"{truth.label}: chi-square {distance:.1f} of {len(error)}, seed {SEED}")
    assert distance < chi2.ppf(0.999, len(error)), "found, but not where its interval says"
    assert np.max(np.abs(truth.values) / sigma) > 5.0, "its interval says nothing"


@pytest.mark.slow
def test_shaking_is_found_by_how_much_more_the_gyro_scatters():
    quiet = undisturbed(load_platform("sads"))
    effect = effect_named(*SCATTERED).typical()
    shaken, still = (moved(quiet, one, SECONDS, seed=SEED) for one in ((effect,), ()))
    gyro = shaken["gyro"]
    speed = np.linalg.norm(still["truth_stage_speed"].interpolated_at(gyro.time), axis=1)
    moving = speed > 1e-4
    ratio = (gyro.value - still["gyro"].value)[moving] / speed[moving, None]
    found, interval = np.sqrt(np.mean(np.square(ratio))), 1.96 / np.sqrt(2.0 * ratio.size)
    print(f"stage_vibration gain: {effect.gain:g}, found {found:.4g} +- {found * interval:.2g}")
    assert found == pytest.approx(effect.gain, rel=1.7 * interval)
