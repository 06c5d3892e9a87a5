"""No estimate is valid, and no law begins, before stages and gimbals were seen."""

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.replayed import ReplayedPlant
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.recording import Recording, Series
from twin.reference import Hold
from twin.signals import Reading, Samples

FIRST = 0.2
"""When the late stream comes [s]."""

PLACES = np.array([0.003, -0.004, 0.005])
"""Of the stages at the start [m]."""


class Late(SimulatedPlant):
    """`astros`, of which a stream says nothing in some runs before `FIRST`."""

    def __init__(self, stream: str, late: list[bool]) -> None:
        start = InitialState(stage_position=PLACES)
        super().__init__(load_platform("astros"), runs=range(len(late)), initial=start)
        self._stream, self._late = stream, np.array(late)

    def read(self, until: float) -> Reading:
        reading = super().read(until)
        if until < FIRST - 1e-9 and self._stream in reading.streams:
            shown = reading.streams[self._stream]
            valid = shown.valid & ~self._late[:, None]
            value = np.where(valid[..., None], shown.value, np.nan)
            streams = {**reading.streams, self._stream: Samples(value, shown.time, valid)}
            return Reading(until, streams)
        return reading


class Kept:
    """Every tick."""

    def __init__(self) -> None:
        self.ticks = []

    def collect(self, tick) -> None:
        self.ticks.append(tick)


def flown(plant, estimator: str, law: str = "free_float"):
    kept = Kept()
    fly(
        plant,
        load_estimator(estimator),
        load_controller(law),
        Hold(),
        SimulatedClock(),
        duration=0.5,
        observers=[kept],
    )
    assert not plant.stopped
    return kept.ticks


@pytest.mark.parametrize("stream", ["stage_position", "gimbal_angle"])
@pytest.mark.parametrize(
    "estimator", ["filter", "passthrough", "inclinometer", "offset", "vertical_offset"]
)
def test_a_run_is_valid_once_its_positions_have_been_seen(estimator, stream):
    for tick in flown(Late(stream, [True, False]), estimator):
        seen = tick.reading.time > FIRST - 1e-9
        assert tick.estimate.valid.tolist() == [seen, True], f"at {tick.reading.time:.2f} s"


@pytest.mark.parametrize("late", [[True], [True, False]])
@pytest.mark.parametrize("law", ["mass_pid", "adaptive_balancing"])
def test_masses_stay_where_they_stand_until_they_have_been_seen(law, late):
    for tick in flown(Late("stage_position", late), "filter", law):
        told = tick.applied["command_stage_position"][0]
        if tick.reading.time < FIRST - 1e-9:
            np.testing.assert_allclose(told, PLACES, atol=1e-7, err_msg="sent towards 0")
        elif tick.reading.time < FIRST + 1e-9:
            np.testing.assert_allclose(told, PLACES, atol=1e-3, err_msg="it begins elsewhere")


def test_an_offset_is_not_led_astray_by_masses_that_are_seen_late():
    soon, late = (
        flown(Late("stage_position", [hidden]), "offset")[-1].estimate for hidden in (False, True)
    )
    apart = np.abs(late.center_of_mass_offset - soon.center_of_mass_offset)[0]
    spread = np.sqrt(np.diagonal(late.offset_covariance[0]))
    assert (apart < 4.0 * spread).all(), "a mass that is first seen has not leapt from 0"


def test_a_replayed_log_that_tells_no_positions_is_not_waited_for():
    times = 0.05 * np.arange(10)
    level = Series(times, np.tile([1.0, 0.0, 0.0, 0.0], (10, 1)), ("w", "x", "y", "z"), "1")
    log = Recording({"attitude": level})
    ticks = flown(ReplayedPlant(load_platform("astros"), log), "passthrough")
    assert ticks[0].estimate.valid.all()
