"""The one loop: its order, its endings, and what it leaves behind when a run fails."""

import os
import signal

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.controller import Controller, load_controller
from twin.errors import UsageError
from twin.estimators import load_estimator
from twin.loop import Ended, Member, common_period, fly, fly_together
from twin.plant.replayed import ReplayedPlant
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.radio import Airwaves, Radio, Station
from twin.recording import Recording, Series
from twin.reference import Hold, Multisine
from twin.stream.recorder import FlightRecorder, MemoryRecorder


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


class Spoiled(Controller[None]):
    """Gives one run of the batch a torque that is no number, from a certain time on."""

    def __init__(self, runs: list[int], when: float) -> None:
        self.runs = runs
        self.when = when

    def init(self, platform, n):
        return None

    def update(self, state, estimate, target, time):
        torque = np.full((len(estimate.valid), 3), 0.01)
        if time >= self.when:
            torque[self.runs, 0] = np.nan
        return {"command_wheel_torque": torque}, None


def flown(plant, law, *, duration=5.0, reference=None, observers=()):
    return fly(
        plant,
        load_estimator("filter"),
        law,
        reference or Hold(),
        SimulatedClock(),
        duration=duration,
        observers=observers,
    )


def test_a_run_goes_to_its_end(sads):
    memory = MemoryRecorder(sads)
    law = load_controller("quaternion_pd")
    outcome = flown(SimulatedPlant(sads), law, observers=[memory])
    assert (outcome.ended, outcome.reason, outcome.duration) == (Ended.done, "", 5.0)
    recording = memory.recording()
    assert len(recording["command_wheel_torque"]) == 101
    assert len(recording["gyro"]) == 501
    assert len(recording["truth_attitude"]) == 101


def test_what_is_recorded_as_command_is_what_was_applied(sads):
    memory = MemoryRecorder(sads)
    law = load_controller("quaternion_pd", {"proportional": 200.0})
    plant = SimulatedPlant(sads)
    flown(plant, law, reference=Hold(roll=0.3), observers=[memory])
    recording = memory.recording()
    assert np.abs(recording["wanted_wheel_torque"].value).max() > 0.5
    assert np.abs(recording["command_wheel_torque"].value).max() == 0.5


def test_a_run_that_fails_leaves_its_last_two_seconds_and_the_others_go_on(sads):
    plant = SimulatedPlant(sads, runs=range(4))
    black_box = FlightRecorder(plant)
    outcome = flown(plant, Spoiled([2], when=3.0), observers=[black_box])
    assert outcome.ended is Ended.degraded
    assert outcome.reason == "1 of 4 runs were stopped"
    assert outcome.stopped == {2: "command_wheel_torque w1 is nan (at 3.000 s)"}
    record = black_box.records[2]
    assert record.start == pytest.approx(1.0, abs=0.051)
    assert record.stop == pytest.approx(3.0)
    assert np.isnan(record["wanted_wheel_torque"].value[-1, 0])
    assert record.provenance["reason"] == outcome.stopped[2]
    assert list(black_box.records) == [2]


def test_the_loop_ends_when_no_run_is_left(sads):
    plant = SimulatedPlant(sads, runs=range(2))
    outcome = flown(plant, Spoiled([0, 1], when=2.0))
    assert outcome.ended is Ended.failed
    assert outcome.duration == pytest.approx(2.0)
    assert "nan" in outcome.reason


def test_ctrl_c_ends_the_run_after_the_tick_in_hand(sads, hears):
    class Operator:
        ticks = 0

        def collect(self, tick):
            self.ticks += 1
            if self.ticks == 10:
                os.kill(os.getpid(), signal.SIGINT)

    operator, memory = Operator(), MemoryRecorder(sads)
    law = load_controller("free_float")
    outcome = flown(SimulatedPlant(sads), law, observers=[operator, memory])
    assert outcome.ended is Ended.safe_stop
    assert "stopped by the operator" in outcome.reason
    assert outcome.asked
    assert operator.ticks <= 11
    assert len(memory.recording()["truth_rate"]) == operator.ticks


def test_a_replayed_log_gives_the_loop_the_same_samples_at_the_same_ticks(sads):
    first, again = MemoryRecorder(sads), MemoryRecorder(sads)
    law = load_controller("quaternion_pd")
    flown(SimulatedPlant(sads, seed=5), law, reference=Multisine(), observers=[first])
    log = first.recording().without_truth()
    outcome = flown(ReplayedPlant(sads, log), law, reference=Multisine(), observers=[again])
    assert outcome.ended is Ended.done
    replayed = again.recording()
    for name in ("gyro", "attitude", "wheel_speed", "estimate_attitude", "wanted_wheel_torque"):
        np.testing.assert_array_equal(replayed[name].value, log[name].value, err_msg=name)
        np.testing.assert_array_equal(replayed[name].time, log[name].time, err_msg=name)
    np.testing.assert_array_equal(
        replayed["command_wheel_torque"].value, log["command_wheel_torque"].value
    )


def test_a_log_whose_streams_have_no_rows_cannot_be_replayed(sads):
    empty = Series(np.zeros(0), np.zeros((0, 3)), ("x", "y", "z"), "rad/s")
    nothing = Recording({"gyro": empty}, {})
    with pytest.raises(UsageError, match="no sample of what sads measures"):
        ReplayedPlant(sads, nothing)


def test_the_loop_is_its_parts_called_in_turn(sads):
    """To the last bit: read, estimate, control, write, and what they are told of one another."""
    memory, reference = MemoryRecorder(sads), Hold(roll=0.02)
    law, estimator = load_controller("quaternion_pd"), load_estimator("filter")
    flown(SimulatedPlant(sads), law, reference=reference, observers=[memory])
    plant, applied = SimulatedPlant(sads), []
    estimate, state = estimator.init(sads, 1), law.init(sads, 1)
    for now in SimulatedClock().ticks(sads.tick, 5.0):
        estimate = estimator.update(estimate, plant.read(now))
        command, state = law.update(state, estimate, reference.at(now), now)
        applied.append(plant.write(command))
        estimate = estimator.with_command(estimate, applied[-1])
    recording = memory.recording()
    for name in applied[0]:
        rows = np.concatenate([command[name] for command in applied])
        assert np.array_equal(recording[name].value, rows)


def several(platforms, observers, laws=None):
    reference, laws = Hold(roll=0.01), laws or ["quaternion_pd"] * len(platforms)
    return [
        Member(
            SimulatedPlant(platform),
            load_estimator("filter"),
            load_controller(law) if isinstance(law, str) else law,
            reference,
            [observer],
            Station(platform.name),
        )
        for platform, observer, law in zip(platforms, observers, laws, strict=True)
    ]


def test_machines_of_different_rates_have_their_ticks_where_they_have_them_alone(sads):
    whorl = load_platform("whorl1")
    assert (sads.control_rate, whorl.control_rate) == (20.0, 50.0)
    together = MemoryRecorder(sads), MemoryRecorder(whorl)
    members = several([sads, whorl], together)
    air = Airwaves(Radio(rate=5.0), [member.station for member in members], (0,), 0)
    fly_together(members, SimulatedClock(), duration=3.0, air=air)
    for platform, memory, other in zip((sads, whorl), together, ("whorl1", "sads"), strict=True):
        alone = MemoryRecorder(platform)
        (member,) = several([platform], [alone])
        fly_together([member], SimulatedClock(), duration=3.0)
        recording = memory.recording()
        for name, series in alone.recording().items():
            assert np.array_equal(series.time, recording[name].time), name
            assert np.array_equal(series.value, recording[name].value), name
        # both have a tick each 0.1 s, and a message is 0.2 s old at most
        assert np.allclose(recording[f"truth_relative_rate_to_{other}"].time, np.arange(31) * 0.1)
        assert recording[f"relative_age_to_{other}"].value.max() < 0.25


def test_a_run_of_several_ends_with_the_first_that_cannot_go_on(sads):
    whorl = load_platform("whorl1")
    members = several(
        [sads, whorl],
        [MemoryRecorder(sads), MemoryRecorder(whorl)],
        [Spoiled([0], when=1.0), "quaternion_pd"],
    )
    failed, halted = fly_together(members, SimulatedClock(), duration=5.0)
    assert failed.ended is Ended.failed
    assert halted.ended is Ended.safe_stop
    assert halted.reason == f"the run ended with sads: {failed.reason}"
    assert halted.duration == pytest.approx(1.0)


def test_rates_without_a_common_clock_are_refused():
    assert common_period([50.0, 50.0]) == (0.02, [1, 1])
    assert common_period([50.0, 20.0]) == (0.01, [2, 5])
    with pytest.raises(UsageError, match="41.123, 50 Hz have no common clock"):
        common_period([41.123, 50.0])
