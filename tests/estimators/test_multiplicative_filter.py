"""The filter of whatever a machine measures: right, honest, and the same for a run in any company.

Machines fly in simulation without a command, each run with its own noise and biases; the estimate
is held against the truth.
"""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from scipy.stats import chi2

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.effects import with_effects
from twin.effects.sensors import GyroBias
from twin.errors import UsageError
from twin.estimators import AttitudeFilter, MultiplicativeFilter, usual_estimator
from twin.estimators.aids import delay_of, heading_sigma
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, Sensor, load_platform
from twin.reference import parse_reference
from twin.rotation import (
    conjugate,
    from_euler_zyx,
    from_rotation_vector,
    matrix,
    multiply,
    rotate,
    to_rotation_vector,
)
from twin.signals import Reading, Samples

RATE = np.array([0.03, -0.02, 0.05])
"""At the start of a flight [rad/s]."""


@dataclasses.dataclass
class Flown:
    """Estimates of n runs against the truth, a row a tick."""

    time: np.ndarray
    turn: np.ndarray
    """(ticks, n, 3) attitude error about the room's axes [rad]."""
    bias: np.ndarray
    """(ticks, n, 3) error of the gyro's bias [rad/s]."""
    covariance: np.ndarray
    """(ticks, n, 6, 6) of both, the attitude's about the room's axes."""
    remarks: list[str]
    estimate: object

    def squares(self, states: slice | list[int], start: float) -> np.ndarray:
        """(ticks, n) normalised estimation error squared of these states, from a time on."""
        rows = self.time >= start
        error = np.concatenate([self.turn, self.bias], axis=2)[rows][..., states]
        part = self.covariance[rows][..., states, :][..., states]
        return np.einsum("tni,tnij,tnj->tn", error, np.linalg.inv(part), error)


def flown(
    platform: Platform,
    duration: float,
    *,
    n: int = 100,
    seed: int = 0,
    estimator=None,
    spoil: Callable[[Reading], Reading] = lambda reading: reading,
    rate: np.ndarray = RATE,
) -> Flown:
    """Fly n runs without a command; each has a gyro bias of its own."""
    draw = np.random.default_rng(seed)
    gyro = platform.sensors["gyro"]
    bias = draw.normal(size=(n, 3)) * gyro.bias
    sensors = {**platform.sensors, "gyro": dataclasses.replace(gyro, bias=np.zeros(3))}
    body = dataclasses.replace(platform, sensors=sensors, effects=())
    effects = [(GyroBias(bias=tuple(row)),) for row in bias]
    plant = SimulatedPlant(
        with_effects(body, effects[0]),
        runs=range(n),
        seed=seed,
        initial=InitialState(rate_body=rate),
        effects=effects,
    )
    law = estimator or MultiplicativeFilter()
    estimate = law.init(platform, n)
    rows = []
    with plant:
        for tick in range(1, round(duration * platform.control_rate) + 1):
            estimate = law.update(estimate, spoil(plant.read(tick * platform.tick)))
            plant.write({})
            if not estimate.valid.all():
                continue
            true = plant.truth()["truth_attitude"].value[:, 0]
            turned = np.zeros((n, 6, 6))
            turned[:, :3, :3], turned[:, 3:, 3:] = matrix(estimate.attitude), np.eye(3)
            spread = turned @ estimate.covariance @ turned.transpose(0, 2, 1)
            error = to_rotation_vector(multiply(true, conjugate(estimate.attitude)))
            rows.append((estimate.time, error, bias - estimate.gyro_bias, spread))
    parts = [np.array(part) for part in zip(*rows, strict=True)]
    return Flown(*parts, law.remarks(estimate), estimate)


def without(name: str, *streams: str) -> Platform:
    platform = load_platform(name)
    kept = {k: v for k, v in platform.sensors.items() if k not in streams}
    return dataclasses.replace(platform, sensors=kept)


def changed(platform: Platform, **changes: Mapping[str, object]) -> Platform:
    sensors = dict(platform.sensors)
    for name, values in changes.items():
        sensors[name] = dataclasses.replace(sensors[name], **values)
    return dataclasses.replace(platform, sensors=sensors)


def band(degrees: int, n: int, share: float = 0.95) -> tuple[float, float]:
    """Of the mean of n squared errors of so many degrees of freedom."""
    tail = (1.0 - share) / 2.0
    low, high = chi2.ppf([tail, 1.0 - tail], degrees * n) / n
    return float(low), float(high)


TILT, TURN, BIAS = [0, 1], [0, 1, 2], [3, 4, 5]

MACHINES = {
    "cubesat:imu": (lambda: load_platform("cubesat:imu"), TILT),
    "cubesat, magnetometer too": (lambda: without("cubesat", "attitude"), TILT),
    "tas2:imu": (lambda: load_platform("tas2:imu"), TURN),
    "astros, with its camera": (lambda: load_platform("astros"), TURN),
    "astros, without it": (lambda: without("astros", "attitude"), TURN),
    "sads": (lambda: load_platform("sads"), TURN),
    "whorl1, with an attitude": (lambda: load_platform("whorl1"), TURN),
    "whorl1, gyro and accelerometer": (lambda: without("whorl1", "attitude"), TILT),
    "whorl2, gyro and accelerometer": (lambda: without("whorl2", "attitude"), TILT),
}


@pytest.mark.parametrize("machine", ["cubesat:imu", "tas2:imu"])
def test_error_is_as_large_as_the_covariance_says(machine):
    build, states = MACHINES[machine]
    flight = flown(build(), 4.0, n=50, seed=11)
    for kept in (states, BIAS):
        low, high = band(len(kept), 50, 0.999)
        assert low < flight.squares(kept, 1.0).mean() < high


@pytest.mark.slow
def test_error_is_as_large_as_the_covariance_says_on_each_machine_over_100_seeds():
    """The errors of one flight hang together, so that one of twenty means may lie outside its 95 %
    band, and none far outside."""
    rows = []
    for number, (name, (build, states)) in enumerate(MACHINES.items()):
        flight = flown(build(), 20.0, seed=100 + number)
        for what, kept in (("attitude", states), ("bias", BIAS)):
            if what == "bias" and not build().sensors["gyro"].bias.any():
                continue  # none is stated, and a filter that supposes one is careful
            mean = flight.squares(kept, 1.0).mean()
            (low, high), wide = band(len(kept), 100), band(len(kept), 100, 0.9999)
            rows.append((name, what, mean, low, high, low < mean < high))
            assert wide[0] < mean < wide[1], rows[-1]
    table = "\n".join(str(row) for row in rows)
    assert sum(row[-1] for row in rows) >= len(rows) - 2, table


def test_noise_alone_leaves_what_the_kalman_bound_of_one_axis_leaves():
    """Of a heading and of a tilt, without constant errors of the sensors that show them."""
    plain = {"bias": np.zeros(3)}
    tas2 = load_platform("tas2:imu")
    names = ("magnetometer", "inclinometer", "accelerometer")
    tas2 = changed(tas2, **{k: {"bias": np.zeros(len(tas2.sensors[k].bias))} for k in names})
    level = np.hypot(*tas2.magnetic_field[:2])
    flight = flown(tas2, 6.0, n=60, seed=3, rate=np.zeros(3))
    heading = _bound(tas2, tas2.sensors["magnetometer"].noise[0] / level, 20.0, 6.0)
    assert np.std(flight.turn[-1, :, 2]) < 1.2 * heading

    cubesat = changed(load_platform("cubesat:imu"), accelerometer=plain)
    flight = flown(cubesat, 6.0, n=100, seed=3, rate=np.zeros(3))
    noise = cubesat.sensors["accelerometer"].noise[0] / cubesat.gravity
    assert np.std(flight.turn[-1, :, :2]) < 1.2 * _bound(cubesat, noise, 20.0, 6.0)


def _bound(platform: Platform, noise: float, rate: float, duration: float) -> float:
    """1 sigma of one angle after so long, by the Riccati recursion of angle and gyro bias."""
    gyro = platform.sensors["gyro"]
    step = 1.0 / rate
    onward = np.array([[1.0, -step], [0.0, 1.0]])
    samples = max(gyro.rate / rate, 1.0)
    grown = np.diag([gyro.noise[0] ** 2 * step**2 / samples, 1e-12 * step])
    spread = np.diag([10.0, gyro.bias[0] ** 2])
    for _ in range(round(duration * rate)):
        spread = onward @ spread @ onward.T + grown
        gain = spread[:, :1] / (spread[0, 0] + noise**2)
        spread = spread - gain @ spread[:1]
    return float(np.sqrt(spread[0, 0]))


def test_with_gyro_and_attitude_alone_it_agrees_with_the_filter_of_these_two(bodies, platform):
    truth = bodies(platform, n=3, seed=5)
    laws = AttitudeFilter(), MultiplicativeFilter()
    estimates = [law.init(platform, 3) for law in laws]
    for reading in truth.readings(10.0):
        estimates = [law.update(e, reading) for law, e in zip(laws, estimates, strict=True)]
    one, other = estimates
    sigma = np.sqrt(np.diagonal(one.covariance, axis1=1, axis2=2))
    apart = to_rotation_vector(multiply(conjugate(one.attitude), other.attitude))
    assert np.abs(apart / sigma[:, :3]).max() < 0.3
    assert np.abs((one.gyro_bias - other.gyro_bias) / sigma[:, 3:]).max() < 0.3
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(other.covariance, axis1=1, axis2=2)), sigma, rtol=0.1
    )


def _still(platform: Platform, attitude: np.ndarray, ticks: int = 3):
    """Readings of perfect sensors on bodies that stand so."""
    n, back = len(attitude), conjugate(attitude)
    up = np.broadcast_to([0.0, 0.0, platform.gravity], (n, 3))
    shown = {
        "gyro": np.zeros((n, 3)),
        "accelerometer": rotate(back, up),
        "magnetometer": rotate(back, np.broadcast_to(platform.magnetic_field, (n, 3))),
    }
    for tick in range(1, ticks + 1):
        time = np.full((n, 1), tick * platform.tick)
        valid = np.ones((n, 1), dtype=bool)
        noise = 1e-12 * tick  # a sample that repeats the last one to the bit is taken for dead
        yield Reading(
            tick * platform.tick,
            {name: Samples(value[:, None] + noise, time, valid) for name, value in shown.items()},
        )


def test_it_starts_at_the_attitude_that_gravity_and_field_show_wherever_that_is():
    platform = without("tas2", "attitude", "inclinometer", "gimbal_angle", "stage_position")
    draw = np.random.default_rng(2)
    attitude = draw.normal(size=(50, 4))
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    attitude[0], attitude[1] = [0.0, 1.0, 0.0, 0.0], [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]
    law = MultiplicativeFilter()
    estimate = law.init(platform, 50)
    assert not estimate.valid.any()
    for reading in _still(platform, attitude):
        estimate = law.update(estimate, reading)
    assert estimate.valid.all()
    off = to_rotation_vector(multiply(conjugate(attitude), estimate.attitude))
    np.testing.assert_allclose(off, 0.0, atol=1e-6)


def test_run_has_the_same_bits_in_any_company():
    platform = changed(
        load_platform("tas2:imu"), accelerometer={"dropout": 0.1}, gyro={"dropout": 0.05}
    )
    plant = SimulatedPlant(platform, runs=range(40), seed=3, initial=InitialState(rate_body=RATE))
    law = MultiplicativeFilter()
    companies = [[0, 0], [39, 39], [17, 3, 8]]
    together = law.init(platform, 40)
    apart = [law.init(platform, len(rows)) for rows in companies]
    with plant:
        for tick in range(1, 41):
            reading = plant.read(tick * platform.tick)
            plant.write({})
            together = law.update(together, reading)
            for i, rows in enumerate(companies):
                cut = {
                    name: Samples(s.value[rows], s.time[rows], s.valid[rows])
                    for name, s in reading.streams.items()
                }
                apart[i] = law.update(apart[i], Reading(reading.time, cut))
                for field in ("attitude", "rate_body", "gyro_bias", "covariance", "states"):
                    np.testing.assert_array_equal(
                        getattr(together, field)[rows], getattr(apart[i], field), err_msg=field
                    )


def test_one_wrong_sample_of_any_sensor_changes_nothing_much():
    platform = load_platform("tas2:imu")
    plain = flown(platform, 4.0, n=3, seed=1)
    wrong = {
        "gyro": np.array([1.5, -1.5, 1.5]),
        "accelerometer": np.array([30.0, 0.0, -30.0]),
        "inclinometer": np.array([0.3, -0.3]),
        "magnetometer": np.array([-3e-5, 2e-5, 3e-5]),
    }
    for name, value in wrong.items():

        def spoil(reading: Reading, name=name, value=value) -> Reading:
            if abs(reading.time - 3.0) > 1e-6:
                return reading
            samples = reading.streams[name]
            spoilt = samples.value.copy()
            spoilt[:, -1] = value
            streams = {**reading.streams, name: dataclasses.replace(samples, value=spoilt)}
            return Reading(reading.time, streams)

        flight = flown(platform, 4.0, n=3, seed=1, spoil=spoil)
        sigma = np.sqrt(np.diagonal(flight.covariance, axis1=2, axis2=3))[..., :3]
        assert (np.abs(flight.turn - plain.turn) / sigma).max() < 2.0, name
        said = " ".join(flight.remarks)
        assert ("lone gyro samples" if name == "gyro" else f"of {name} lay") in said, said


@pytest.mark.parametrize("fault", ["silent", "zero", "frozen"])
def test_a_magnetometer_that_dies_is_said_and_the_headings_sigma_grows_with_its_error(fault):
    platform = load_platform("tas2:imu")

    def spoil(reading: Reading) -> Reading:
        if reading.time < 4.0 or "magnetometer" not in reading.streams:
            return reading
        streams = dict(reading.streams)
        samples = streams.pop("magnetometer")
        if fault == "frozen":
            held = np.full_like(samples.value, 1e-5) + [1.3e-5, 0.0, -5.2e-5]
            streams["magnetometer"] = dataclasses.replace(samples, value=held)
        elif fault == "zero":
            streams["magnetometer"] = dataclasses.replace(samples, value=0.0 * samples.value)
        return Reading(reading.time, streams)

    rough = changed(platform, gyro={"noise": np.full(3, 0.02)})
    flight = flown(rough, 8.0, n=40, seed=2, spoil=spoil)
    sigma = np.sqrt(flight.covariance[..., 2, 2]).mean(axis=1)
    assert sigma[-1] > 1.02 * sigma[flight.time > 4.5][0]
    low, high = band(1, 40, 0.999)
    assert low < flight.squares([2], 7.9).mean() < high
    assert any("no sample of magnetometer could be used after 4" in r for r in flight.remarks)


def test_a_camera_whose_lateness_is_stated_is_as_good_as_its_covariance_says():
    late = changed(load_platform("astros"), attitude={"latency": 0.1})
    flight = flown(late, 3.0, n=50, seed=4)
    low, high = band(3, 50, 0.999)
    assert low < flight.squares(TURN, 2.9).mean() < high
    assert not any("scatters" in remark for remark in flight.remarks), flight.remarks


def test_a_camera_that_is_later_than_it_says_is_said():
    def spoil(reading: Reading) -> Reading:
        streams = dict(reading.streams)
        if "attitude" in streams:
            late = streams["attitude"]
            streams["attitude"] = dataclasses.replace(late, time=late.time + 0.1)
        return Reading(reading.time, streams)

    flight = flown(load_platform("astros"), 4.0, n=10, seed=4, spoil=spoil, rate=4.0 * RATE)
    said = " ".join(flight.remarks)
    assert "attitude" in said, said


def test_a_heading_that_no_sensor_shows_counts_from_the_start_and_its_sigma_grows():
    platform = load_platform("cubesat:imu")
    flight = flown(platform, 12.0, n=20, seed=6, rate=np.zeros(3))
    assert np.all(np.diff(flight.covariance[1:, :, 2, 2], axis=0) > 0.0)
    sigma = np.sqrt(flight.covariance[-1, :, 2, 2])
    most = heading_sigma(platform, 12.0)
    assert np.all((0.3 * most < sigma) & (sigma < 1.05 * most)), "a body that tips learns a little"
    assert np.abs(flight.turn[-1, :, 2] / sigma).max() < 4.0
    assert any("no sensor shows the heading" in remark for remark in flight.remarks)


def test_delay_of_a_low_pass_is_that_of_a_slow_ramp_through_it():
    """Of a first order 1 / w; of a second sqrt(2) / w."""
    for order, factor in ((1, 1.0), (2, np.sqrt(2.0)), (4, 2.6131259)):
        sensor = Sensor("gyro", 100.0, np.zeros(3), np.zeros(3), cutoff=10.0, order=order)
        assert delay_of(sensor) == pytest.approx(factor / (2.0 * np.pi * 10.0))
    assert delay_of(Sensor("gyro", 100.0, np.zeros(3), np.zeros(3))) == 0.0


def test_each_machine_without_the_attitude_stream_has_an_estimator_that_sees_it():
    for name in ("cubesat:imu", "tas2:imu"):
        assert usual_estimator(load_platform(name)) == "mekf"
    assert usual_estimator(load_platform("cubesat")) == "filter"
    assert usual_estimator(without("astros", "attitude")) == "inclinometer"


def test_a_machine_that_shows_no_vertical_is_refused_with_what_would_do():
    blind = without("cubesat", "attitude", "accelerometer")
    with pytest.raises(UsageError, match="attitude, accelerometer or inclinometer"):
        MultiplicativeFilter().init(blind, 1)


def test_spins_of_the_body_itself_are_not_taken_for_tilt():
    """At 1 rad/s the centripetal force at the IMU, 0.07 m off, would tip it by 0.4 deg."""
    platform = load_platform("cubesat:imu")
    perfect = {name: np.zeros(3) for name in ("noise", "bias")}
    exact = changed(platform, accelerometer=perfect, gyro=perfect)
    flight = flown(exact, 3.0, n=1, rate=np.array([0.0, 0.0, 1.0]))
    assert np.degrees(np.abs(flight.turn[-1, 0, :2])).max() < 0.01


def test_attitude_is_compared_with_the_one_of_its_own_time(bodies, with_sensor):
    """A sample that no latency foretold comes 0.15 s late, with its true stamp."""
    platform = with_sensor(attitude={"latency": 0.0})
    truth, law = bodies(platform, n=20, seed=8, swing=0.3), MultiplicativeFilter()
    late = dataclasses.replace(
        platform,
        sensors={**platform.sensors, "attitude": _with_latency(platform.sensors["attitude"], 0.15)},
    )
    truth.platform = late
    estimate = law.init(platform, 20)
    for reading in truth.readings(8.0):
        estimate = law.update(estimate, reading)
    off = to_rotation_vector(multiply(conjugate(estimate.attitude), truth.attitude))
    assert np.abs(off).max() < 3e-3, "it turned by 0.045 rad meanwhile"
    assert estimate.aids["attitude"].refused.sum() == 0


def _with_latency(sensor: Sensor, latency: float) -> Sensor:
    return dataclasses.replace(sensor, latency=latency)


def test_gravity_is_a_rotation_vector_apart_from_what_a_wrong_first_look_said():
    """Contradicted for longer than its patience, the estimate gives way and says how unsure it
    is."""
    platform = load_platform("cubesat:imu")
    law = MultiplicativeFilter(patience=1.0)
    tipped = from_rotation_vector(np.array([[0.4, 0.0, 0.0]]))
    estimate = law.init(platform, 1)
    readings = [*_still(platform, tipped, 3), *_still(platform, np.array([[1.0, 0, 0, 0]]), 60)]
    for k, reading in enumerate(readings, start=1):
        time = k * platform.tick
        streams = {
            name: Samples(s.value + 1e-9 * k, np.full((1, 1), time), s.valid)
            for name, s in reading.streams.items()
            if name != "magnetometer"
        }
        estimate = law.update(estimate, Reading(time, streams))
    assert np.abs(to_rotation_vector(estimate.attitude)[0, :2]).max() < 0.02


@pytest.mark.slow
def test_cubesat_balances_on_gyro_and_accelerometer_alone():
    """To less than the 43 uN m in the plane that its paper states."""
    platform = load_platform("cubesat:imu")
    plant = SimulatedPlant(
        platform, runs=range(3), initial=InitialState(attitude=from_euler_zyx(0.0, -0.02, 0.03))
    )
    law = load_controller("mass_magnetic_pid")
    names = law, parse_reference("hold"), SimulatedClock()
    with plant:
        fly(plant, MultiplicativeFilter(), *names, duration=60.0)
        moment = plant.truth()["truth_center_of_mass_offset"].value[:, 0]
    assert platform.gravity * np.hypot(moment[:, 0], moment[:, 1]).max() < 43e-6
