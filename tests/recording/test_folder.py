"""`twin export`: the folder of tables holds the same numbers, whatever the format."""

import json
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet
from scipy.io import loadmat

from twin import rotation
from twin.cli.main import main
from twin.errors import RecordingError
from twin.recording import Recording, Series, open_log, read_log, write_folder
from twin.stream.runfile import write_recording


@pytest.fixture
def recording() -> Recording:
    rng = np.random.default_rng(11)
    columns = {
        "gyro": ("x", "y", "z"),
        "wheel_speed": ("w1", "w2"),
        "coil temperature": ("a",),
        "supply": ("time", "volt"),
        "truth_rate": ("x", "y", "z"),
    }
    units = {
        "gyro": "rad/s",
        "wheel_speed": "rad/s",
        "coil temperature": "K",
        "supply": "1",
        "truth_rate": "rad/s",
    }
    streams = {
        name: Series(
            np.cumsum(rng.exponential(size=200)),
            rng.normal(size=(200, len(names))) * 10.0 ** rng.integers(-300, 300, (200, 1)),
            names,
            units[name],
        )
        for name, names in columns.items()
    }
    turn = rotation.from_rotation_vector(rng.normal(size=3) * np.linspace(0.0, 1.0, 200)[:, None])
    streams["attitude"] = Series(streams["gyro"].time, turn, ("w", "x", "y", "z"), "1")
    still = Series(np.arange(3.0), np.full((3, 1), -0.0), ("s1",), "m")
    streams["stage_position"] = still
    facts = {
        "schema": 1,
        "platform": "sads",
        "seed": 4,
        "gravity": 9.7954,
        "notes": {"air": 'a "b"'},
    }
    return Recording(streams, facts)


@pytest.mark.parametrize("format", ["csv", "parquet", "mat", "mcap"])
@pytest.mark.parametrize("origin", ["memory", "rrd"])
def test_a_folder_reads_back_to_the_last_bit(recording, tmp_path: Path, origin: str, format):
    if origin == "rrd":
        write_recording(recording, tmp_path / "a.rrd")
        recording = open_log(tmp_path / "a.rrd")
    write_folder(recording, tmp_path / "log", truth=True, format=format)
    copy = open_log(tmp_path / "log")
    assert set(copy) == set(recording)
    for name, series in recording.items():
        assert copy[name].time.tobytes() == series.time.tobytes(), name
        assert copy[name].value.tobytes() == series.value.tobytes(), name
        assert (copy[name].columns, copy[name].unit) == (series.columns, series.unit)
    assert copy.provenance["platform"] == "sads"
    assert copy.provenance["environment"] == {"gravity": 9.7954}
    assert copy.provenance["notes"] == {"seed": 4, "air": 'a "b"'}


def test_parquet_and_mat_hold_the_same_numbers(recording, tmp_path: Path):
    tables = write_folder(recording, tmp_path / "parquet", format="parquet")
    matrices = write_folder(recording, tmp_path / "mat", format="mat")
    for name, path in tables.items():
        series = recording[name]
        table = parquet.read_table(path)
        clock, *columns = table.column_names
        assert columns == list(series.columns)
        assert table[clock].to_numpy().tobytes() == series.time.tobytes()
        for i, column in enumerate(series.columns):
            assert table[column].to_numpy().tobytes() == series.value[:, i].copy().tobytes()
        matrix = loadmat(matrices[name])[name.replace(" ", "_")]
        assert np.array_equal(matrix, np.column_stack([series.time, series.value]))


def test_true_states_are_written_on_request_only(recording, tmp_path: Path):
    assert "truth_rate" not in write_folder(recording, tmp_path / "a")
    assert "truth_rate" in write_folder(recording, tmp_path / "b", truth=True)


def test_a_stream_without_rows_is_mentioned(tmp_path: Path):
    empty = Series(np.empty(0), np.empty((0, 3)), ("x", "y", "z"), "rad/s")
    full = Series(np.zeros(1), np.zeros((1, 3)), ("x", "y", "z"), "T")
    write_folder(Recording({"gyro": empty, "magnetometer": full}), tmp_path / "a")
    assert "# gyro has no rows" in (tmp_path / "a" / "log.toml").read_text()


def test_a_folder_that_holds_something_is_not_touched(recording, tmp_path: Path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(RecordingError, match="not empty"):
        write_folder(recording, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_place_that_cannot_be_written_is_named(recording, tmp_path: Path):
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(RecordingError) as error:
        write_folder(recording, tmp_path / "taken")
    assert str(error.value) == (
        f"{tmp_path / 'taken'}: cannot be written: File exists; choose another place"
    )


def test_two_streams_never_share_a_file(tmp_path: Path):
    series = Series(np.zeros(1), np.zeros((1, 1)), ("x",), "m")
    with pytest.raises(RecordingError, match="two streams in one file"):
        write_folder(Recording({"a b": series, "a-b": series}), tmp_path / "a")


def test_the_command_exports_a_recording(recording, tmp_path: Path, capsys):
    write_recording(recording, tmp_path / "a.rrd")
    assert main(["export", str(tmp_path / "a.rrd"), str(tmp_path / "out"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["rows"]["coil temperature"] == 200
    assert set(document["rows"]) == set(recording) - {"truth_rate"}
    assert (tmp_path / "out" / "log.toml").exists()
    assert main(["export", str(tmp_path / "a.rrd"), str(tmp_path / "out")]) == 1
    assert "not empty" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "nowhere"), str(tmp_path / "out2")]) == 1
    assert "no such log" in capsys.readouterr().err


def test_a_log_without_a_platform_is_written_without_one(tmp_path: Path):
    series = Series(np.arange(3.0), np.ones((3, 3)), ("x", "y", "z"), "rad/s")
    write_folder(Recording({"gyro": series}, {}), tmp_path / "log")
    copy = open_log(tmp_path / "log")
    assert copy.provenance["platform"] is None
    assert "platform" not in (tmp_path / "log" / "log.toml").read_text()


def test_the_time_of_day_at_which_a_log_began_is_written_and_read_back(tmp_path: Path):
    streams = {"gyro": Series(np.arange(3.0), np.ones((3, 3)), ("x", "y", "z"), "rad/s")}
    write_folder(Recording(streams, {"kind": "log", "time_origin": 1.7e9}), tmp_path / "a")
    assert read_log(tmp_path / "a").provenance["time_origin"] == 1.7e9


def test_a_stream_whose_name_begins_with_a_sign_is_kept_in_a_mat(tmp_path: Path):
    streams = {"\N{DEGREE SIGN}temp": Series(np.arange(3.0), np.ones((3, 1)), ("a",), "K")}
    write_folder(Recording(streams, {"kind": "log"}), tmp_path / "a", format="mat")
    (back,) = read_log(tmp_path / "a").values()
    np.testing.assert_array_equal(back.value, 1.0)
