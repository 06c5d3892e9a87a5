"""A step of the clock and a reset of the attitude are named and undone; a gap and a slew stay."""

from dataclasses import replace

import numpy as np
import pytest

from tests.seeds import seed_of
from twin import rotation
from twin.noise.cleaning import without_steps
from twin.recording import Recording, Series


@pytest.fixture
def log(request: pytest.FixtureRequest):
    """A body that turns to and fro, its gyro, attitude and a wheel; and where something happens."""
    seed = seed_of(request)
    draw = np.random.default_rng(seed)
    fine = np.arange(6000) / 100.0
    speed, phase = draw.uniform(0.2, 0.5, 3), draw.uniform(0.0, 6.28, 3)
    angles = 0.15 * np.sin(speed * fine[:, None] + phase)
    attitude = rotation.from_euler_zyx(*angles.T)
    turn = rotation.multiply(rotation.conjugate(attitude[:-1]), attitude[1:])
    rate = 100.0 * rotation.to_rotation_vector(turn)
    noisy = rotation.from_rotation_vector(draw.normal(0.0, 5e-4, (3000, 3)))
    streams = {
        "gyro": Series(
            fine[:-1] + 0.005, rate + draw.normal(0.0, 1e-3, rate.shape), tuple("xyz"), "rad/s"
        ),
        "attitude": Series(fine[::2], rotation.multiply(attitude[::2], noisy), tuple("wxyz"), "1"),
        "wheel_speed": Series(fine[::5], np.sin(fine[::5])[:, None], ("w1",), "rad/s"),
    }
    moving = np.linalg.norm(rate, axis=1)
    where = fine[1500 + int(np.argmax(moving[1500:4500]))]
    return draw, Recording(streams), float(where)


def _changed(recording: Recording, change) -> Recording:
    streams = {name: change(name, series) for name, series in recording.items()}
    return replace(recording, streams=streams)


def test_a_right_log_stays_as_it_is(log):
    _, recording, _ = log
    found, said = without_steps(recording)
    assert said == []
    assert found["attitude"].value.tobytes() == recording["attitude"].value.tobytes()


def test_a_clock_that_steps_is_named_and_set_back(log):
    draw, recording, where = log
    step = float(draw.uniform(1.0, 3.0))

    def late(name, series):
        return replace(series, time=np.where(series.time > where, series.time + step, series.time))

    found, said = without_steps(_changed(recording, late))
    (sentence,) = said
    assert f"the clock of all streams steps by {step:.3f} s"[:-4] in sentence
    for name, series in recording.items():
        np.testing.assert_allclose(found[name].time, series.time, atol=0.05)


def test_a_gap_in_which_the_body_went_on_is_no_step(log):
    draw, recording, where = log
    length = float(draw.uniform(1.0, 3.0))

    def lost(name, series):
        return series.only((series.time < where) | (series.time > where + length))

    assert without_steps(_changed(recording, lost))[1] == []


def test_an_attitude_that_is_reset_is_named_and_turned_back(log):
    draw, recording, where = log
    angle = float(draw.uniform(0.05, 1.0)) * draw.choice([-1.0, 1.0])
    reset = rotation.from_rotation_vector(np.array([0.0, 0.0, angle]))

    def turned(name, series):
        if name != "attitude":
            return series
        value = np.where(
            (series.time >= where)[:, None], rotation.multiply(reset, series.value), series.value
        )
        return replace(series, value=value)

    found, said = without_steps(_changed(recording, turned))
    (sentence,) = said
    assert float(sentence.split()[4]) == pytest.approx(np.degrees(angle), abs=0.1)
    back, right = found["attitude"].value, recording["attitude"].value
    off = 2.0 * np.arccos(np.clip(np.abs(np.sum(back * right, axis=1)), 0.0, 1.0))
    assert off.max() < 2e-3
    up = np.broadcast_to([0.0, 0.0, 1.0], back[:, 1:].shape)
    down, true = (rotation.rotate(rotation.conjugate(q), up) for q in (back, right))
    np.testing.assert_allclose(down, true, atol=1e-12, err_msg="gravity turned with the heading")


def test_a_leap_that_tilts_the_body_is_left_as_it_is(log):
    _, recording, where = log
    tilt = rotation.from_rotation_vector(np.array([0.3, 0.0, 0.0]))
    attitude = recording["attitude"]
    after = (attitude.time >= where)[:, None]
    value = np.where(after, rotation.multiply(tilt, attitude.value), attitude.value)
    streams = {**recording.streams, "attitude": replace(attitude, value=value)}
    assert without_steps(replace(recording, streams=streams))[1] == []


def test_a_slew_that_the_gyro_shows_is_no_reset(log):
    draw, recording, where = log
    del draw
    row = int(np.searchsorted(recording["gyro"].time, where))
    rate = recording["gyro"].value.copy()
    rate[row : row + 2] += [0.0, 0.0, 5.0]
    gyro = replace(recording["gyro"], value=rate)
    turn = rotation.from_rotation_vector(np.array([0.0, 0.0, 0.1]))
    attitude = recording["attitude"]
    after = attitude.time > recording["gyro"].time[row + 1]
    value = np.where(after[:, None], rotation.multiply(attitude.value, turn), attitude.value)
    streams = {**recording.streams, "gyro": gyro, "attitude": replace(attitude, value=value)}
    assert without_steps(replace(recording, streams=streams))[1] == []
