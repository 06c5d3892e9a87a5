"""Gravity and the field hold a gyro without an attitude, and an attitude without a gyro."""

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.seeds import seed_of
from twin import rotation
from twin.conventions import check_conventions, convention_advice, corrected
from twin.conventions.correction import angles_of, attitude_of, signed_permutations
from twin.conventions.room_vectors import Rates, VectorBesideGyro, relative_axes, room_vector
from twin.plant.truth import specific_force
from twin.recording import Recording, Series

Array = NDArray[np.float64]

FIELD = np.array([2.2e-5, 0.4e-5, -4.3e-5])
"""[T]."""
XYZ = ("x", "y", "z")
CYCLE = np.eye(3)[[1, 2, 0]]
TOLD_OF_GYRO = "Gyro's axes are turned: x is read as z, y is read as x, z is read as y."


@pytest.fixture(scope="module")
def draw(request: pytest.FixtureRequest) -> np.random.Generator:
    seed = seed_of(request)
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def log(draw) -> Recording:
    """Forty seconds about all axes, by up to 15 deg, with biases, noise and an IMU off centre."""
    time = np.arange(0.0, 40.0, 0.02)
    tones = np.array([[0.11, 0.23, 0.37], [0.13, 0.19, 0.41], [0.07, 0.17, 0.29]])
    phase = draw.uniform(0.0, 2.0 * np.pi, (3, 3))
    angle = 0.12 * np.sin(2.0 * np.pi * tones * time[:, None, None] + phase).sum(axis=2)
    attitude = rotation.from_rotation_vector(angle)
    turn = rotation.multiply(rotation.conjugate(attitude[:-1]), attitude[1:])
    rate = rotation.to_rotation_vector(turn)[:, :] / 0.02
    rate = np.vstack([rate[:1], 0.5 * (rate[1:] + rate[:-1]), rate[-1:]])
    turning = np.gradient(rate, time, axis=0)
    push = np.broadcast_to([0.0, 0.0, 9.81], rate.shape)
    felt = specific_force(attitude, push, rate, turning, draw.uniform(-0.1, 0.1, 3))
    field = rotation.rotate(rotation.conjugate(attitude), np.broadcast_to(FIELD, rate.shape))
    shaken = rotation.from_rotation_vector(draw.normal(0.0, 1e-3, rate.shape))
    values = {
        "gyro": (rate + draw.normal(0.0, 5e-3, 3), 1e-3, "rad/s"),
        "accelerometer": (felt + draw.normal(0.0, 0.05, 3), 0.03, "m/s^2"),
        "magnetometer": (field + draw.normal(0.0, 3e-6, 3), 2e-7, "T"),
    }
    streams = {
        name: Series(time, value + draw.normal(0.0, sigma, value.shape), XYZ, unit)
        for name, (value, sigma, unit) in values.items()
    }
    noisy = rotation.multiply(attitude, shaken)
    streams["attitude"] = Series(time, noisy, ("w", "x", "y", "z"), "1")
    return Recording(streams, {"kind": "log"})


def only(log: Recording, *streams: str) -> Recording:
    return dataclasses.replace(log, streams={name: log[name] for name in streams})


def read_as(log: Recording, stream: str, axes: Array) -> Recording:
    """The log with a stream that shows `axes` times what is right."""
    series = dataclasses.replace(log[stream], value=log[stream].value @ axes.T)
    return dataclasses.replace(log, streams={**log.streams, stream: series})


def sentences(log: Recording) -> list[str]:
    return [finding.sentence for finding in check_conventions(log)]


def readings(log: Recording) -> list[str]:
    """All that is wrong with the log, in one way or another."""
    findings = check_conventions(log)
    others = dict.fromkeys(text for finding in findings for text in finding.alternatives)
    return [", and ".join(finding.correction.words for finding in findings), *others]


@pytest.mark.parametrize(
    "streams",
    [
        ("gyro", "accelerometer"),
        ("gyro", "magnetometer"),
        ("gyro", "accelerometer", "magnetometer"),
        ("attitude", "magnetometer"),
        ("attitude", "accelerometer", "magnetometer"),
        ("attitude", "gyro", "magnetometer"),
    ],
)
def test_a_right_log_of_few_streams_has_no_finding(log, streams):
    assert sentences(only(log, *streams)) == []


def test_what_turns_rates_and_vector_alike_is_not_seen(log):
    """A proper turn of both changes nothing, and a mirror is one of the rates."""
    pair = only(log, "gyro", "magnetometer")
    seen = room_vector(pair, "magnetometer", "gyro")
    assert seen is not None
    left = seen.match(np.zeros(1))[0, 0]
    axes = signed_permutations(3)
    for index in (5, 17, 30):
        turned = read_as(pair, "magnetometer", axes[index].T)
        other = VectorBesideGyro(
            "magnetometer", turned["magnetometer"], Rates(pair["gyro"], seen.grid)
        )
        np.testing.assert_allclose(
            other.match(np.zeros(1))[0, 0, relative_axes()[index]], left, rtol=1e-3
        )


def test_rates_put_right_leave_the_same_in_whatever_unit_they_were_read(log):
    pair = only(log, "gyro", "magnetometer")
    left = list[Array]()
    for unit in (1.0, 180.0 / np.pi):
        seen = room_vector(read_as(pair, "gyro", unit * np.eye(3)), "magnetometer", "gyro")
        assert seen is not None
        left.append(seen.residual(np.eye(3) / unit, 0.0))
    np.testing.assert_allclose(left[1], left[0], atol=1e-6)


@pytest.mark.parametrize("vector", ["accelerometer", "magnetometer"])
def test_a_gyro_in_degrees_is_named_without_an_attitude(log, vector):
    wrong = read_as(only(log, "gyro", vector), "gyro", np.degrees(np.eye(3)))
    assert sentences(wrong) == ["Gyro looks like deg/s, read as rad/s."]


def test_a_left_handed_gyro_is_named_by_gravity_and_the_field(log):
    wrong = read_as(only(log, "gyro", "accelerometer", "magnetometer"), "gyro", -np.eye(3))
    assert sentences(wrong) == ["Every axis of gyro points the other way."]
    assert convention_advice(wrong, None).log_toml.startswith("[streams.gyro]\ncolumns")


def test_two_streams_alone_do_not_tell_which_of_them_is_turned(log):
    wrong = read_as(only(log, "gyro", "accelerometer"), "gyro", CYCLE)
    said = readings(wrong)
    assert TOLD_OF_GYRO[:-1].replace("Gyro", "gyro") in said, said
    assert any(one.startswith("accelerometer's axes are turned") for one in said), said
    assert convention_advice(wrong, None).log_toml == ""


def test_a_third_stream_tells_which_is_turned(log):
    wrong = read_as(only(log, "gyro", "accelerometer", "magnetometer"), "gyro", CYCLE)
    assert sentences(wrong) == [TOLD_OF_GYRO]


def test_a_late_gyro_is_named_by_gravity_and_the_field(log):
    late = dataclasses.replace(log["gyro"], time=log["gyro"].time + 0.5)
    streams = {**log.streams, "gyro": late}
    three = only(dataclasses.replace(log, streams=streams), "gyro", "accelerometer", "magnetometer")
    (said,) = sentences(three)
    assert said.startswith("Gyro lags 0.")


def test_a_turned_magnetometer_is_named_beside_gyro_and_attitude(log):
    wrong = read_as(only(log, "attitude", "gyro", "magnetometer"), "magnetometer", CYCLE)
    (said,) = sentences(wrong)
    assert said == TOLD_OF_GYRO.replace("Gyro", "Magnetometer")


def test_the_field_shows_a_heading_of_the_wrong_sign_that_gravity_does_not(log):
    facts = {"format": "euler_zyx", "columns": ["yaw", "pitch", "roll"]}
    two = only(log, "attitude", "accelerometer", "magnetometer")
    two = dataclasses.replace(two, provenance={"kind": "log", "streams": {"attitude": facts}})
    angles = angles_of(two["attitude"].value, "ZYX", world_to_body=False) * [-1.0, 1.0, 1.0]
    value = attitude_of(angles, "ZYX", world_to_body=False)
    turned = dataclasses.replace(two["attitude"], value=value)
    wrong = dataclasses.replace(two, streams={**two.streams, "attitude": turned})
    findings = check_conventions(wrong)
    assert [one.sentence for one in findings] == ["The attitude's yaw has the wrong sign."]
    mended = corrected(wrong, findings)
    assert sentences(mended) == []


def test_a_pendulum_whose_accelerometer_shows_no_lean_has_no_finding(log, draw):
    """At its centre of oscillation, what is felt stays along the rod."""
    length = 0.5
    time = np.arange(0.0, 30.0, 0.01)
    omega = np.sqrt(9.81 / length)
    angle, rate = 0.3 * np.cos(omega * time), -0.3 * omega * np.sin(omega * time)
    about_x = np.array([1.0, 0.0, 0.0])
    attitude = rotation.from_rotation_vector(angle[:, None] * about_x)
    push = np.broadcast_to([0.0, 0.0, 9.81], (len(time), 3))
    turning = np.gradient(rate, time)[:, None] * about_x
    felt = specific_force(
        attitude, push, rate[:, None] * about_x, turning, np.array([0.0, 0.0, -length])
    )
    gyro = rate[:, None] * about_x + draw.normal(0.0, 1e-3, felt.shape)
    streams = {
        "gyro": Series(time, gyro, XYZ, "rad/s"),
        "accelerometer": Series(time, felt + draw.normal(0.0, 0.03, felt.shape), XYZ, "m/s^2"),
    }
    assert sentences(Recording(streams, {"kind": "log"})) == []


def leaning_slowly(seed: int) -> Recording:
    """Seventy seconds of a camera that scatters by half a degree, on a body that leans by two or
    three, beside a magnetometer."""
    draw = np.random.default_rng(seed)
    time = np.arange(0.0, 70.0, 0.05)
    tones = np.array([0.02, 0.035, 0.06])
    phase = draw.uniform(0.0, 2.0 * np.pi, (3, 3))
    size = np.radians([2.0, 2.0, 6.0])
    angle = size * np.sin(2.0 * np.pi * tones * time[:, None, None] + phase).mean(axis=2)
    attitude = rotation.from_rotation_vector(angle)
    room = np.broadcast_to(FIELD, angle.shape)
    field = rotation.rotate(rotation.conjugate(attitude), room)
    field = field + draw.normal(0.0, 2e-6, 3) + draw.normal(0.0, 2.5e-7, angle.shape)
    shaken = rotation.from_rotation_vector(draw.normal(0.0, 0.01, angle.shape))
    noisy = rotation.multiply(attitude, shaken)
    streams = {
        "attitude": Series(time, noisy, ("w", "x", "y", "z"), "1"),
        "magnetometer": Series(time, field, XYZ, "T"),
    }
    return Recording(streams, {"kind": "log"})


@pytest.mark.parametrize("swapped", [(1, 0, 2), (0, 2, 1), (2, 1, 0)])
def test_a_noisy_attitude_does_not_hide_which_axes_of_a_field_are_swapped(
    swapped, request: pytest.FixtureRequest
):
    seed = seed_of(request)
    right = leaning_slowly(seed)
    assert sentences(right) == []
    names = " and ".join(XYZ[i] for i, j in enumerate(swapped) if i != j)
    read = read_as(right, "magnetometer", np.eye(3)[list(swapped)])
    assert f"magnetometer's {names} axes are swapped" in readings(read)
