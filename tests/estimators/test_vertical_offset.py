"""The printed filter of paper 001 for a vertical offset."""

import dataclasses

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.errors import UsageError
from twin.estimators import VerticalOffsetFilter, load_estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.reference import Hold
from twin.rotation import from_rotation_vector, vertical_body
from twin.signals import Reading, Samples

PITCHED = InitialState(attitude=from_rotation_vector(np.array([0.0, np.radians(10.0), 0.0])))


@pytest.fixture(scope="module")
def machine():
    """`astros` balanced in the plane, 50 um below the CR."""
    platform = load_platform("astros")
    return dataclasses.replace(
        platform, center_of_mass_offset=platform.mass * np.array([0.0, 0.0, -5e-5])
    )


class Kept:
    """Every tick's reading and estimate."""

    def __init__(self):
        self.readings, self.estimates = [], []

    def collect(self, tick):
        self.readings.append(tick.reading)
        self.estimates.append(tick.estimate)


def swung(machine, duration, runs=1, seed=3):
    kept = Kept()
    plant = SimulatedPlant(machine, runs=range(runs), seed=seed, initial=PITCHED)
    law = load_controller("free_float")
    estimator, clock = VerticalOffsetFilter(), SimulatedClock()
    fly(plant, estimator, law, Hold(), clock, duration=duration, observers=(kept,))
    assert not plant.stopped
    return kept


def test_offset_is_found_without_bias_where_nothing_else_acts(machine):
    kept = swung(machine, 60.0)
    late = [e.center_of_mass_offset for e in kept.estimates if e.time > 40.0]
    height = np.mean(late, axis=(0, 1)) / machine.mass
    np.testing.assert_allclose(height, [0.0, 0.0, -5e-5], rtol=0.04, atol=1e-12)


def test_one_run_agrees_with_a_textbook_filter(machine):
    kept, law = swung(machine, 10.0), VerticalOffsetFilter()
    peer = ExtendedKalmanFilter(4, 3)
    peer.x = np.zeros(4)
    peer.P = np.diag([law.rate_start] * 3 + [law.offset_start])
    peer.R = law.gyro_variance * np.eye(3)
    known, inertia, before = np.eye(3, 4), machine.inertia, None
    for reading, estimate in zip(kept.readings, kept.estimates, strict=True):
        gyro, fixes = reading.streams["gyro"], reading.streams["attitude"]
        for time, value, attitude in zip(gyro.time[0], gyro.value[0], fixes.value[0], strict=True):
            step = 0.0 if before is None else time - before
            pull = -machine.mass * machine.gravity * vertical_body(attitude)

            def change(x, pull=pull):
                torque = np.cross([0.0, 0.0, x[3]], pull)
                torque = torque - np.cross(x[:3], inertia @ x[:3])
                return np.append(np.linalg.solve(inertia, torque), 0.0)

            sides = 1e-6 * np.eye(4)
            slope = np.array([(change(peer.x + d) - change(peer.x - d)) / 2e-6 for d in sides]).T
            peer.x = peer.x + step * change(peer.x)
            onward = np.eye(4) + step * slope
            noise = np.diag([law.rate_process] * 3 + [law.offset_process])
            peer.P = onward @ peer.P @ onward.T + step * noise
            peer.update(value, lambda x: known, lambda x: x[:3])
            before = time
        np.testing.assert_allclose(estimate.state[0], peer.x, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(estimate.state_covariance[0], peer.P, rtol=1e-6, atol=1e-16)


def of_run(reading, row):
    cut = {
        name: Samples(s.value[[row]], s.time[[row]], s.valid[[row]])
        for name, s in reading.streams.items()
    }
    return Reading(reading.time, cut)


def test_run_has_the_same_estimate_alone_as_in_company(machine):
    kept, law = swung(machine, 3.0, runs=5), VerticalOffsetFilter()
    alone = law.init(machine, 1)
    for reading in kept.readings:
        alone = law.update(alone, of_run(reading, 2))
    together = kept.estimates[-1]
    np.testing.assert_allclose(alone.state, together.state[[2]], rtol=1e-12)


def test_lost_samples_tell_nothing_and_harm_nobody(machine):
    kept, law = swung(machine, 3.0, runs=2), VerticalOffsetFilter()
    whole, lossy = law.init(machine, 2), law.init(machine, 2)
    for reading in kept.readings:
        whole = law.update(whole, reading)
        gyro = reading.streams["gyro"]
        valid, value = gyro.valid.copy(), gyro.value.copy()
        valid[1], value[1] = False, np.nan
        holed = {**reading.streams, "gyro": Samples(value, gyro.time, valid)}
        lossy = law.update(lossy, Reading(reading.time, holed))
    np.testing.assert_array_equal(lossy.state[0], whole.state[0])
    np.testing.assert_array_equal(lossy.state[1], 0.0)


def test_machine_that_lacks_what_it_needs_is_told_what_would_do(machine):
    blind = dataclasses.replace(machine, sensors={"gyro": machine.sensors["gyro"]})
    with pytest.raises(UsageError, match="astros has no attitude; no estimator knows"):
        load_estimator("vertical_offset").init(blind, 1)
    with pytest.raises(UsageError, match="dfki_pendulum has no gyro"):
        VerticalOffsetFilter().init(load_platform("dfki_pendulum"), 1)
