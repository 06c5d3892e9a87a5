"""Ticks stand where they should, and lateness is counted, never caught up."""

import gc
import os
import time

import numpy as np
import pytest

from twin.clock import SimulatedClock, WallClock, ahead_of_others


def test_simulated_ticks_are_whole_multiples_of_the_period_up_to_the_duration():
    ticks = list(SimulatedClock().ticks(0.05, 300.0))
    assert len(ticks) == 6001
    assert ticks[-1] == 6000 * 0.05
    assert ticks[4321] == 4321 * 0.05


@pytest.mark.parametrize(("duration", "count"), [(0.0, 1), (0.04, 1), (0.1, 3), (0.149, 3)])
def test_no_tick_lies_beyond_the_duration(duration, count):
    assert len(list(SimulatedClock().ticks(0.05, duration))) == count


def test_wall_ticks_come_no_earlier_than_their_time():
    clock = WallClock()
    start = time.monotonic()
    for tick in clock.ticks(0.01, 0.1):
        assert time.monotonic() - start >= tick
    assert clock.timing.ticks + clock.timing.overruns == 11
    assert len(clock.timing.lateness) == clock.timing.ticks


def test_a_tick_that_takes_too_long_costs_whole_ticks_and_no_burst_follows():
    clock = WallClock()
    seen = []
    for tick in clock.ticks(0.02, 0.4):
        seen.append(tick)
        if len(seen) == 3:
            time.sleep(0.09)
    assert clock.timing.overruns >= 4
    assert len(seen) + clock.timing.overruns == 21
    assert seen[3] >= seen[2] + 0.09, "a late loop must skip to the next tick in the future"


def test_a_wall_clock_tells_of_each_tick_how_late_it_came_and_what_it_took():
    clock, cycles = WallClock(), []
    for _ in clock.ticks(0.05, 0.1):
        time.sleep(0.003)
        clock.lap("read")
        cycles.append(clock.cycle())
        time.sleep(0.001)
        clock.lap("record")
    late, read, *_, record = np.array(cycles).T
    assert late.tolist() == clock.timing.lateness
    assert (read >= 0.003).all()
    assert record[0] == 0.0, "that of the tick before"
    assert (record[1:] >= 0.001).all()
    assert len(clock.timing.durations) == clock.timing.ticks
    assert min(clock.timing.durations) >= 0.004
    assert clock.timing.duration_at(100.0) == max(clock.timing.durations)


def test_time_that_is_simulated_costs_nothing_that_is_told():
    clock = SimulatedClock()
    for _ in clock.ticks(0.05, 0.1):
        assert clock.cycle() is None


def test_each_phase_is_timed():
    clock = SimulatedClock()
    for _ in clock.ticks(0.05, 0.1):
        clock.lap("read")
        time.sleep(0.002)
        clock.lap("control")
    assert clock.timing.seconds["control"] >= 0.006
    assert clock.timing.seconds["write"] == 0.0


needs_linux = pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="no SCHED_FIFO")


@needs_linux
def test_ahead_of_others_all_is_as_before_when_the_block_ends(monkeypatch):
    asked: list[tuple[int, int]] = []

    def noted(process: int, policy: int, param: os.sched_param) -> None:
        asked.append((policy, param.sched_priority))

    monkeypatch.setattr(os, "sched_setscheduler", noted)
    with ahead_of_others():
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0
    (begun, ended) = asked
    assert begun == (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 40), "what it starts has no priority"
    assert ended == (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority)


@needs_linux
def test_what_the_computer_does_not_permit_is_told_and_the_rest_is_had(monkeypatch):
    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    with ahead_of_others() as missing:
        assert "no priority (Operation not permitted): `twin doctor` says how" in missing[0]
        assert not gc.isenabled()
