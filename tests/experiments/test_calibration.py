"""Calibrations recover what a sensor was given, with intervals that hold 95 times in 100."""

import shutil

import numpy as np
import pytest

from twin import TwinError, calibrate, load
from twin.cli.main import main
from twin.experiments.calibration import corrected
from twin.library import library
from twin.recording import Recording, Series

RATE = 50.0
BIAS, SCALE = np.array([0.2, -0.1, 0.3]), np.array([0.02, -0.01, 0.005])
SKEW = np.array([0.004, -0.006, 0.002])


def recording(**streams: np.ndarray) -> Recording:
    units = {"gyro": "rad/s", "accelerometer": "m/s^2", "magnetometer": "T"}
    series = {
        name: Series(np.arange(len(value)) / RATE, value, ("x", "y", "z"), units[name])
        for name, value in streams.items()
    }
    return Recording(series, {"source": "drawn"})


def shown(truth: np.ndarray, bias: np.ndarray, skew: np.ndarray = SKEW) -> np.ndarray:
    matrix = np.diag(1.0 + SCALE)
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), skew, strict=True):
        matrix[i, j] = matrix[j, i] = value
    return truth @ matrix.T + bias


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    unit = rng.standard_normal((count, 3))
    return unit / np.linalg.norm(unit, axis=1, keepdims=True)


def poses(rng: np.random.Generator, count: int, error: float) -> Recording:
    """An accelerometer in so many poses, moved by hand between them, bent by a model error."""
    still = shown(9.81 * directions(rng, count), BIAS)
    still = still + error * rng.standard_normal(still.shape)
    rows = []
    for pose in still:
        rows += [np.repeat(pose[None], 100, axis=0), pose + 5.0 * rng.standard_normal((50, 3))]
    value = np.concatenate(rows)
    return recording(accelerometer=value + 0.01 * rng.standard_normal(value.shape))


def turning(rng: np.random.Generator, seconds: float) -> np.ndarray:
    """(m, 3) unit vectors that wander over the sphere."""
    time = np.arange(round(seconds * RATE)) / RATE
    phase = rng.uniform(0.0, 2.0 * np.pi, 2)
    lift = np.sin(0.37 * time + phase[0]) * 1.4
    turn = 0.9 * time + phase[1]
    flat = np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.cos(lift)[:, None]
    return np.column_stack([flat, np.sin(lift)])


def covered(kind: str, draw, count: int) -> float:
    truth = {f"bias_{a}": b for a, b in zip("xyz", BIAS, strict=True)}
    truth |= {f"scale_error_{a}": s for a, s in zip("xyz", SCALE, strict=True)}
    if kind == "magnetometer":
        truth = {k: v * (1e-5 if k.startswith("bias") else 1.0) for k, v in truth.items()}
    held = []
    for seed in range(count):
        result = calibrate(kind, draw(np.random.default_rng(seed)), field=5e-5)
        held += [result.number(name).holds(value) for name, value in truth.items()]
    return float(np.mean(held))


def test_an_accelerometer_s_intervals_hold_95_times_in_100():
    assert 0.90 <= covered("accelerometer", lambda rng: poses(rng, 20, 0.005), 40) <= 0.98


def test_a_magnetometer_s_intervals_hold_95_times_in_100():
    def draw(rng: np.random.Generator) -> Recording:
        value = shown(5e-5 * turning(rng, 100.0), 1e-5 * BIAS)
        return recording(magnetometer=value + 3e-7 * rng.standard_normal(value.shape))

    assert 0.90 <= covered("magnetometer", draw, 40) <= 0.98


def test_six_poses_along_the_axes_give_bias_and_scale_exactly():
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    value = np.repeat(shown(9.81 * axes, BIAS, np.zeros(3)), 100, axis=0)
    rng = np.random.default_rng(1)
    result = calibrate(
        "accelerometer", recording(accelerometer=value + 1e-4 * rng.standard_normal(value.shape))
    )
    for axis, bias, scale in zip("xyz", BIAS, SCALE, strict=True):
        assert result.number(f"bias_{axis}").value == pytest.approx(bias, abs=1e-4)
        assert result.number(f"scale_error_{axis}").value == pytest.approx(scale, abs=1e-5)
    assert any("no further pose checks the fit" in remark for remark in result.remarks)


def test_a_correction_undoes_what_the_sensor_did():
    truth = directions(np.random.default_rng(2), 10)
    numbers = np.concatenate([BIAS, SCALE, SKEW])
    np.testing.assert_allclose(corrected(shown(truth, BIAS), numbers), truth, atol=1e-12)


def test_a_gyro_at_rest_shows_its_random_walk_and_whole_turns_its_scale():
    rng, parts = np.random.default_rng(3), []
    for axis in np.eye(3):
        parts += [np.zeros((1500, 3)), np.repeat(2.0 * np.pi / 4.0 * axis[None], 200, axis=0)]
    value = np.concatenate([*parts, np.zeros((1500, 3))]) * (1.0 + SCALE) + 0.01 * BIAS
    noise = 1e-3
    log = recording(gyro=value + noise * rng.standard_normal(value.shape))
    result = calibrate("gyro", log)
    for axis, bias, scale in zip("xyz", BIAS, SCALE, strict=True):
        assert result.number(f"bias_{axis}").holds(0.01 * bias)
        walk = result.number(f"random_walk_{axis}")
        assert walk.holds(noise / np.sqrt(RATE))
        assert result.number(f"scale_error_{axis}").holds(scale)


def test_a_calibration_is_part_of_the_platform_whose_folder_holds_it(tmp_path):
    log = poses(np.random.default_rng(4), 20, 0.005)
    folder = tmp_path / "table"
    shutil.copytree(library("models") / "cubesat", folder)
    calibrate("accelerometer", log).write(folder / "calibration.toml")
    stated = {effect.name: effect for effect in load(folder).effects}
    assert set(stated) >= {"accelerometer_bias", "accelerometer_scale"}
    (folder / "calibration.toml").write_text("[effects.gyro_bia]\nbias = [0, 0, 0]\n")
    assert main(["run", str(folder), "--duration", "1"]) != 0


@pytest.mark.parametrize(
    ("kind", "value", "sentence"),
    [
        ("accelerometer", np.ones((2000, 3)), "1 poses at rest|0 poses at rest"),
        ("magnetometer", np.ones((500, 3)), "needs 15"),
        ("magnetometer", np.ones((5000, 3)), "too little"),
        ("barometer", np.ones((10, 3)), "give one of gyro, accelerometer, magnetometer"),
    ],
)
def test_logs_that_do_not_show_it_are_refused_with_what_would_do(kind, value, sentence):
    name = kind if kind in ("accelerometer", "magnetometer") else "gyro"
    drawn = value + 1e-6 * np.random.default_rng(0).standard_normal(value.shape)
    with pytest.raises(TwinError, match=sentence):
        calibrate(kind, recording(**{name: drawn}))


def test_a_field_of_no_constant_length_is_refused():
    rng = np.random.default_rng(6)
    value = 5e-5 * turning(rng, 60.0) + np.linspace(0.0, 2e-3, 3000)[:, None] * [1.0, 0.3, 0.2]
    with pytest.raises(TwinError, match="lie on no ellipsoid|too little"):
        calibrate("magnetometer", recording(magnetometer=value))
