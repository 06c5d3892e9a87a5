"""The attitude filter: right, honest about its error, and the same for a run in any company."""

import dataclasses

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from twin.errors import UsageError
from twin.estimators import AttitudeFilter
from twin.platform import load_platform
from twin.rotation import conjugate, from_rotation_vector, multiply, to_rotation_vector
from twin.signals import Reading, Samples


def errors(estimate, truth):
    """(n, 6) attitude error [rad, body] and bias error [rad/s]."""
    turn = to_rotation_vector(multiply(conjugate(estimate.attitude), truth.attitude))
    return np.concatenate([turn, truth.bias - estimate.gyro_bias], axis=1)


def squared_in_sigmas(estimate, truth):
    """Normalised estimation error squared of each run; its mean is 6 if the covariance is right."""
    x = errors(estimate, truth)
    return np.einsum("ni,nij,nj->n", x, np.linalg.inv(estimate.covariance), x)


def run(truth, duration, on_tick=lambda estimate: None):
    law = AttitudeFilter()
    estimate = law.init(truth.platform, truth.n)
    for reading in truth.readings(duration):
        estimate = law.update(estimate, reading)
        on_tick(estimate)
    return estimate


SENSORS = {
    "as shipped": {},
    "coarse": {"attitude": {"noise": 0.035}, "gyro": {"noise": 4.4e-3, "bias": 0.01}},
    "camera": {"attitude": {"noise": 7e-5}},
    "slow attitude": {"attitude": {"rate": 10.0}},
    "late attitude": {"attitude": {"latency": 0.06}},
    "late gyro": {"gyro": {"latency": 0.01}},
    "losses": {"attitude": {"dropout": 0.3}, "gyro": {"dropout": 0.1}},
    "uneven": {"attitude": {"noise": [1e-3, 4e-3, 1e-2]}, "gyro": {"noise": [1e-3, 3e-3, 2e-4]}},
}


@pytest.mark.parametrize("changes", SENSORS.values(), ids=SENSORS)
def test_error_is_as_large_as_the_covariance_says(bodies, with_sensor, changes):
    truth = bodies(with_sensor(**changes), n=250, seed=7)
    found = {}

    def note(estimate):
        if round(estimate.time * 20) in (4, 20, 100, 240):
            found[estimate.time] = squared_in_sigmas(estimate, truth).mean()

    run(truth, 12.0, note)
    low, high = chi2.ppf([0.025, 0.975], 6 * truth.n) / truth.n
    inside = [low < value < high for value in found.values()]
    assert sum(inside) >= 3, f"{found}: mean of 6 degrees of freedom, band {low:.2f} to {high:.2f}"
    assert all(0.9 * low < value < 1.1 * high for value in found.values()), found


def test_error_is_as_large_as_the_covariance_says_while_tumbling(bodies, platform):
    truth = bodies(platform, n=250, seed=8, swing=0.5)
    estimate = run(truth, 12.0)
    low, high = chi2.ppf([0.025, 0.975], 6 * truth.n) / truth.n
    assert low < squared_in_sigmas(estimate, truth).mean() < high


def test_bias_is_found_and_attitude_is_better_than_the_sensor(bodies, platform):
    truth = bodies(platform, n=50, seed=1)
    estimate = run(truth, 20.0)
    rms = np.sqrt(np.mean(errors(estimate, truth) ** 2, axis=0))
    assert rms[:3].max() < 0.2 * platform.sensors["attitude"].noise[0]
    assert rms[3:].max() < 0.05 * platform.sensors["gyro"].bias[0]


def test_rate_is_the_mean_of_a_tick_with_less_than_half_the_noise_of_a_sample(bodies, platform):
    truth = bodies(platform, n=400, seed=10, swing=1e-4)
    estimate = run(truth, 10.0)
    noise = np.std(estimate.rate_body - truth.rate) / platform.sensors["gyro"].noise[0]
    assert noise == pytest.approx(np.sqrt(4.5) / 5.0, rel=0.1), "trapezoid of six samples"


def test_one_run_agrees_with_a_textbook_filter_that_takes_each_sample_in_turn(bodies, platform):
    truth = bodies(platform, n=1, seed=5)
    gyro, attitude = (platform.sensors[name] for name in ("gyro", "attitude"))
    law, peer = AttitudeFilter(), KalmanFilter(dim_x=6, dim_z=3)
    estimate = law.init(platform, 1)
    peer.P = np.array(estimate.covariance[0])
    peer.R, peer.H = np.diag(attitude.noise**2), np.eye(3, 6)
    body, bias, before, before_time = None, np.zeros(3), np.zeros(3), 0.0
    for reading in truth.readings(15.0):
        estimate = law.update(estimate, reading)
        samples = [
            (time, kind, value)
            for kind, stream in (("a", "gyro"), ("b", "attitude"))
            if stream in reading.streams
            for time, value in zip(
                reading.streams[stream].time[0], reading.streams[stream].value[0], strict=True
            )
        ]
        for time, kind, value in sorted(samples, key=lambda sample: sample[:2]):
            if kind == "a":
                if body is not None:
                    step = time - before_time
                    turn = Rotation.from_rotvec((0.5 * (before + value) - bias) * step)
                    body = body * turn
                    f = np.eye(6)
                    f[:3, :3] = turn.as_matrix().T
                    f[:3, 3:] = -step * np.eye(3)
                    noise = [*(gyro.noise * step) ** 2, *[law.bias_walk**2 * step] * 3]
                    peer.predict(F=f, Q=np.diag(noise))
                before, before_time = value, time
            else:
                measured = Rotation.from_quat(value, scalar_first=True)
                body = measured if body is None else body
                peer.x = np.zeros(6)
                peer.update((body.inv() * measured).as_rotvec())
                body = body * Rotation.from_rotvec(peer.x[:3].ravel())
                bias = bias + peer.x[3:].ravel()
    sigma = np.sqrt(np.diag(peer.P))
    ours = Rotation.from_quat(estimate.attitude[0], scalar_first=True)
    apart = np.concatenate([(ours.inv() * body).as_rotvec(), estimate.gyro_bias[0] - bias])
    assert np.abs(apart / sigma).max() < 0.1
    np.testing.assert_allclose(np.sqrt(np.diag(estimate.covariance[0])), sigma, rtol=0.02)


def of_runs(reading, rows):
    cut = {
        name: Samples(s.value[rows], s.time[rows], s.valid[rows])
        for name, s in reading.streams.items()
    }
    return Reading(reading.time, cut)


def test_run_has_the_same_bits_in_any_company(bodies, with_sensor):
    """As one of 256, where others lose samples, and replayed as two equal rows, and as three."""
    lossy = with_sensor(attitude={"dropout": 0.1}, gyro={"dropout": 0.03})
    truth, law = bodies(lossy, n=256, seed=3, fine=1), AttitudeFilter()
    together = law.init(lossy, 256)
    companies = [[0, 0], [255, 255], [17, 254, 99], list(range(1, 256, 2))]
    apart = [law.init(lossy, len(rows)) for rows in companies]
    for reading in truth.readings(5.0):
        together = law.update(together, reading)
        for i, rows in enumerate(companies):
            apart[i] = law.update(apart[i], of_runs(reading, rows))
            for field in dataclasses.fields(together):
                value = getattr(together, field.name)
                if isinstance(value, np.ndarray):
                    assert np.array_equal(
                        value[rows], getattr(apart[i], field.name), equal_nan=True
                    ), f"{field.name} of runs {rows[:3]} at {reading.time:.2f} s"


def test_estimate_starts_at_the_first_attitude_wherever_that_is(bodies, platform):
    truth = bodies(platform, n=20, seed=2)
    law = AttitudeFilter()
    estimate = law.init(platform, 20)
    assert not estimate.valid.any()
    estimate = law.update(estimate, next(truth.readings(0.05)))
    assert estimate.valid.all()
    assert np.abs(errors(estimate, truth)[:, :3]).max() < 5e-3, "5 sigma of a sample"


def test_run_that_never_sees_its_attitude_stays_invalid_and_harms_nobody(bodies, platform):
    truth, law = bodies(platform, n=3, seed=2), AttitudeFilter()
    estimate = law.init(platform, 3)
    for reading in truth.readings(2.0):
        for samples in reading.streams.values():
            samples.valid[1] = False
            samples.value[1] = np.nan
        estimate = law.update(estimate, reading)
    assert estimate.valid.tolist() == [True, False, True]
    assert np.isfinite(estimate.attitude).all()
    assert np.abs(errors(estimate, truth)[[0, 2], :3]).max() < 2e-3


def test_attitude_is_carried_through_an_outage_of_its_sensor(bodies, platform):
    truth, law = bodies(platform, n=20, seed=4), AttitudeFilter()
    estimate = law.init(platform, 20)
    for reading in truth.readings(20.0):
        if reading.time > 15.0:
            del reading.streams["attitude"]
        estimate = law.update(estimate, reading)
    assert np.abs(errors(estimate, truth)[:, :3]).max() < 2e-3
    low, high = chi2.ppf([0.005, 0.995], 6 * 20) / 20
    assert low < squared_in_sigmas(estimate, truth).mean() < high


def test_late_gyro_is_bridged_at_the_last_rate(bodies, with_sensor):
    late = with_sensor(
        gyro={"latency": 0.1, "noise": 1e-5}, attitude={"latency": 0.2, "noise": 1e-5}
    )
    truth = bodies(late, n=20, seed=6)
    estimate = run(truth, 20.0)
    slip = 0.5 * truth.swing * 1.1 * 0.1**2
    assert np.abs(errors(estimate, truth)[:, :3]).max() < 1.5 * slip


def test_sign_of_a_measured_quaternion_does_not_matter(bodies, platform):
    truth, law = bodies(platform, n=4, seed=9), AttitudeFilter()
    plain, flipped = law.init(platform, 4), law.init(platform, 4)
    for reading in truth.readings(1.0):
        plain = law.update(plain, reading)
        reading.streams["attitude"].value[:, ::2] *= -1.0
        flipped = law.update(flipped, reading)
    turn = multiply(conjugate(plain.attitude), flipped.attitude)
    np.testing.assert_allclose(to_rotation_vector(turn), 0.0, atol=1e-12)


def test_body_at_rest_gives_no_rate_and_a_turning_one_its_own(platform):
    """One tick by hand: five gyro samples about z, one attitude at the end."""
    perfect = {
        name: dataclasses.replace(sensor, noise=np.zeros(3), bias=np.zeros(3))
        for name, sensor in platform.sensors.items()
        if name in ("gyro", "attitude")
    }
    law, exact = AttitudeFilter(), dataclasses.replace(platform, sensors=perfect)
    for speed in (0.0, 0.3):
        estimate = law.init(exact, 1)
        for tick in range(1, 41):
            times = 0.05 * (tick - 1) + 0.01 * np.arange(1.0, 6.0)[None]
            rate = np.tile([0.0, 0.0, speed], (1, 5, 1))
            turned = from_rotation_vector(np.array([[[0.0, 0.0, speed * times[0, -1]]]]))
            ones = np.ones((1, 5), dtype=bool)
            streams = {"gyro": Samples(rate, times, ones)}
            if tick < 20:
                streams["attitude"] = Samples(turned, times[:, -1:], ones[:, -1:])
            estimate = law.update(estimate, Reading(0.05 * tick, streams))
        np.testing.assert_allclose(estimate.rate_body, [[0.0, 0.0, speed]], atol=1e-9)
        np.testing.assert_allclose(estimate.attitude, turned[0], atol=1e-9)


def test_platform_without_its_sensors_is_told_what_would_do(platform):
    blind = dataclasses.replace(platform, sensors={"gyro": platform.sensors["gyro"]})
    with pytest.raises(UsageError, match="sads has no attitude; no estimator knows"):
        AttitudeFilter().init(blind, 1)


@pytest.mark.parametrize("name", ["sads", "tas2", "cubesat", "astros", "whorl1"])
def test_one_gyro_sample_of_30_rad_s_does_not_turn_a_table(name):
    """Nor one at the edge of the gyro's range, where that is less."""
    platform = load_platform(name)
    draw = np.random.default_rng(1)
    spike = min(30.0, 0.99 * platform.sensors["gyro"].range)
    law = AttitudeFilter()
    estimate = law.init(platform, 3)
    still, noise = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1, 1)), platform.sensors["gyro"].noise
    valid = np.ones((3, 1), dtype=bool)
    for tick in range(1, 41):
        times = np.full((3, 1), tick * platform.tick)
        rate = draw.normal(size=(3, 1, 3)) * noise
        if tick == 30:
            rate[1:] += [[[spike, 0.0, -spike]]]
        if tick == 31:
            rate[2] += [[spike, 0.0, -spike]]  # this one is a blow: the next sample confirms it
        streams = {"gyro": Samples(rate, times, valid), "attitude": Samples(still, times, valid)}
        estimate = law.update(estimate, Reading(float(times[0, 0]), streams))
        if tick == 31:
            assert np.abs(estimate.rate_body[1]).max() < 0.2
            assert estimate.rate_body[2, 0] > 0.4 * spike
    assert np.degrees(np.abs(to_rotation_vector(estimate.attitude[:2])).max()) < 0.5
    assert law.remarks(estimate)


def test_gyro_of_a_body_that_tumbles_fast_is_believed(bodies, platform):
    """What turning alone does to the rate of a dumbbell at 3 rad/s."""
    truth, law = bodies(platform, n=20, seed=3, swing=3.0), AttitudeFilter()
    free = dataclasses.replace(platform, wheels=(), stages=(), center_of_mass_offset=np.zeros(3))
    estimate = law.init(free, 20)
    for reading in truth.readings(3.0):
        estimate = law.update(estimate, reading)
    assert estimate.refused.sum() == 0
