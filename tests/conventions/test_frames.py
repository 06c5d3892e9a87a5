"""A frame of the whole log is one mistake, and what two streams can show is checked."""

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.conventions.flights import flights, misread
from tests.seeds import seed_of
from twin import rotation
from twin.conventions import check_conventions, convention_advice, corrected
from twin.conventions.correction import axes_change
from twin.conventions.search import brings_together
from twin.platform import Platform, load_platform
from twin.recording import Recording, Series

Z_DOWN = np.array([1.0, -1.0, -1.0])
NED = "Attitude, gyro and accelerometer are in axes with z down (NED, FRD)."


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


@pytest.fixture(scope="module")
def drawn(request: pytest.FixtureRequest) -> np.random.Generator:
    seed = seed_of(request)
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def right_logs(sads, drawn) -> list[Recording]:
    """Flights with an accelerometer that has a bias."""
    cells = [("middle", "multisine"), ("fine", "unstable"), ("middle", "hanging")]
    logs = [log for cell in cells for log in flights(sads, drawn, *cell, 1)]
    return [with_accelerometer(log, drawn) for log in logs]


def with_accelerometer(log: Recording, draw: np.random.Generator) -> Recording:
    """What a sensor at the centre of rotation feels, with noise and a bias."""
    attitude = log["attitude"]
    up = 9.81 * rotation.vertical_body(attitude.value)
    felt = up + draw.normal(0.0, 0.02, up.shape) + draw.normal(0.0, 0.05, 3)
    series = Series(attitude.time, felt, ("x", "y", "z"), "m/s^2")
    return dataclasses.replace(log, streams={**log.streams, "accelerometer": series})


def with_z_down(log: Recording) -> Recording:
    """The log of a lab whose world and body axes have z down."""
    for name in ("gyro", "accelerometer"):
        if name in log:
            log = misread(log, name, value=log[name].value * Z_DOWN)
    return misread(log, "attitude", value=log["attitude"].value * [1.0, *Z_DOWN])


def only(log: Recording, *streams: str) -> Recording:
    kept = {name: series for name, series in log.items() if name in streams}
    return dataclasses.replace(log, streams=kept)


def sentences(log: Recording, platform: Platform | None) -> list[str]:
    return [finding.sentence for finding in check_conventions(log, platform)]


def test_a_right_log_with_an_accelerometer_has_no_finding(sads, right_logs):
    for log in right_logs:
        assert sentences(log, sads) == []
        assert sentences(only(log, "gyro", "attitude", "accelerometer"), None) == []


def test_a_frame_with_z_down_is_one_finding_that_mends_every_stream(sads, right_logs):
    for log in right_logs[:2]:
        wrong = with_z_down(log)
        advice = convention_advice(wrong, sads)
        assert [finding.sentence for finding in advice.findings] == [NED]
        assert advice.log_toml.splitlines() == [
            *("[streams.attitude]", 'columns = ["w", "x", "-y", "-z"]'),
            *("[streams.gyro]", 'columns = ["x", "-y", "-z"]'),
            *("[streams.accelerometer]", 'columns = ["x", "-y", "-z"]'),
        ]
        mended = corrected(wrong, list(advice.findings))
        assert sentences(mended, sads) == []
        for name in ("attitude", "gyro", "accelerometer"):
            np.testing.assert_array_equal(mended[name].value, log[name].value)


def test_a_mistake_beside_the_frame_is_named_with_it(sads, right_logs):
    wrong = with_z_down(right_logs[0])
    wrong = misread(wrong, "gyro", value=wrong["gyro"].value[:, [1, 0, 2]])
    found = check_conventions(wrong, sads)
    assert {finding.sentence for finding in found} == {NED, "Gyro's x and y axes are swapped."}
    mended = corrected(wrong, found)
    np.testing.assert_array_equal(mended["gyro"].value, right_logs[0]["gyro"].value)


def test_without_wheels_z_down_and_a_turned_accelerometer_are_both_given(right_logs):
    """A body whose z points down and one that falls upwards move alike."""
    for log in right_logs:
        wrong = only(with_z_down(log), "gyro", "attitude", "accelerometer")
        advice = convention_advice(wrong, None)
        (said,) = advice.sentences
        assert "in axes with z down (NED, FRD)" in said
        assert "every axis of accelerometer points the other way" in said
        assert advice.log_toml == ""


def test_an_accelerometer_that_shows_gravity_is_no_frame(sads, right_logs):
    log = right_logs[0]
    wrong = misread(log, "accelerometer", value=-log["accelerometer"].value)
    # where an axis swings by less than what may shake it, its sign is not known beside the others
    (said,) = sentences(wrong, sads)
    assert said.startswith("Every axis of accelerometer points the other way")


def lab(log: Recording) -> Recording:
    """Attitude and accelerometer alone."""
    return only(log, "attitude", "accelerometer")


def test_an_accelerometer_askew_beside_an_attitude_has_no_finding(drawn, right_logs):
    for log in right_logs:
        askew = rotation.from_rotation_vector(drawn.normal(0.0, np.radians(2.0), 3))
        felt = rotation.rotate(askew, log["accelerometer"].value)
        assert sentences(lab(log), None) == []
        assert sentences(lab(misread(log, "accelerometer", value=felt)), None) == []


def test_an_attitude_is_held_against_gravity_without_a_gyro(right_logs):
    for log in right_logs:
        two, attitude = lab(log), log["attitude"].value
        wrong = misread(two, "attitude", value=attitude[:, [1, 2, 3, 0]])
        assert sentences(wrong, None) == ["The attitude's scalar stands last."]
        turned = misread(two, "accelerometer", value=two["accelerometer"].value[:, [2, 0, 1]])
        (said,) = sentences(turned, None)
        assert said.startswith("Accelerometer's axes are turned: x is read as y, y is read as z")
        (said,) = sentences(with_z_down(two), None)
        assert "ttitude and accelerometer are in axes with z down (NED, FRD)" in said
        assert "every axis of accelerometer points the other way" in said


def test_an_inverse_attitude_leans_against_gravity(right_logs):
    two = lab(right_logs[0])
    wrong = misread(two, "attitude", value=two["attitude"].value * [1.0, -1.0, -1.0, -1.0])
    (said,) = sentences(wrong, None)
    assert "ttitude is world-to-body" in said


def test_a_correction_that_parts_the_streams_is_not_advised(right_logs):
    log = right_logs[0]
    for stream in ("gyro", "accelerometer"):
        change = axes_change(stream, -np.eye(3), ("x", "y", "z"))
        wrong = misread(log, stream, value=-log[stream].value)
        assert not brings_together(log, [change], 9.81)
        assert brings_together(wrong, [change], 9.81)


def test_gravity_read_as_a_gyro_fits_nothing(sads, right_logs):
    """Nor on a pendulum, whose tilt follows its rate a quarter of a period later."""
    kept = [("gyro", "accelerometer"), ("gyro", "attitude", "accelerometer"), ("gyro", "attitude")]
    for log, streams in zip(right_logs, kept, strict=True):
        up = log["accelerometer"]
        gyro = Series(up.time, up.value, up.columns, "rad/s")
        wrong = dataclasses.replace(log, streams={**log.streams, "gyro": gyro})
        advice = convention_advice(only(wrong, *streams), sads)
        (said,) = advice.sentences
        assert said.startswith("No reading of gyro")
        assert advice.log_toml == ""


def test_a_gyro_of_another_motion_fits_nothing(drawn):
    """Both shake for a minute, each in its own way."""
    time = np.arange(0.0, 60.0, 0.01)
    # as many as a minute resolves: two motions of few tones resemble each other at some lag
    tones = np.linspace(0.3, 1.7, 84)

    def shaking() -> NDArray[np.float64]:
        phase = drawn.uniform(0.0, 2.0 * np.pi, (len(tones), 3))
        return np.sin(2.0 * np.pi * tones[:, None] * time[:, None, None] + phase).sum(axis=1)

    turned = rotation.from_rotation_vector(0.008 * shaking())
    gyro = 0.04 * shaking() + drawn.normal(0.0, 1e-3, (len(time), 3))
    turned = rotation.normalized(turned + drawn.normal(0.0, 1e-4, turned.shape))
    streams = {
        "gyro": Series(time, gyro, ("x", "y", "z"), "rad/s"),
        "attitude": Series(time, turned, ("w", "x", "y", "z"), "1"),
    }
    log = Recording(streams, {"kind": "log"})
    said = "No reading of gyro and attitude fits: both move, and not together."
    assert sentences(log, None) == [said]


def slewed(draw: np.random.Generator, *, turns: tuple[float, float, float]) -> Recording:
    """A body that turns to and fro by so much about each axis [rad], its sensors almost quiet, the
    accelerometer mounted two degrees askew."""
    time = np.arange(0.0, 60.0, 0.02)
    tones = 2.0 * np.pi * np.array([0.031, 0.047, 0.019])
    phase = draw.uniform(0.0, 2.0 * np.pi, 3)
    angle = np.array(turns) * np.sin(tones * time[:, None] + phase)
    attitude = rotation.from_rotation_vector(angle)
    rate = np.gradient(angle, time, axis=0) + draw.normal(0.0, 4e-3, angle.shape)
    shaken = rotation.from_rotation_vector(draw.normal(0.0, 1e-3, angle.shape))
    attitude = rotation.multiply(attitude, shaken)
    streams = {
        "gyro": Series(time, rate, ("x", "y", "z"), "rad/s"),
        "attitude": Series(time, attitude, ("w", "x", "y", "z"), "1"),
    }
    log = with_accelerometer(Recording(streams, {"kind": "log"}), draw)
    askew = rotation.from_rotation_vector(draw.normal(0.0, np.radians(2.0), 3))
    return misread(log, "accelerometer", value=rotation.rotate(askew, log["accelerometer"].value))


def test_a_quiet_accelerometer_shows_which_axis_is_turned_on_a_body_that_hardly_leans(drawn):
    """It leans by a quarter of a degree, a hundredth of what may shake a sensor in a lab."""
    log = slewed(drawn, turns=(4e-3, 5e-3, 0.5))
    assert check_conventions(log) == []
    for axis, name in enumerate("xy"):
        flip = np.ones(3)
        flip[axis] = -1.0
        wrong = misread(log, "accelerometer", value=log["accelerometer"].value * flip)
        said = [finding.sentence for finding in check_conventions(wrong)]
        assert any(f"ccelerometer's {name} axis points the other way" in one for one in said), said


def test_noise_about_an_axis_that_does_not_turn_has_no_sign(drawn):
    """Whatever is said of the axis that turns, that one is said to be turned only beside readings
    in which it is not."""
    log = slewed(drawn, turns=(0.1, 0.1, 0.0))
    wrong = misread(log, "gyro", value=log["gyro"].value * [1.0, -1.0, 1.0])
    (finding,) = check_conventions(wrong)
    said = {finding.correction.words, *finding.alternatives}
    assert "gyro's y axis points the other way" in said, said
