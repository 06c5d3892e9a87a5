"""What a balancing keeps of a swing is what its fit can be made of."""

from dataclasses import replace

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.procedures.logbook import FITTED, Logbook
from twin.reference import Hold
from twin.signals import Tick
from twin.stream.recorder import MemoryRecorder


@pytest.mark.parametrize(
    ("without", "kept"), [("attitude", {"gyro", "inclinometer"}), ("", {"gyro", "attitude"})]
)
def test_an_inclinometer_is_kept_where_no_attitude_is_measured(without, kept):
    whole = load_platform("astros")
    sensors = {name: sensor for name, sensor in whole.sensors.items() if name != without}
    platform = replace(whole, sensors=sensors)
    logbook = Logbook(platform)
    logbook.forget(0.0)
    fly(
        SimulatedPlant(platform),
        load_estimator("inclinometer" if without else "filter"),
        load_controller("mass_pid"),
        Hold(),
        SimulatedClock(),
        duration=0.5,
        observers=[logbook],
    )
    found = set(logbook.recording(0, 0.0)) & {"gyro", "attitude", "inclinometer", "accelerometer"}
    assert found == kept


class Forgetful(Logbook):
    """Forgets what is older than ten seconds."""

    def collect(self, tick: Tick) -> None:
        self.forget(tick.reading.time - 10.0)
        super().collect(tick)


def test_a_run_of_many_is_remembered_as_a_recorder_has_it():
    platform = load_platform("cubesat")
    lossy = {
        name: replace(sensor, dropout=0.2, latency=0.03)
        for name, sensor in platform.sensors.items()
    }
    platform = replace(platform, sensors=lossy)
    logbook, recorder = Forgetful(platform), MemoryRecorder(platform)
    fly(
        SimulatedPlant(platform, runs=range(3), seed=1),
        load_estimator("filter"),
        load_controller("mass_magnetic_pid"),
        Hold(),
        SimulatedClock(),
        duration=40.0,
        observers=[logbook, recorder],
    )
    for run, start in ((0, 30.0), (1, 33.3), (2, 39.9)):
        due = recorder.recording(run).between(start, np.inf)
        found = logbook.recording(run, start)
        fitted = FITTED - {"accelerometer"}  # beside an attitude it says little
        assert set(found) == {name for name in fitted if name in due and len(due[name])}
        for name, series in found.items():
            np.testing.assert_array_equal(series.time, due[name].time)
            if name != "stage_position":  # shown where the masses mostly stand
                np.testing.assert_array_equal(series.value, due[name].value)
            assert (series.columns, series.unit) == (due[name].columns, due[name].unit)
