"""A value that passed its link's check is still held against what its sensor can measure."""

import math
from dataclasses import replace

import numpy as np
import pytest

from twin.plant.devices.device import Sample, StreamLimits
from twin.plant.plausibility import MotionAgreement, SampleChecks, sensor_limits
from twin.platform import Platform, load_platform
from twin.rotation import from_rotation_vector, multiply
from twin.signals import Reading, Samples


def judged(values, stream="gyro", **limits) -> list[str]:
    checks = SampleChecks("imu", {stream: StreamLimits(**limits)})
    return [checks.judged(Sample(stream, tuple(v), 0.0)).reason for v in values]


def test_where_a_first_value_needs_a_second_one_it_is_not_believed_alone():
    reasons = judged(
        [(0.0, 0.0, 5.6e-37), (0.0, 0.0, 9.81), (0.0, 0.0, 9.82)],
        range=20.0,
        largest_step=0.1,
        first_confirmed=True,
    )
    assert reasons[0] == "imu: gyro the first: there is nothing yet to hold it against"
    assert reasons[1] == "imu: gyro leapt by 9.81, more than 0.1 between two samples"
    assert reasons[2] == ""


def test_where_it_needs_none_the_first_value_is_believed():
    assert judged([(0.0, 0.0, 9.81)], range=20.0) == [""]


def test_what_is_no_number_or_at_full_scale_is_not_believed():
    assert judged([(math.nan,), (20.0,)], range=20.0) == [
        "imu: gyro not a number",
        "imu: gyro saturated: 20 at a full scale of 20",
    ]


def test_the_value_that_is_the_nth_alike_is_doubted():
    reasons = judged([(1.0, 2.0)] * 4 + [(1.0, 2.5)], frozen_after=3)
    assert reasons[:2] == ["", ""]
    assert reasons[2] == "imu: gyro the same for 3 samples: the sensor has stopped"
    assert reasons[4] == ""


@pytest.mark.parametrize("value", [(0.0, 0.0, 0.0, 0.0), (0.7, 0.7, 0.7, 0.7)])
def test_a_quaternion_that_is_no_rotation_is_never_believed(value):
    assert "a quaternion of length" in judged([value], "attitude")[0]


def test_the_other_quaternion_of_one_rotation_is_no_step_and_no_change():
    one = (0.6, 0.8, 0.0, 0.0)
    other = tuple(-x for x in one)
    reasons = judged([one, other, one], "attitude", largest_step=0.1, frozen_after=3)
    assert reasons[1] == ""
    assert "the same for 3 samples" in reasons[2]


def test_a_sample_that_was_long_on_its_way_is_not_believed():
    checks = SampleChecks("imu", {"gyro": StreamLimits(oldest=1.0)})
    old = checks.judged(Sample("gyro", (0.1,), host_time=10.0), host_time=11.5)
    assert old.reason == "imu: gyro 1.50 s old on arrival, more than 1.00 s"
    assert checks.judged(Sample("gyro", (0.2,), host_time=10.0), host_time=10.5).valid


def test_what_a_device_refuses_itself_stays_refused_with_its_reason():
    own = Sample("gyro", (0.1,), 0.0, valid=False, reason="imu: restarted")
    assert SampleChecks("imu", {}).judged(own) is own


# ---- what follows from the sensor


def test_repeats_are_doubted_as_the_noise_makes_them_impossible_and_never_without_noise():
    cubesat = load_platform("cubesat")
    assert sensor_limits(cubesat, "gyro").frozen_after == 10
    assert sensor_limits(cubesat, "stage_position").frozen_after == 0
    # a step of twice the noise shows the same number for a while
    assert (sensor_limits(cubesat, "gyro", resolution=8e-4).frozen_after or 0) > 10
    assert sensor_limits(cubesat, "gyro", resolution=4e-2).frozen_after == 0


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0, 2.0])
def test_a_sound_sensor_never_repeats_itself_until_it_is_called_frozen(share):
    """Two million samples of a noise that is rounded coarsely, at rest."""
    sads = load_platform("sads")
    noise = float(sads.sensors["gyro"].noise[0])
    limit = sensor_limits(sads, "gyro", resolution=share * noise).frozen_after
    assert limit
    rng = np.random.default_rng(7)
    counts = np.round(rng.normal(0.3, 1.0 / share, (2_000_000, 3)))
    changed = np.flatnonzero((np.diff(counts, axis=0) != 0.0).any(axis=1))
    assert np.diff(changed).max() < limit


def test_one_sample_of_thirty_rad_per_s_is_beyond_what_any_table_can_turn_by():
    for name in ("cubesat", "astros", "sads", "tas2", "whorl1", "whorl2"):
        assert sensor_limits(load_platform(name), "gyro").largest_step < 10.0


# ---- streams of one motion


class Motion:
    """Streams of a body that turns as it is told."""

    def __init__(self, platform: Platform, seed: int = 0) -> None:
        self.platform, self.agreement = platform, MotionAgreement(platform)
        self.rng = np.random.default_rng(seed)
        self.attitude = np.array([1.0, 0.0, 0.0, 0.0])
        self.tick = 0
        self.frozen: dict[str, np.ndarray] = {}

    def turn(self, rate: np.ndarray, seconds: float, **shown) -> None:
        step = self.platform.tick
        for _ in range(round(seconds / step)):
            self.tick += 1
            self.attitude = multiply(self.attitude, from_rotation_vector(rate * step))
            noise = self.rng.normal(size=3) * self.platform.sensors["attitude"].noise
            values = {
                "gyro": rate + self.rng.normal(size=3) * self.platform.sensors["gyro"].noise,
                "attitude": multiply(self.attitude, from_rotation_vector(noise)),
            }
            values.update({k: v for k, v in shown.items() if v is not None})
            time = self.tick * step
            self.agreement.take(
                Reading(
                    time,
                    {
                        name: Samples(
                            value[None, None], np.full((1, 1), time), np.ones((1, 1), np.bool_)
                        )
                        for name, value in values.items()
                        if name in self.platform.sensors
                    },
                )
            )


def test_an_attitude_that_stands_still_while_the_gyro_turns_is_told_by_value():
    body = Motion(load_platform("cubesat"))
    body.turn(np.array([0.02, 0.0, 0.0]), 5.0)
    assert body.agreement.doubts == {}
    still = body.attitude.copy()
    body.turn(np.array([0.2, 0.0, 0.0]), 2.0, attitude=still)
    assert "attitude has stood still for" in body.agreement.doubts["attitude"]
    assert "while gyro turned the body by" in body.agreement.doubts["attitude"]


def test_a_gyro_that_shows_nothing_while_the_attitude_turns_is_told():
    body = Motion(load_platform("cubesat"))
    body.turn(np.array([0.3, 0.0, 0.0]), 3.0, gyro=np.zeros(3))
    assert "attitude and gyro disagree: over" in body.agreement.doubts["attitude"]


def test_a_gyro_of_the_other_sign_is_told():
    body = Motion(load_platform("cubesat"))
    rate = np.array([0.0, 0.3, 0.0])
    body.turn(rate, 3.0, gyro=-rate)
    assert "disagree" in body.agreement.doubts["attitude"]


def test_an_attitude_that_wanders_off_alone_is_told():
    body = Motion(load_platform("cubesat"))
    body.turn(np.array([0.3, 0.0, 0.0]), 3.0, gyro=np.array([0.0, 0.0, 0.0]))
    assert body.agreement.doubts
    body.turn(np.array([0.05, 0.0, 0.0]), 4.0)
    assert body.agreement.doubts == {}, "what agrees again is believed again"


def test_an_agreement_that_is_stated_as_infinite_is_not_asked_for():
    platform = load_platform("cubesat")
    body = Motion(platform)
    body.agreement = MotionAgreement(platform, {"attitude": math.inf})
    body.turn(np.array([0.5, 0.0, 0.0]), 3.0, gyro=np.zeros(3))
    assert body.agreement.doubts == {}


@pytest.mark.parametrize("seed", range(6))
def test_a_sound_body_that_turns_to_and_fro_is_never_doubted(seed):
    """Rates up to 30 deg/s, a gyro bias of 0.02 rad/s, a scale off by 3 %."""
    rng = np.random.default_rng(seed)
    body = Motion(load_platform("cubesat"), seed)
    bias = rng.normal(size=3)
    bias *= 0.02 / np.linalg.norm(bias)
    for _ in range(20):
        rate = rng.uniform(-0.3, 0.3, 3)
        body.turn(rate, rng.uniform(0.2, 3.0), gyro=1.03 * rate + bias)
        assert body.agreement.doubts == {}, seed


def test_a_hinge_is_held_against_its_own_rate():
    pendulum = load_platform("dfki_pendulum")
    agreement = MotionAgreement(pendulum)
    for tick in range(400):
        time = tick / 100.0
        streams = {"joint_angle": 0.0, "joint_rate": 0.5}
        agreement.take(
            Reading(
                time,
                {
                    name: Samples(
                        np.full((1, 1, 1), value),
                        np.full((1, 1), time),
                        np.ones((1, 1), np.bool_),
                    )
                    for name, value in streams.items()
                },
            )
        )
    assert "joint_angle has stood still" in agreement.doubts["joint_angle"]


def test_the_inclinometer_is_held_against_the_gyro():
    tas2 = load_platform("tas2")
    body = Motion(replace(tas2, sensors={k: tas2.sensors[k] for k in tas2.sensors}))
    still = np.array([0.01, 0.02])
    body.turn(np.array([0.2, 0.1, 0.0]), 3.0, inclinometer=still)
    assert "inclinometer has stood still" in body.agreement.doubts["inclinometer"]
    assert "attitude" not in body.agreement.doubts
