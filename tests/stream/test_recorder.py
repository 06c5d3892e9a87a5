"""A recorder takes what the loop saw, all of it and nothing else, and says when it cannot."""

import os
import random
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from tests.processes import PATIENCE, wait_until
from twin.clock import SimulatedClock
from twin.errors import RecordingError
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.recording import read_recording
from twin.recording.rrd_reader import TIMELINE
from twin.signals import Command, Estimate, Reading, Samples, Target, Tick, stream_named
from twin.stream.blueprint import SAID
from twin.stream.provenance import provenance
from twin.stream.recorder import FileRecorder, MemoryRecorder


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


class Keeper:
    """Copies every tick as it comes."""

    def __init__(self) -> None:
        self.ticks: list[Tick] = []

    def collect(self, tick: Tick) -> None:
        reading, estimate, target, wanted, applied, truth, *_ = tick
        self.ticks.append(
            Tick(
                Reading(reading.time, {k: copied(s) for k, s in reading.streams.items()}),
                estimate.at(estimate.time),
                target,
                {k: v.copy() for k, v in wanted.items()},
                {k: v.copy() for k, v in applied.items()},
                {k: copied(s) for k, s in truth.items()},
            )
        )


def copied(samples: Samples) -> Samples:
    return Samples(samples.value.copy(), samples.time.copy(), samples.valid.copy())


def flown(platform: Platform, observers: Sequence, runs: Sequence[int] = (0,), duration=3.0):
    from twin.controller import load_controller
    from twin.estimators import load_estimator
    from twin.reference import parse_reference

    tilted = InitialState(attitude=np.array([0.999, 0.03, -0.02, 0.01]))
    plant = SimulatedPlant(platform, runs=runs, seed=5, initial=tilted)
    law, clock = load_controller("quaternion_pd"), SimulatedClock()
    reference = parse_reference("multisine:5")
    estimator = load_estimator("filter")
    fly(plant, estimator, law, reference, clock, duration=duration, observers=observers)


def tick_at(time: float, run_values: Sequence[float]) -> Tick:
    """A tick whose numbers tell the run; run i lost gyro sample i of two."""
    n = len(run_values)
    values = np.array(run_values)
    valid = np.ones((n, 2), dtype=np.bool_)
    valid[np.arange(min(n, 2)), np.arange(min(n, 2))] = False
    gyro = Samples(
        np.tile(values[:, None, None], (1, 2, 3)), np.tile([time - 0.01, time], (n, 1)), valid
    )
    level = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    three, none = np.tile(values[:, None], (1, 3)), np.empty((n, 0))
    seen = np.array([value > 0.0 for value in run_values])
    estimate = Estimate(time, level, three, three, three, none, none, three, seen)
    command: Command = {"command_wheel_torque": three}
    return Tick(Reading(time, {"gyro": gyro}), estimate, Target(level[0]), command, command, {})


def test_a_file_holds_what_memory_holds_to_the_last_bit(sads, tmp_path: Path):
    memory = MemoryRecorder(sads, {"schema": 1})
    with FileRecorder(tmp_path / "a.rrd") as recorder:
        recorder.start(sads, {"schema": 1})
        flown(sads, [recorder, memory])
    kept, written = memory.recording(), read_recording(tmp_path / "a.rrd")
    assert set(kept) == set(written)
    for name, series in kept.items():
        assert series.time.tobytes() == written[name].time.tobytes(), name
        assert series.value.tobytes() == written[name].value.tobytes(), name
        assert series.unit == written[name].unit == stream_named(name).unit
        assert series.columns == written[name].columns == sads.columns(name)
    assert written.repairs == ()
    command = [sys.executable, "-m", "rerun_cli", "rrd", "verify", tmp_path / "a.rrd"]
    done = subprocess.run(command, timeout=PATIENCE)
    assert done.returncode == 0


def test_what_is_said_of_a_moment_stands_beside_it_and_is_no_stream(sads, tmp_path: Path):
    path = tmp_path / "a.rrd"
    with FileRecorder(path) as recorder:
        recorder.start(sads, {"schema": 1}, remarks=True)
        flown(sads, [recorder])
        recorder.say(0.25, "swing: swinging, hardly damped")
    chunks = RrdReader(path).stream()
    (said,) = [one.to_record_batch() for one in chunks if one.entity_path == f"/{SAID}"]
    assert said.column("TextLog:text").to_pylist() == [["swing: swinging, hardly damped"]]
    assert said.column(TIMELINE).cast("int64").to_pylist() == [250_000_000]
    assert not any("said" in name for name in read_recording(path))


def test_nobody_in_the_loop_writes_to_what_a_recorder_keeps(sads):
    memory, keeper = MemoryRecorder(sads), Keeper()
    flown(sads, [keeper, memory], runs=(0, 1, 2))
    copies = MemoryRecorder(sads)
    for tick in keeper.ticks:
        copies.collect(tick)
    for run in range(3):
        referred, copied_then = memory.recording(run), copies.recording(run)
        for name, series in copied_then.items():
            assert series.value.tobytes() == referred[name].value.tobytes(), (
                f"{name}: an array was written to after it had been handed over"
            )


def test_all_that_a_run_is_becomes_a_stream(sads):
    memory = MemoryRecorder(sads)
    flown(sads, [memory], duration=1.0)
    recording = memory.recording()
    ticks = np.arange(21) * sads.tick
    for name in ("command_wheel_torque", "wanted_wheel_torque", "reference_attitude"):
        assert recording[name].time.tolist() == ticks.tolist(), name
    assert {"gyro", "attitude", "wheel_speed", "stage_position"} <= set(recording)
    assert {"truth_attitude", "truth_rate", "truth_center_of_mass_offset"} <= set(recording)
    assert {"estimate_attitude", "estimate_rate", "estimate_gyro_bias"} <= set(recording)
    assert len(recording["gyro"]) > len(ticks)


def test_each_run_of_a_batch_is_recorded_by_itself(sads):
    memory = MemoryRecorder(sads)
    for time_ in (0.0, 0.05, 0.1):
        memory.collect(tick_at(time_, [1.0, -2.0, 3.0]))
    for run, value in enumerate((1.0, -2.0, 3.0)):
        recording = memory.recording(run)
        assert (recording["gyro"].value == value).all()
        assert (recording["wanted_wheel_torque"].value == value).all()


def test_rows_that_never_arrived_and_estimates_that_are_none_leave_no_row(sads):
    memory = MemoryRecorder(sads)
    for time_ in (0.0, 0.05):
        memory.collect(tick_at(time_, [1.0, -2.0, 3.0]))
    assert memory.recording(0)["gyro"].time.tolist() == [0.0, 0.05]
    assert memory.recording(1)["gyro"].time.tolist() == [-0.01, 0.04]
    assert memory.recording(2)["gyro"].time.tolist() == [-0.01, 0.0, 0.04, 0.05]
    assert "estimate_attitude" in memory.recording(0)
    assert "estimate_attitude" not in memory.recording(1), "the run had not been seen yet"


def test_a_writer_that_dies_is_said_in_a_sentence_and_nothing_hangs(sads, tmp_path: Path):
    recorder = FileRecorder(tmp_path / "a.rrd")
    recorder.start(sads, {"schema": 1})
    os.kill(recorder._writer._process.pid, signal.SIGKILL)
    recorder._writer._process.wait(PATIENCE)

    def record_a_second() -> None:
        for tick in range(21):
            recorder.collect(tick_at(0.05 * tick, [1.0]))

    with pytest.raises(RecordingError, match="process that writes it has ended.*was it killed"):
        record_a_second()
    with pytest.raises(RecordingError, match="has ended"):
        recorder.close()


def test_a_place_that_cannot_be_written_is_refused_at_once(tmp_path: Path):
    (tmp_path / "file").touch()
    for place in (tmp_path, tmp_path / "file" / "a.rrd"):
        with pytest.raises(RecordingError, match="cannot be written"):
            FileRecorder(place)


def test_two_runs_never_record_into_one_file(tmp_path: Path):
    with FileRecorder(tmp_path / "a.rrd"), pytest.raises(RecordingError, match="another run"):
        FileRecorder(tmp_path / "a.rrd")


def test_a_run_that_never_starts_leaves_the_old_recording_alone(sads, tmp_path: Path):
    new, old = tmp_path / "new.rrd", tmp_path / "old.rrd"
    old.write_bytes(b"precious")
    for path in (new, old):
        FileRecorder(path).close()
    assert not new.exists()
    assert old.read_bytes() == b"precious"


def test_reading_a_recording_that_goes_on_gives_what_there_is(sads, tmp_path: Path):
    path = tmp_path / "a.rrd"
    with FileRecorder(path) as recorder:
        recorder.start(sads, {"schema": 1})
        for tick in range(41):
            recorder.collect(tick_at(0.05 * tick, [1.0]))
        wait_until(lambda: path.stat().st_size >= 30_000)
        recording = read_recording(path)
    assert "still being written" in recording.repairs[0]
    assert read_recording(path).repairs == ()


def test_provenance_is_enough_to_repeat_the_run(sads, tmp_path: Path):
    facts = provenance(sads, seed=7, command=["twin", "run", "sads"])
    assert facts["platform"] == "sads"
    assert facts["seed"] == 7
    assert len(facts["platform_files"]["platform.xml"]) == 64
    assert facts["versions"].keys() >= {"airbearing-twin", "mujoco", "numpy", "rerun-sdk", "python"}
    assert facts["gravity"] == sads.gravity
    assert provenance(load_platform("sads:table1"), seed=None)["platform"] == "sads:table1"


def test_a_finished_recording_cut_at_any_byte_lacks_at_most_its_last_second(sads, tmp_path: Path):
    seed = random.randrange(2**32)
    print(f"seed {seed}")
    whole, cut = tmp_path / "whole.rrd", tmp_path / "cut.rrd"
    with FileRecorder(whole) as recorder:
        recorder.start(sads, {"schema": 1})
        flown(sads, [recorder], duration=15.0)
    data = whole.read_bytes()
    reached = []
    for place in sorted(random.Random(seed).sample(range(len(data)), 12)):
        cut.write_bytes(data[:place])
        try:
            recording = read_recording(cut)
        except RecordingError:
            assert not reached, "what opens with fewer bytes must open with more"
            continue
        assert recording.repairs
        ends = [series.time[-1] if len(series) else 0.0 for series in recording.values()] or [0.0]
        assert max(ends) - min(ends) <= 1.0, f"cut at {place}: a stream lags behind the others"
        reached.append((place, min(ends)))
    steps = np.diff([end for _, end in reached])
    assert len(reached) > 7
    assert (steps >= 0.0).all()
    assert reached[-1][1] > 12.5 * reached[-1][0] / len(data)
