"""What a balancing keeps of a swing is what its fit can be made of."""

from dataclasses import replace

import pytest

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.procedures.logbook import Logbook
from twin.reference import Hold


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
