"""The `.rrd` is the log: to the last bit, for Rerun's own tools, and after any cut."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.processes import PATIENCE
from twin.errors import RecordingError
from twin.recording import Recording, Series, read_recording
from twin.recording.rrd import RrdFile
from twin.recording.rrd_reader import SCHEMA, SINGLE_MACHINE
from twin.stream.runfile import write_recording

FACTS = {"schema": SINGLE_MACHINE, "platform": "sads", "seed": 3, "note": "näher als 1 µm"}


@pytest.fixture
def rng(drawn_seed: int) -> np.random.Generator:
    """Of the test's seed."""
    return np.random.default_rng(drawn_seed)


def any_floats(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Every bit pattern alike: subnormals, infinities, NaN, 1e-300 and 1e300."""
    return rng.integers(0, 2**64, shape, dtype=np.uint64, endpoint=False).view(np.float64)


def any_recording(rng: np.random.Generator, rows: int = 300) -> Recording:
    streams = {
        name: Series(
            np.sort(np.nan_to_num(any_floats(rng, rows))),
            any_floats(rng, rows, width),
            tuple(f"c{i}" for i in range(width)),
            unit,
        )
        for name, width, unit in (
            ("gyro", 3, "rad/s"),
            ("attitude", 4, "1"),
            ("battery of the lab/2", 1, "V"),
            ("long", 2, "m"),
        )
    }
    long = rng.normal(size=(40_000, 2))
    streams["long"] = Series(np.cumsum(rng.exponential(size=40_000)), long, ("a", "b"), "m")
    streams["empty"] = Series(np.empty(0), np.empty((0, 2)), ("x", "y"), "N m")
    return Recording(streams, FACTS)


def assert_same(one: Recording, other: Recording) -> None:
    assert set(one) == set(other)
    assert dict(one.provenance) == dict(other.provenance)
    for name, series in one.items():
        copy = other[name]
        assert (series.columns, series.unit) == (copy.columns, copy.unit), name
        assert series.time.tobytes() == copy.time.tobytes(), f"times of {name} lost bits"
        assert series.value.tobytes() == copy.value.tobytes(), f"values of {name} lost bits"


def rerun(*words: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rerun_cli", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)


def test_what_is_written_is_read_to_the_last_bit(tmp_path: Path, rng):
    recording = any_recording(rng)
    write_recording(recording, tmp_path / "a.rrd")
    copy = read_recording(tmp_path / "a.rrd")
    assert_same(recording, copy)
    assert copy.repairs == ()


def test_rerun_verifies_the_file(tmp_path: Path, rng):
    write_recording(any_recording(rng), tmp_path / "a.rrd")
    verified = rerun("rrd", "verify", tmp_path / "a.rrd")
    assert verified.returncode == 0, verified.stderr


def test_rows_come_in_the_order_of_their_times_and_equal_times_as_written(tmp_path: Path):
    file = RrdFile(tmp_path / "a.rrd")
    file.provenance(FACTS)
    file.declare("s", ["v"], "1")
    for times, values in (([2.0, 1.0, 1.0], [20.0, 10.0, 11.0]), ([1.5, 1.0], [15.0, 12.0])):
        file.write({"s": (np.array(times), np.array(values)[:, None])})
    file.close()
    series = read_recording(tmp_path / "a.rrd")["s"]
    assert series.time.tolist() == [1.0, 1.0, 1.0, 1.5, 2.0]
    assert series.value[:, 0].tolist() == [10.0, 11.0, 12.0, 15.0, 20.0]


def test_earlier_repairs_travel_with_the_recording(tmp_path: Path):
    series = Series(np.zeros(1), np.zeros((1, 1)), ("x",), "m")
    write_recording(Recording({"s": series}, FACTS, ("3 rows sorted",)), tmp_path / "a.rrd")
    copy = read_recording(tmp_path / "a.rrd")
    assert copy.repairs == ("3 rows sorted",)
    assert dict(copy.provenance) == FACTS


def test_a_file_cut_at_any_byte_holds_all_that_was_written_before_the_cut(tmp_path: Path, rng):
    whole, cut = tmp_path / "whole.rrd", tmp_path / "cut.rrd"
    file = RrdFile(whole)
    file.provenance(FACTS)
    empty = whole.stat().st_size
    streams = {"gyro": 50, "attitude": 10, "command_wheel_torque": 10}
    for name in streams:
        file.declare(name, ["a", "b", "c"], "1")
    written: list[tuple[int, float]] = []
    for second in range(24):
        for half in (second, second + 0.5):
            file.write(
                {
                    name: (half + np.arange(m) * 0.5 / m, rng.normal(size=(m, 3)))
                    for name, m in streams.items()
                }
            )
            file.flush()
            written.append((whole.stat().st_size, half + 0.5))
    file.close()
    original = read_recording(whole)
    data = whole.read_bytes()

    for place in sorted(rng.integers(0, len(data), 12).tolist()):
        cut.write_bytes(data[:place])
        due = max((stop for size, stop in written if size <= place), default=None)
        if due is None and place < empty:
            with pytest.raises(RecordingError, match="nothing of a recording"):
                read_recording(cut)
            continue
        recording = read_recording(cut)
        assert len(recording.repairs) == 1
        assert "cut short" in recording.repairs[0]
        for name, series in recording.items():
            count = len(series)
            assert series.time.tobytes() == original[name].time[:count].tobytes()
            assert series.value.tobytes() == original[name].value[:count].tobytes()
            if due is not None:
                assert count >= np.searchsorted(original[name].time, due), f"cut at {place}: {name}"
        assert cut.read_bytes() == data[:place], "the user's file was changed"


@pytest.mark.parametrize("place", [0, 16, 200], ids=["header", "message", "payload"])
def test_a_damaged_middle_is_said_and_the_rest_is_read(tmp_path: Path, place: int):
    path = tmp_path / "a.rrd"
    file = RrdFile(path)
    file.provenance(FACTS)
    file.declare("s", ["v"], "1")
    sizes: list[int] = []
    for second in range(20):
        file.write({"s": (second + np.arange(10) / 10.0, np.ones((10, 1)))})
        file.flush()
        sizes.append(path.stat().st_size)
    file.close()
    data = bytearray(path.read_bytes())
    first = sizes[9] + place
    data[first : first + 64] = bytes(64)
    path.write_bytes(data)
    recording = read_recording(path)
    assert "damaged" in recording.repairs[0]
    assert len(recording["s"]) >= 100


def refused(path: Path) -> str:
    """What is said of a recording that cannot be read, after its path."""
    with pytest.raises(RecordingError) as error:
        read_recording(path)
    return str(error.value).removeprefix(f"{path}: ")


def test_a_newer_schema_is_refused_with_the_remedy(tmp_path: Path):
    file = RrdFile(tmp_path / "a.rrd")
    file.provenance({"schema": SCHEMA + 1})
    file.close()
    assert refused(tmp_path / "a.rrd") == (
        f"has schema version {SCHEMA + 1}, this twin reads up to {SCHEMA}; "
        "read it with a newer airbearing-twin"
    )


NOTHING = (
    "holds nothing of a recording that could be used; if it was cut this early, the run has to be "
    "repeated; if another program wrote it, export it as a folder log"
)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", NOTHING),
        (b"time,x\n0,1\n", "is no Rerun recording; name an .rrd, or a folder log"),
    ],
    ids=["empty", "a table"],
)
def test_a_file_that_is_no_recording_is_refused(tmp_path: Path, content: bytes, words: str):
    path = tmp_path / "a.rrd"
    path.write_bytes(content)
    assert refused(path) == words


def test_a_foreign_rerun_file_is_refused(tmp_path: Path):
    file = RrdFile(tmp_path / "a.rrd")
    file.close()
    assert refused(tmp_path / "a.rrd") == NOTHING


def test_a_missing_file_is_named(tmp_path: Path):
    assert refused(tmp_path / "a.rrd") == "there is no such recording; check the path"


def test_reading_leaves_no_copy_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rng):
    write_recording(any_recording(rng), tmp_path / "a.rrd")
    cut = tmp_path / "cut.rrd"
    cut.write_bytes((tmp_path / "a.rrd").read_bytes()[:-1000])
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    assert read_recording(cut).repairs
    assert list(scratch.iterdir()) == []
    shutil.rmtree(scratch)


def _rerun(*words: str) -> None:
    command = [sys.executable, "-m", "rerun_cli", "rrd", *words]
    subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE)


def test_a_file_that_reruns_tools_arranged_anew_reads_as_before(tmp_path: Path, rng):
    recording = any_recording(rng)
    write_recording(recording, tmp_path / "a.rrd")
    _rerun("optimize", str(tmp_path / "a.rrd"), "-o", str(tmp_path / "b.rrd"))
    assert_same(read_recording(tmp_path / "a.rrd"), read_recording(tmp_path / "b.rrd"))


def test_of_two_recordings_in_a_file_one_is_chosen_by_its_name(tmp_path: Path, rng):
    recordings = [any_recording(rng, rows) for rows in (20, 30)]
    for name, recording in zip("ab", recordings, strict=True):
        write_recording(recording, tmp_path / f"{name}.rrd")
    _rerun("merge", *(str(tmp_path / f"{n}.rrd") for n in "ab"), "-o", str(tmp_path / "two.rrd"))
    with pytest.raises(RecordingError, match="holds 2 recordings") as error:
        read_recording(tmp_path / "two.rrd")
    names = str(error.value).rpartition("name one of ")[2].split(", ")
    found = {len(one["gyro"]): one for one in (read_recording(tmp_path / name) for name in names)}
    for recording in recordings:
        one = found[len(recording["gyro"])]
        assert one["gyro"].value.tobytes() == recording["gyro"].value.tobytes()


def test_a_file_that_ends_the_process_of_reruns_reader_is_refused_and_the_next_is_read(
    tmp_path, rng
):
    """Arrow's names end at a zero byte, and Rerun's reader aborts where one stands inside."""
    import rerun as rr

    file = RrdFile(tmp_path / "bad.rrd")
    file.provenance(FACTS)
    file.rerun.log("note", rr.AnyValues(**{"a\0name": [1.0]}), static=True)
    file.close()
    with pytest.raises(RecordingError, match="nothing of a recording that could be used"):
        read_recording(tmp_path / "bad.rrd")
    recording = any_recording(rng, rows=5)
    write_recording(recording, tmp_path / "good.rrd")
    assert_same(recording, read_recording(tmp_path / "good.rrd"))
