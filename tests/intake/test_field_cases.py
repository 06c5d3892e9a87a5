"""Faults that labs' files have, drawn into a flight whose truth is known: read right, or refused.

Each kind is drawn. What a lab sees decides: the sentence of `twin show`, and the
moments of inertia of `twin identify` against those of the machine that flew.
"""

import json
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

import twin
from twin import rotation
from twin.cli.main import main
from twin.conventions import convention_advice, corrected
from twin.errors import TwinError
from twin.recording import Recording, Series

pytestmark = pytest.mark.slow

SEED = 20261130
J = np.array([3.0, 12.0, 12.0])
"""Of `sads` [kg m^2]."""
WIDE = 2.5
"""Half-widths of a 95 % interval within which a moment must lie: 1 in 10^6 by chance."""
STREAMS = ("gyro", "attitude", "wheel_speed", "command_wheel_torque", "accelerometer")


@pytest.fixture(scope="module")
def flight() -> Recording:
    """80 s of `sads`, all wheels at work."""
    run = twin.fly(
        "sads", "quaternion_pd", reference="multisine", duration=80.0, seed=11, keep=True
    )
    log = run.recording.without_truth()
    attitude = log["attitude"]
    up = np.broadcast_to([0.0, 0.0, 9.81], (len(attitude), 3))
    felt = rotation.rotate(rotation.conjugate(attitude.value), up)
    felt = felt + np.random.default_rng(5).normal(0.0, 0.02, felt.shape)
    accelerometer = Series(attitude.time, felt, ("x", "y", "z"), "m/s^2")
    return replace(log, streams={**log.streams, "accelerometer": accelerometer})


@pytest.fixture
def draw() -> np.random.Generator:
    print("seed", SEED)
    return np.random.default_rng(SEED)


class Files:
    """A lab's folder: a CSV a stream, which a test changes before it is written."""

    def __init__(self, log: Recording, folder: Path) -> None:
        self.folder = folder
        self.tables = {
            name: np.column_stack([log[name].time, log[name].value])
            for name in STREAMS
            if name in log
        }
        self.headers = {name: ",".join(["time", *log[name].columns]) for name in self.tables}
        self.facts: dict[str, list[str]] = {name: [] for name in self.tables}

    def write(self) -> Path:
        lines = ['platform = "sads"']
        for name, table in self.tables.items():
            text = "\n".join(",".join(f"{entry:.12g}" for entry in row) for row in table)
            (self.folder / f"{name}.csv").write_text(f"{self.headers[name]}\n{text}\n")
            lines += [f"[streams.{name}]", f'file = "{name}.csv"', *self.facts[name]]
        (self.folder / "log.toml").write_text("\n".join(lines) + "\n")
        return self.folder


@pytest.fixture
def files(flight: Recording, tmp_path: Path) -> Files:
    return Files(flight, tmp_path)


def shown(folder: Path) -> str:
    said = StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        main(["show", str(folder)])
    return said.getvalue()


def check_moments(log: Recording | Path) -> None:
    """J as the machine has it, within what the answer itself allows."""
    identification = twin.identify(log)
    moments, half = identification.theta[:3], identification.half_widths[:3]
    assert np.all(np.abs(moments - J) < WIDE * half), (moments, half)
    assert np.all(half < 0.1 * J), half


def test_a_flight_as_recorded_identifies_rightly(files: Files):
    check_moments(files.write())


def test_streams_in_ned_are_one_finding_whose_lines_mend_them(files: Files, draw):
    down = [1.0, -1.0, -1.0]
    turned = ["gyro", "accelerometer"]
    if draw.random() < 0.5:
        del files.tables["accelerometer"]
        turned.remove("accelerometer")
    for name in turned:
        files.tables[name][:, 1:] *= down
    files.tables["attitude"][:, 2:] *= down
    files.tables["attitude"] = files.tables["attitude"][:: draw.integers(1, 3)]
    log = twin.read(files.write())
    findings = convention_advice(log, twin.load("sads")).findings
    assert {finding.correction.kind for finding in findings} == {"frame"}
    assert len({finding.sentence for finding in findings}) == 1
    assert not findings[0].ambiguous
    check_moments(corrected(log, findings))


def test_a_clipped_gyro_is_counted_and_its_ends_are_left_out(files: Files, draw):
    gyro = files.tables["gyro"]
    end = float(np.quantile(np.abs(gyro[:, 1:]), draw.uniform(0.6, 0.85)))
    gyro[:, 1:] = np.clip(gyro[:, 1:], -end, end)
    folder = files.write()
    assert "the end of its range" in shown(folder)
    check_moments(folder)


def test_held_values_are_no_measurements(files: Files, draw):
    every = int(draw.integers(3, 12))
    attitude = files.tables["attitude"]
    attitude[:, 1:] = attitude[np.arange(len(attitude)) // every * every, 1:]
    folder = files.write()
    assert "repeat the one before" in shown(folder)
    check_moments(folder)


def test_a_packet_counter_gives_the_times_of_what_is_lost(flight: Recording, tmp_path: Path, draw):
    rate = float(draw.choice([10.0, 20.0, 50.0]))
    time = np.arange(flight.start, flight.stop, 1.0 / rate)
    names = [name for name in STREAMS if name in flight and name != "accelerometer"]
    table = np.column_stack([flight[name].interpolated_at(time) for name in names])
    kept = np.sort(draw.choice(len(time), int(draw.uniform(0.93, 0.98) * len(time)), replace=False))
    first = int(draw.integers(0, 60000))
    columns = [[f"{name}_{column}" for column in flight[name].columns] for name in names]
    counter = str(draw.choice(["PacketCounter", "seq", "sample"]))
    rows = [f"{first + k}," + ",".join(f"{x:.12g}" for x in table[k]) for k in kept]
    header = ",".join([counter, *(one for every in columns for one in every)])
    (tmp_path / "log.csv").write_text("\n".join([header, *rows]) + "\n")
    lines = ['platform = "sads"']
    for name, own in zip(names, columns, strict=True):
        listed = ", ".join(f'"{one}"' for one in own)
        lines += [f"[streams.{name}]", 'file = "log.csv"', f"columns = [{listed}]"]
        lines += [f'time = "{counter}"', f"rate = {rate}"]
    (tmp_path / "log.toml").write_text("\n".join(lines) + "\n")
    lost = kept[-1] - kept[0] + 1 - len(kept)
    assert f"{lost} rows of {kept[-1] - kept[0] + 1} lost" in shown(tmp_path)
    check_moments(tmp_path)


def test_a_clock_that_steps_is_set_back(files: Files, draw):
    step, at = draw.uniform(0.8, 3.0), draw.uniform(20.0, 60.0)
    for table in files.tables.values():
        table[table[:, 0] > at, 0] += step
    folder = files.write()
    said = shown(folder)
    (sentence,) = [line for line in said.splitlines() if "the clock of all streams steps" in line]
    size = float(sentence.split(" by ")[1].split()[0])
    assert abs(size - step) < 0.05
    check_moments(folder)


def test_a_reset_heading_is_turned_back(files: Files, draw):
    angle, at = draw.uniform(8.0, 60.0) * draw.choice([-1.0, 1.0]), draw.uniform(20.0, 60.0)
    attitude = files.tables["attitude"]
    turn = rotation.from_euler_zyx(np.radians(angle), 0.0, 0.0)
    after = attitude[:, 0] > at
    attitude[after, 1:] = rotation.multiply(turn, attitude[after, 1:])
    folder = files.write()
    assert "is reset by" in shown(folder)
    check_moments(folder)


def test_a_first_stamp_of_zero_is_parted_from_the_rest(files: Files, draw):
    late = draw.uniform(1e8, 2e9)
    one = str(draw.choice(["gyro", "attitude", "wheel_speed"]))
    for name, table in files.tables.items():
        table[:, 0] += late
        if name == one:
            table[0, 0] = 0.0
    folder = files.write()
    assert "no stream has a row from" in shown(folder)
    check_moments(folder)


def test_ticks_are_named_with_their_scale(files: Files, draw):
    tick = float(draw.choice([1e-3, 1e-4, 1e-6]))
    for table in files.tables.values():
        table[:, 0] = np.round(table[:, 0] / tick)
    folder = files.write()
    line = {1e-3: 'time_unit = "ms"', 1e-6: 'time_unit = "us"'}.get(tick, f"time_scale = {tick:g}")
    assert line in shown(folder)
    with pytest.raises(TwinError, match=r"time_(scale|unit)"):
        twin.identify(folder)
    for name in files.tables:
        files.facts[name].append(f"time_scale = {tick:g}")
    check_moments(files.write())


@pytest.mark.parametrize("unit", ["deg s^-1", "degrees/s", "DPS", "mrad/s"])
def test_a_unit_in_a_header_asks_for_its_line(files: Files, unit: str):
    scale = 1e3 if unit == "mrad/s" else np.degrees(1.0)
    files.tables["gyro"][:, 1:] *= scale
    files.headers["gyro"] = "time," + ",".join(f"{axis} [{unit}]" for axis in "xyz")
    folder = files.write()
    assert f'unit = "{unit}"' in shown(folder)
    files.facts["gyro"].append(f'unit = "{unit}"')
    check_moments(files.write())


@pytest.mark.parametrize("size", [1e6, 1e9])
def test_commas_of_thousands_are_read_where_they_can_be_nothing_else(
    files: Files, draw, size: float
):
    scale = size * draw.uniform(1.0, 5.0)
    table = files.tables.pop("gyro")
    rows = [f"{t:.3f};" + ";".join(f"{round(x * scale):,}" for x in row) for t, *row in table]
    folder = files.write()
    (folder / "gyro.csv").write_text("\n".join(["time;x;y;z", *rows]) + "\n")
    with (folder / "log.toml").open("a") as text:
        text.write(f'[streams.gyro]\nfile = "gyro.csv"\nscale = {1.0 / scale:g}\n')
    if size == 1e9:
        assert "commas of thousands left out" in shown(folder)
        check_moments(folder)
        return
    assert 'decimal = ","' in shown(folder)
    with pytest.raises(TwinError, match=r"decimal = "):
        twin.identify(folder)


def test_blank_and_odd_first_lines_are_passed(files: Files, draw):
    folder = files.write()
    lines = ["", "   ", "\t"][: int(draw.integers(1, 4))]
    for path in folder.glob("*.csv"):
        path.write_text("\n".join([*lines, path.read_text()]))
    check_moments(folder)


def _runs(draw: np.random.Generator, count: int) -> Iterator[tuple[int, int]]:
    for start in np.sort(draw.choice(np.arange(500, count - 500, 400), 3, replace=False)):
        yield int(start), int(start + draw.integers(50, 150))


def test_rows_out_of_order_and_twice_are_mended_or_refused_by_line(files: Files, draw):
    gyro = files.tables["gyro"]
    for start, stop in _runs(draw, len(gyro)):
        gyro[start:stop] = gyro[start:stop][::-1]
    folder = files.write()
    said = shown(folder)
    assert "gyro.csv" in said
    assert "order" in said or "back" in said, said[:400]


def test_a_column_of_steps_before_the_clock_is_no_time(files: Files, draw):
    step, clock = str(draw.choice(["Step", "row", "k"])), str(draw.choice(["Control_Time", "time"]))
    for name, table in files.tables.items():
        count = np.arange(float(len(table))) + draw.integers(0, 2)
        files.tables[name] = np.column_stack([count, table])
        columns = files.headers[name].split(",")[1:]
        files.headers[name] = ",".join([step, clock, *columns])
        files.facts[name].append(f"columns = {json.dumps(columns)}")
    folder = files.write()
    said = shown(folder)
    assert f"'{step}', its first column" in said
    assert f"`time = {json.dumps(clock)}`" in said
    for name in files.tables:
        files.facts[name].append(f'time = "{clock}"')
    check_moments(files.write())


def test_rows_of_several_kinds_are_parted_by_their_key(files: Files, draw):
    kinds = dict(zip(("gyro", "attitude"), draw.permutation(2).tolist(), strict=True))
    rows = [
        [t, kinds[name], *values, *[0.0] * (4 - len(values))]
        for name in kinds
        for t, *values in files.tables.pop(name)
    ]
    text = "\n".join(
        f"{kind} {t:.9g} " + " ".join(f"{x:.12g}" for x in values)
        for t, kind, *values in sorted(rows, key=lambda row: row[0])
    )
    folder = files.write()
    (folder / "both.txt").write_text(text + "\n")
    entries = {
        name: f'[streams.{name}]\nfile = "both.txt"\ntime = "2"\n'
        f"columns = {json.dumps([str(3 + k) for k in range(3 + (name == 'attitude'))])}\n"
        for name in kinds
    }
    written = (folder / "log.toml").read_text()
    (folder / "log.toml").write_text(written + "".join(entries.values()))
    assert 'rows = { "1" = 0 }' in shown(folder)
    picked = [f'{entry}rows = {{ "1" = {kinds[name]} }}\n' for name, entry in entries.items()]
    (folder / "log.toml").write_text(written + "".join(picked))
    check_moments(folder)
