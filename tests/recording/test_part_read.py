"""A part of a log is the same whether its files were read whole or for that part only."""

import json
import secrets
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer
from scipy.io import savemat

from twin.errors import LogError
from twin.recording import open_log, read_log, restricted
from twin.recording.formats import text_file

STREAMS = {
    "gyro": ("x", "y", "z"),
    "attitude": ("w", "x", "y", "z"),
    "command_wheel_torque": ("a", "b"),
    "joint_angle": ("turned",),
}
SECONDS = 400.0


def table_of(name: str, draw: np.random.Generator) -> np.ndarray:
    """Rows of times since 1970 and values: gaps, rows that come late, a sensor that starts late."""
    rate = draw.uniform(20.0, 60.0)
    time = np.arange(int(SECONDS * rate)) / rate
    value = draw.normal(size=(len(time), len(STREAMS[name])))
    if name == "attitude":
        value /= np.linalg.norm(value, axis=1, keepdims=True)
        value[:100] = 0.0
        value[500:900] = np.nan
    elif name == "joint_angle":
        value = np.mod(0.5 * time[:, None], 2.0 * np.pi)
    elif name.startswith("command"):
        time = time[::200]
        value = value[::200]
    else:
        value[:150] = np.nan
        kept = draw.random(len(time)) > 0.02
        time, value = time[kept], value[kept]
        late = draw.integers(200, len(time) - 5, 20)
        for row in late:
            order = [row + 1, row]
            time[row : row + 2], value[row : row + 2] = time[order], value[order]
    after = time > 250.0
    time[after] += draw.choice([0.0, 7200.0])  # a pause that is shortened, or a clock that goes on
    return np.column_stack([1.7e9 + time, value])


def write_log(folder: Path, draw: np.random.Generator, ending: str) -> None:
    tables = {name: table_of(name, draw) for name in STREAMS}
    keys = []
    for name, table in tables.items():
        names = ("t", *STREAMS[name])
        unit = 'unit = "N m"\n' if name.startswith("command") else ""
        keys.append(f'[streams.{name}]\nfile = "{name}.{ending}"\ntime = "t"\n{unit}')
        if ending == "mcap":
            columns = json.dumps(names[1:])
            keys[-1] += f'topic = "/a"\ncolumns = {columns}\n'
            with (folder / f"{name}.mcap").open("wb") as file:
                writer = Writer(file)
                writer.start()
                channel = writer.register_channel("/a", "json", 0)
                for row in table:
                    data = json.dumps(dict(zip(names, row.tolist(), strict=True)))
                    writer.add_message(channel, 1, data.encode(), 1)
                writer.finish()
        else:
            lines = "\n".join(",".join(map(repr, row)) for row in table.tolist())
            (folder / f"{name}.{ending}").write_text(f"{','.join(names)}\n{lines}\n")
    (folder / "log.toml").write_text("".join(keys))


@pytest.mark.parametrize("ending", ["csv", "mcap"])
@pytest.mark.parametrize("where", ["inside", "from", "until", "everything"])
def test_a_part_that_alone_was_read_is_that_of_the_whole_to_the_last_bit(
    tmp_path: Path, ending: str, where: str
):
    seed = secrets.randbits(32)
    print("seed", seed)
    draw = np.random.default_rng(seed)
    write_log(tmp_path, draw, ending)
    first, last = np.sort(draw.uniform(20.0, 380.0, 2)).tolist()
    start = None if where == "until" else -5.0 if where == "everything" else first
    stop = None if where == "from" else 1e4 if where == "everything" else last + 5.0
    whole = restricted(read_log(tmp_path), start=start, stop=stop, rate=None)
    part = open_log(tmp_path, start=start, stop=stop)
    assert set(part) == set(whole)
    assert part.repairs[-1] == whole.repairs[-1]
    assert part.provenance["time_origin"] == whole.provenance["time_origin"]
    for name, series in whole.items():
        np.testing.assert_array_equal(part[name].time, series.time, err_msg=name)
        same = part[name].value
        if name == "attitude":  # the sign of a quaternion goes on from the first that is read
            same = same * np.sign(np.sum(same * series.value, axis=1, keepdims=True))
        np.testing.assert_array_equal(same, series.value, err_msg=name)


def test_of_a_file_no_numbers_are_kept_but_those_of_the_part(tmp_path: Path, monkeypatch):
    write_log(tmp_path, np.random.default_rng(1), "csv")
    kept: list[int] = []
    taken = text_file.Tables.fill

    def spied(self, tables):
        kept.extend(len(rows) for names, rows in tables.items() if names != ("t",))
        taken(self, tables)

    monkeypatch.setattr(text_file.Tables, "fill", spied)
    log = open_log(tmp_path, start=100.0, stop=110.0)
    turned = len(read_log(tmp_path)["joint_angle"])
    wanted = sum(series.value.size for name, series in log.items() if name != "joint_angle")
    assert sum(kept[: len(STREAMS)]) < wanted + turned + 1000


def write_restarted(folder: Path, time: np.ndarray, ending: str) -> np.ndarray:
    """A gyro whose clock is `time` (m,) [s]; its values (m, 3)."""
    value = np.random.default_rng(0).normal(size=(len(time), 3))
    table = dict(zip(("t", "x", "y", "z"), np.column_stack([time, value]).T, strict=True))
    if ending == "csv":
        rows = np.column_stack(list(table.values())).tolist()
        lines = "\n".join(",".join(map(repr, row)) for row in rows)
        (folder / "gyro.csv").write_text(f"t,x,y,z\n{lines}\n")
    elif ending == "parquet":
        pq.write_table(pa.table(table), folder / "gyro.parquet")
    else:
        savemat(folder / "gyro.mat", table)
    keys = 'time = "t"\ncolumns = ["x", "y", "z"]\n'
    (folder / "log.toml").write_text(f'[streams.gyro]\nfile = "gyro.{ending}"\n{keys}')
    return value


@pytest.mark.parametrize("ending", ["csv", "parquet", "mat"])
def test_a_part_is_judged_by_the_rows_of_one_run_of_the_clock(tmp_path: Path, ending: str):
    first = np.arange(0.0, 100.0, 0.1)
    value = write_restarted(tmp_path, np.r_[first, first + 70.0], ending)
    with pytest.raises(LogError, match="goes back from 99.9 s to 70 s.*part on one side"):
        read_log(tmp_path)
    before = read_log(tmp_path, stop=50.0)
    assert np.array_equal(before["gyro"].value, value[:501])
    after = read_log(tmp_path, start=120.0)
    assert np.array_equal(after["gyro"].value, value[1500:])
    with pytest.raises(LogError, match="goes back from 99.9 s to 70 s.*`stop`"):
        read_log(tmp_path, start=60.0, stop=120.0)


@pytest.mark.parametrize("ending", ["csv", "parquet", "mat"])
def test_a_part_that_ends_before_the_clock_is_set_back_leaves_out_the_same_times_after_it(
    tmp_path: Path, ending: str
):
    first = np.arange(0.0, 100.0, 0.1)
    value = write_restarted(tmp_path, np.r_[first, first], ending)
    log = read_log(tmp_path, start=20.0, stop=60.0)
    assert np.array_equal(log["gyro"].value, value[200:601])
    assert any("401 rows after that" in repair for repair in log.repairs), log.repairs
