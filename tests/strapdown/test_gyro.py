"""A gyro's errors are found beside an attitude, whatever moves the body, with honest intervals."""

import json

import numpy as np
import pytest

from tests.seeds import seed_of
from twin import rotation
from twin.cli.main import main
from twin.errors import UsageError
from twin.library import library
from twin.recording import Recording, Series
from twin.strapdown import GyroComparison, compare_gyro
from twin.strapdown.compare import NAMES, chained, columns, corrected

BROAD = library("models") / "broad_imu" / "logs" / "slow_rotation"
XYZ, WXYZ = ("x", "y", "z"), ("w", "x", "y", "z")
USUAL = np.array([5e-3] * 3 + [5e-3] * 3 + [1e-2] * 3 + [3e-3] * 3 + [0.02])
"""1 sigma of the errors drawn, in the order of NAMES."""


def turned(
    draw: np.random.Generator,
    theta: np.ndarray,
    *,
    gyro_noise: float,
    attitude_noise: float,
    length: float = 90.0,
    amplitude: float = 0.5,
    about: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Recording:
    """A body that turns in a sum of sinusoids; gyro at 100 Hz, attitude at 50 Hz."""
    frequency, phase = draw.uniform(0.05, 0.4, (4, 3)), draw.uniform(0.0, 2.0 * np.pi, (4, 3))
    size = 0.5 * amplitude * draw.uniform(0.3, 1.0, (4, 3)) * about

    def rate(time: np.ndarray) -> np.ndarray:
        waves = np.sin(2.0 * np.pi * frequency * time[:, None, None] + phase)
        return np.sum(size * waves, axis=1)

    fine = np.arange(0.0, length, 1e-3)
    attitude = chained(rotation.from_rotation_vector(rate(fine + 0.5e-3) * 1e-3))[::20]
    attitude = rotation.multiply(
        attitude,
        rotation.from_rotation_vector(draw.normal(0.0, attitude_noise, (len(attitude), 3))),
    )
    time = np.arange(0.1, length - 0.1, 0.01)
    bias, scale, turn, skew, lag = np.split(theta, [3, 6, 9, 12])
    xy, xz, yz = skew
    gain = np.diag(scale) + np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])
    gain = gain @ rotation.matrix(rotation.from_rotation_vector(turn)).T
    shown = rate(time - lag) @ gain.T + bias + draw.normal(0.0, gyro_noise, (len(time), 3))
    return Recording(
        {
            "gyro": Series(time, shown, XYZ, "rad/s"),
            "attitude": Series(0.02 * np.arange(len(attitude)), attitude, WXYZ, "1"),
        }
    )


def test_columns_are_the_derivative_of_what_a_gyro_shows():
    draw = np.random.default_rng(1)
    rate, small = draw.normal(size=(20, 3)), 1e-6
    for place, column in enumerate(np.moveaxis(columns(rate, np.zeros((20, 3))), 2, 0)[:12]):
        theta = np.zeros(len(NAMES))
        theta[place] = small
        _, body = corrected(np.zeros(20), rate, theta)
        np.testing.assert_allclose((rate - body) / small, column, atol=1e-4)


def test_every_error_of_a_quiet_gyro_is_recovered():
    draw = np.random.default_rng(2)
    theta = USUAL * draw.choice([-2.0, 2.0], len(USUAL))
    found = compare_gyro(turned(draw, theta, gyro_noise=1e-5, attitude_noise=1e-5))
    np.testing.assert_allclose(found.value, theta, atol=2e-5)
    (_, raw, mended), *_ = found.drift
    assert mended < 0.01 * raw


def test_a_turned_away_attitude_is_not_needed_only_its_turns():
    draw = np.random.default_rng(3)
    log = turned(draw, USUAL, gyro_noise=1e-3, attitude_noise=1e-3)
    away = rotation.normalized(np.array([0.3, -0.5, 0.7, 0.1]))
    attitude = log["attitude"]
    value = -rotation.multiply(away[None], attitude.value)
    streams = {**log.streams, "attitude": Series(attitude.time, value, WXYZ, "1")}
    there, here = compare_gyro(Recording(streams)), compare_gyro(log)
    np.testing.assert_allclose(there.value, here.value, atol=1e-9)


def test_an_attitude_that_is_lost_for_a_while_is_found_again():
    draw = np.random.default_rng(4)
    log = turned(draw, USUAL, gyro_noise=1e-3, attitude_noise=1e-3)
    attitude = log["attitude"]
    seen = (attitude.time < 30.0) | (attitude.time > 36.0)
    kept = Series(attitude.time[seen], attitude.value[seen], WXYZ, "1")
    found = compare_gyro(Recording({**log.streams, "attitude": kept}))
    assert (np.abs(found.value - USUAL) < 2.0 * found.half_width).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gyro", "attitude", "amplitude"), [(1e-3, 1e-3, 0.1), (5e-3, 1e-3, 0.5), (4.4e-3, 3.5e-2, 0.2)]
)
def test_intervals_cover_the_truth_as_often_as_they_say(
    gyro, attitude, amplitude, request: pytest.FixtureRequest
):
    seed = seed_of(request)
    draw, missed = np.random.default_rng(seed), []
    for _ in range(18):
        theta = USUAL * draw.normal(size=len(USUAL))
        log = turned(draw, theta, gyro_noise=gyro, attitude_noise=attitude, amplitude=amplitude)
        found = compare_gyro(log)
        missed.append((found.value - theta) / found.half_width)
    covered, size = np.mean(np.abs(missed) <= 1.0), 1.96 * np.sqrt(np.mean(np.square(missed)))
    print("seed", seed, "covered", covered, "errors in sigmas", size)
    # 234 intervals of 95 % cover 0.95 +- 0.014, and 1 +- 0.05 of their sigma is used
    assert covered >= 0.90
    assert size >= 0.75, "wider than they need to be"


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_about_one_axis_tells_nothing_of_the_scales_of_the_others(axis):
    """The noise of an axis about which nothing turns is no excitation."""
    draw, theta = np.random.default_rng(axis), np.zeros(len(NAMES))
    theta[3 + axis] = 0.01
    log = turned(
        draw, theta, gyro_noise=2e-3, attitude_noise=1e-3, about=tuple(np.eye(3)[axis].tolist())
    )
    found = compare_gyro(log)
    scale = slice(3, 6)
    np.testing.assert_array_equal(np.isfinite(found.half_width[scale]), np.arange(3) == axis)
    assert abs(found.value[3 + axis] - 0.01) < found.half_width[3 + axis] < 0.01
    assert (np.abs(found.value[scale][np.arange(3) != axis]) < 1e-6).all()
    (_, raw, mended), *_ = found.drift
    assert mended < 1.05 * raw


def test_streams_that_do_not_show_the_same_motion_are_refused():
    first, other = (
        turned(draw, USUAL, gyro_noise=1e-3, attitude_noise=1e-3, length=45.0)
        for draw in map(np.random.default_rng, (6, 7))
    )
    mixed = Recording({"gyro": first["gyro"], "attitude": other["attitude"]})
    with pytest.raises(UsageError, match="do not show the same motion"):
        compare_gyro(mixed)


def test_without_an_attitude_there_is_nothing_to_hold_a_gyro_against():
    log = turned(np.random.default_rng(5), USUAL, gyro_noise=1e-3, attitude_noise=1e-3)
    with pytest.raises(UsageError, match="no gyro about x, y and z beside an attitude"):
        compare_gyro(Recording({"gyro": log["gyro"]}))


def test_the_shipped_log_says_what_is_wrong_with_its_gyro(capsys, monkeypatch):
    kept: list[GyroComparison] = []

    def once(log: Recording) -> GyroComparison:
        kept[:] = kept or [compare_gyro(log)]
        return kept[0]

    monkeypatch.setattr("twin.strapdown.compare_gyro", once)
    assert main(["compare", str(BROAD)]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"{BROAD}, on no platform\n")
    assert "gyro_bias: it shows too much by x 0.2" in text
    assert "the two do not show" in text
    assert main(["compare", str(BROAD), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["gyro_against_attitude"]
    lag = found["parameters"]["clock_lag"]
    assert 2e-3 < lag["low"][0] < lag["high"][0] < 6e-3
    ten = next(one for one in found["alone"] if one["horizon"] == 10.0)
    assert ten["corrected"] < 0.2 * ten["as_it_is"]


def test_a_report_needs_a_model(tmp_path, capsys):
    assert main(["compare", str(BROAD), "--report", str(tmp_path / "a.html")]) == 2
    assert "names no platform has no prediction to draw" in capsys.readouterr().err
