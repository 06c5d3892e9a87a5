"""What an estimator states with a standard deviation: recorded, printed, in JSON and in view."""

from dataclasses import dataclass

import numpy as np
import pytest

import twin
from twin.api import read
from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import Passthrough, load_estimator
from twin.loop import fly
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.recording import Recording
from twin.reference import Hold
from twin.report.outcomes import estimated, flown
from twin.signals import Estimate, Quantity, Reading
from twin.stream.blueprint import blueprint
from twin.stream.recorder import MemoryRecorder
from twin.stream.rows import Header


@pytest.fixture(scope="module")
def offset_run():
    return twin.fly(
        "sads", estimator="offset", attitude=(0.05, 0.03, 0.0), rate=(0.0, 0.0, 0.05), duration=20.0
    )


def test_the_cm_that_a_filter_finds_is_recorded_with_its_sigma_and_holds_the_truth(offset_run):
    recording = offset_run.recording
    found = recording["estimate_center_of_mass_offset"]
    sigma = recording["estimate_center_of_mass_offset_sigma"]
    truth = recording["truth_center_of_mass_offset"]
    assert found.unit == sigma.unit == "kg m"
    np.testing.assert_array_equal(found.time, sigma.time)
    error = np.abs(found.value[-1] - truth.value[-1])
    assert (error < 4.0 * sigma.value[-1]).all()
    assert (sigma.value[-1] < 0.01 * sigma.value[0]).all()


def test_what_is_printed_and_in_json_is_the_last_row_of_the_recording(offset_run):
    last = offset_run.recording["estimate_center_of_mass_offset"].value[-1]
    document = offset_run.document()["estimates"]["center_of_mass_offset"]
    np.testing.assert_array_equal(document["value"], last)
    assert document["unit"] == "kg m"
    lines = flown(offset_run.platform, offset_run.outcome, offset_run.metrics, offset_run.settle)
    (line,) = (line for line in lines if line.startswith("estimated CM from CR"))
    shown = line.split("(")[1].split(")")[0].split(", ")
    um = last / offset_run.platform.mass * 1e6
    np.testing.assert_allclose([float(item.split(" +-")[0]) for item in shown], um, rtol=2e-3)


def test_the_filter_of_the_vertical_offset_states_that_alone():
    run = twin.fly("astros", estimator="vertical_offset", attitude=(0.1, 0.0, 0.0), duration=5.0)
    assert set(run.document()["estimates"]) == {"vertical_offset"}
    assert run.recording["estimate_vertical_offset"].value.shape[1] == 1
    (line,) = estimated(run.platform, run.outcome)
    assert line.startswith("estimated vertical offset")
    assert line.endswith("um (95 %)")


def test_the_attitude_filter_records_how_well_it_knows_attitude_and_bias():
    run = twin.fly("cubesat:imu", estimator="mekf", duration=10.0)
    sigma = run.recording["estimate_attitude_sigma"].value
    assert (sigma > 0.0).all()
    assert sigma[-1, 2] > 2.0 * sigma[10, 2], "nothing shows the heading, and its sigma grows"
    assert sigma[-1, :2].max() < sigma[-1, 2]
    assert "estimate_gyro_bias_sigma" in run.recording


def test_an_estimator_that_states_nothing_leaves_its_recording_as_it_was():
    run = twin.fly("sads", duration=1.0)
    names = {name for name in run.recording if name.startswith("estimate_")}
    assert names == {"estimate_attitude", "estimate_rate", "estimate_gyro_bias"}
    assert run.document()["estimates"] == {}


@dataclass(slots=True, kw_only=True)
class Warm(Estimate):
    warmth: float = 300.0

    def quantities(self) -> dict[str, Quantity]:
        n = len(self.valid)
        return {"warmth": Quantity(np.full((n, 1), 300.0), np.full((n, 1), 0.5), "K", ("all",))}


@dataclass(frozen=True)
class Thermometer(Passthrough):
    """A lab's own, with a name that nobody else knows."""

    def update(self, estimate: Estimate, reading: Reading) -> Warm:
        moved = super().update(estimate, reading)
        return Warm(**{name: getattr(moved, name) for name in Estimate.__dataclass_fields__})


def test_a_name_of_a_labs_own_is_recorded_with_its_unit(tmp_path):
    platform = load_platform("sads")
    plant = SimulatedPlant(platform, seed=0)
    memory = MemoryRecorder(platform, {"platform": "sads"})
    outcome = fly(
        plant,
        Thermometer(),
        load_controller("free_float"),
        Hold(),
        SimulatedClock(),
        duration=1.0,
        observers=[memory],
    )
    recording: Recording = memory.recording()
    assert recording["estimate_warmth"].unit == "K"
    assert recording["estimate_warmth_sigma"].columns == ("all",)
    assert estimated(platform, outcome) == ["estimated warmth 300.00 +- 0.98 K (95 %)"]


def test_a_file_has_what_the_memory_has_and_its_layout_a_plot_of_it(tmp_path):
    path = tmp_path / "run.rrd"
    run = twin.fly(
        "sads", estimator="offset", attitude=(0.05, 0.0, 0.0), duration=3.0, rrd=path, keep=True
    )
    name = "estimate_center_of_mass_offset_sigma"
    np.testing.assert_array_equal(read(path)[name].value, run.recording[name].value)
    headers = {n: Header(s.columns, s.unit) for n, s in run.recording.items()}
    platform = run.platform

    def titles(streams) -> list[str]:
        flight = blueprint(platform, streams=streams).root_container.contents[1]
        return [view.name for view in flight.contents]

    assert "center of mass offset and 1 sigma [kg m]" in titles(headers)
    plain = {name: header for name, header in headers.items() if not name.endswith("_sigma")}
    assert titles(plain) == titles(None)


def test_the_streams_of_a_batch_are_those_of_each_of_its_runs():
    platform = load_platform("astros")
    plant = SimulatedPlant(platform, runs=range(2), seed=0)
    memory = MemoryRecorder(platform, {"platform": "astros"})
    estimator = load_estimator("offset")
    law = load_controller("free_float")
    clock = SimulatedClock()
    fly(plant, estimator, law, Hold(), clock, duration=2.0, observers=[memory])
    one, two = (memory.recording(run)["estimate_center_of_mass_offset"].value for run in (0, 1))
    assert one.shape == two.shape
    assert not np.array_equal(one, two)
