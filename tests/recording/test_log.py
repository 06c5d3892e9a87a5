"""A measured log is read as it stands, mended aloud, or refused with file, line and remedy."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from twin import rotation
from twin.errors import LogError
from twin.library import library
from twin.recording import open_log
from twin.recording.log import read_log

PENDULUM = library("models") / "dfki_pendulum" / "logs"


def folder_with(tmp_path: Path, toml: str, **files: str | bytes) -> Path:
    (tmp_path / "log.toml").write_text('platform = "sads"\n' + toml)
    for name, content in files.items():
        path = tmp_path / f"{name}.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return tmp_path


GYRO = '[streams.gyro]\nfile = "gyro.csv"\n'
ROWS = "t,x,y,z\n0,1,2,3\n1,4,5,6\n2,7,8,9\n"


def complaint(folder: Path) -> str:
    with pytest.raises(LogError) as error:
        read_log(folder)
    return str(error.value).replace(f"{folder}{os.sep}", "")


@pytest.mark.parametrize(
    ("name", "rows", "end"),
    [
        ("sysid", 1170, 3.898),
        ("energy_shaping", 4000, 19.996),
        ("energy_shaping_1kg", 4000, 19.996),
    ],
)
def test_a_shipped_log_reads_without_repair(name: str, rows: int, end: float):
    log = read_log(PENDULUM / name)
    assert {stream: len(series) for stream, series in log.items()} == {
        "joint_angle": rows,
        "joint_rate": rows,
        "command_joint_torque": rows,
    }
    assert log.stop == pytest.approx(end, abs=1e-3)
    assert log.repairs == ()
    assert log["joint_angle"].columns == ("pivot",)


def test_log_toml_itself_may_be_named(tmp_path: Path):
    folder = folder_with(tmp_path, GYRO, gyro=ROWS)
    assert len(read_log(folder / "log.toml")["gyro"]) == 3


def test_units_times_columns_and_scale_become_si(tmp_path: Path):
    toml = (
        '[streams.gyro]\nfile = "a.csv"\ntime = "stamp"\ntime_unit = "ms"\n'
        'columns = ["wz", "wx", "wy"]\naxes = ["z", "x", "y"]\nunit = "deg/s"\nscale = 2.0\n'
        '[streams.oven]\nfile = "a.csv"\ntime = "stamp"\ntime_unit = "ms"\n'
        'columns = ["hot"]\nunit = "degC"\n'
    )
    text = "wx,hot,wy,wz,stamp\n1,20,2,3,0\n4,21,5,6,10\n"
    log = read_log(folder_with(tmp_path, toml, a=text))
    np.testing.assert_allclose(log["gyro"].time, [0.0, 0.01])
    np.testing.assert_allclose(log["gyro"].value[0], np.deg2rad([6.0, 2.0, 4.0]))
    assert log["gyro"].columns == ("z", "x", "y")
    np.testing.assert_allclose(log["oven"].value[:, 0], [293.15, 294.15])
    assert log["oven"].unit == "K"


def test_a_file_without_times_gets_them_from_rate_and_start(tmp_path: Path):
    log = read_log(
        folder_with(
            tmp_path, GYRO + "rate = 4.0\nstart = 1.0\n", gyro="x,y,z\n1,2,3\n" * 1 + "4,5,6\n"
        )
    )
    np.testing.assert_allclose(log["gyro"].time, [1.0, 1.25])


def test_fewer_columns_than_the_stream_are_named_by_axes(tmp_path: Path):
    log = read_log(folder_with(tmp_path, GYRO + 'axes = ["y"]\n', gyro="t,w\n0,1\n1,2\n"))
    assert log["gyro"].columns == ("y",)


def test_epoch_stamps_count_from_the_start_of_the_log(tmp_path: Path):
    text = "t,x,y,z\n1700000000.5,1,2,3\n1700000001.0,1,2,3\n"
    log = read_log(folder_with(tmp_path, GYRO, gyro=text))
    np.testing.assert_allclose(log["gyro"].time, [0.0, 0.5])
    assert log.provenance["time_origin"] == 1700000000.5


def test_notes_environment_and_stated_noise_are_kept(tmp_path: Path):
    toml = (
        GYRO + "noise = 1e-3\n[environment]\nmagnetic_field = [2e-5, 0, -4e-5]\n"
        '[notes]\noperator = "Ada"\nday = 2026-02-03\n'
    )
    facts = read_log(folder_with(tmp_path, toml, gyro=ROWS)).provenance
    assert facts["streams"]["gyro"]["noise"] == [1e-3]
    assert facts["environment"] == {"magnetic_field": [2e-5, 0.0, -4e-5]}
    assert facts["notes"] == {"operator": "Ada", "day": "2026-02-03"}
    assert facts["platform"] == "sads"


@pytest.mark.parametrize("layout", ["wxyz", "xyzw", "euler_zyx"])
@pytest.mark.parametrize("direction", ["body_to_world", "world_to_body"])
def test_every_attitude_format_gives_the_same_attitude(tmp_path: Path, layout: str, direction: str):
    generator = np.random.default_rng(1)
    vectors = np.cumsum(generator.normal(0.0, 0.4, (50, 3)), axis=0)
    attitude = rotation.from_rotation_vector(vectors)
    written = rotation.conjugate(attitude) if direction == "world_to_body" else attitude
    unit = ""
    if layout == "euler_zyx":
        table, unit = np.rad2deg(rotation.to_euler_zyx(written)), 'unit = "deg"\n'
    elif layout == "xyzw":
        table = written[:, [1, 2, 3, 0]]
    else:
        table = written
    names = ",".join("abcd"[: table.shape[1]])
    rows = "".join(f"{i},{','.join(map(repr, row.tolist()))}\n" for i, row in enumerate(table))
    toml = f'[streams.attitude]\nfile = "a.csv"\nformat = "{layout}"\ndirection = "{direction}"\n'
    log = read_log(folder_with(tmp_path, toml + unit, a=f"t,{names}\n{rows}"))
    got = log["attitude"].value
    np.testing.assert_allclose(rotation.matrix(got), rotation.matrix(attitude), atol=1e-12)
    assert np.all(np.sum(got[1:] * got[:-1], axis=1) >= 0.0), "the sign jumps"


def test_quaternions_off_length_are_scaled_and_counted(tmp_path: Path):
    toml = '[streams.attitude]\nfile = "a.csv"\n'
    log = read_log(folder_with(tmp_path, toml, a="t,w,x,y,z\n0,1,0,0,0\n1,1.01,0,0,0\n"))
    assert log.repairs == (
        "attitude (a.csv): 1 of 2 quaternions scaled to length 1, the worst was 1.01",
    )


def test_late_rows_are_sorted_and_counted(tmp_path: Path):
    text = "t,x,y,z\n0,1,1,1\n2,3,3,3\n1,2,2,2\n3,4,4,4\n"
    log = read_log(folder_with(tmp_path, GYRO, gyro=text))
    np.testing.assert_array_equal(log["gyro"].value[:, 0], [1, 2, 3, 4])
    assert log.repairs == ("gyro (gyro.csv): 1 row out of order sorted by time",)


def test_repeated_rows_are_dropped_and_counted(tmp_path: Path):
    text = "t,x,y,z\n0,1,1,1\n1,2,2,2\n1,2,2,2\n1,2,2,2\n2,3,3,3\n"
    log = read_log(folder_with(tmp_path, GYRO, gyro=text))
    assert len(log["gyro"]) == 3
    assert log.repairs == ("gyro (gyro.csv): 2 rows that repeat the one before dropped",)


def test_rows_without_a_number_are_left_out_and_counted(tmp_path: Path):
    toml = GYRO + '[streams.wheel_speed]\nfile = "gyro.csv"\ncolumns = ["w"]\n'
    toml = toml.replace(GYRO, GYRO + 'columns = ["x", "y", "z"]\n')
    text = "t,x,y,z,w\n0,1,2,3,\n1,NaN,nan,NA,5\n2,,,,6\n3,4,5,6,\n,,,,\n"
    log = read_log(folder_with(tmp_path, toml, gyro=text))
    np.testing.assert_array_equal(log["gyro"].time, [0.0, 3.0])
    np.testing.assert_array_equal(log["wheel_speed"].time, [1.0, 2.0])
    assert log.repairs == (
        "gyro (gyro.csv): 3 rows without a number left out",
        "wheel_speed (gyro.csv): 3 rows without a number left out",
    )


def test_rows_left_out_keep_the_times_of_a_file_without_times(tmp_path: Path):
    log = read_log(folder_with(tmp_path, GYRO + "rate = 2.0\n", gyro="x,y,z\n1,2,3\n,,\n4,5,6\n"))
    np.testing.assert_array_equal(log["gyro"].time, [0.0, 1.0])


def test_several_streams_keep_their_own_rates_and_gaps(tmp_path: Path):
    toml = GYRO + '[streams.attitude]\nfile = "mocap.csv"\ntime_unit = "ms"\n'
    mocap = "t,w,x,y,z\n" + "".join(f"{t},1,0,0,0\n" for t in (3, 7, 11, 90, 94))
    log = read_log(folder_with(tmp_path, toml, gyro=ROWS, mocap=mocap))
    np.testing.assert_allclose(log["attitude"].time, [0.003, 0.007, 0.011, 0.09, 0.094])
    np.testing.assert_array_equal(log["gyro"].time, [0.0, 1.0, 2.0])
    assert log.repairs == ()


def test_a_scale_to_fit_is_handed_on(tmp_path: Path):
    folder = folder_with(tmp_path, GYRO + 'unit = "V"\nscale = "fit"\n', gyro=ROWS)
    log = read_log(folder)
    assert log.provenance["streams"]["gyro"]["fit_scale"] is True
    assert log.provenance["streams"]["gyro"]["unit"] == "V"
    np.testing.assert_array_equal(log["gyro"].value[0], [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "gyro.csv: is empty; check the export"),
        (
            "t,x,y,z\n0,,,\n1,,,\n",
            "gyro.csv: has no number in x, y, z; name other `columns`",
        ),
        (
            "t,x,y,z\n0,1,2,3\n,1,2,3\n",
            "gyro.csv:3: column 't' holds nothing, which is no finite number; "
            "write the number, or delete the row",
        ),
        (
            "t,x,y,z\n0,1,2,3\n1,inf,2,3\n",
            "gyro.csv:3: column 'x' holds 'inf', which is no finite number; "
            "write the number, or delete the row",
        ),
        (
            b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\n",
            "gyro.csv:3: is not text but binary; export it as CSV",
        ),
        (b"\x7fELF" + bytes(5000), "gyro.csv:1: is not text but binary; export it as CSV"),
        (
            "x" * 200_000 + "\n1\n",
            "gyro.csv:1: has no column names (field larger than field limit (131072)); add them",
        ),
        (b"t,x\0\n0,1\n", "gyro.csv:1: is not text but binary; export it as CSV"),
        (b"t,x\n0,\xff\xfe\n", "gyro.csv:2: is not UTF-8 text; save it as CSV in UTF-8"),
        ("t,x,y,z\n", "gyro.csv:1: has column names but no rows; check the export"),
        (
            "0,1,2,3\n1,1,2,3\n",
            "gyro.csv:1: has a number in its first row; write the column names there",
        ),
        (
            "t;x;y;z\n0;1;2;3\n",
            "gyro.csv:1: separates its columns by semicolons; save it with commas",
        ),
        ("t,x,x,z\n0,1,2,3\n", "gyro.csv:1: names two columns 'x'; give each its own name"),
        (
            "t,x,y,z\n0,1,2,3\n\n1,2,3\n",
            "gyro.csv:4: is a row of 3 under 4 column names; complete the row or delete it",
        ),
        (
            "t,x,y,z\n0,1,2,3\n1,2,oops,3\n",
            "gyro.csv:3: column 'y' holds 'oops', which is no finite number; "
            "write the number, or delete the row",
        ),
        (
            "t,x,y,z\n0,1,2,3\n1,nan,2,3\n",
            "gyro.csv:3: column 'x' holds 'nan', which is no finite number; "
            "write the number, or delete the row",
        ),
        (
            "t,x,y,z\n0,1,2,3\n1,,2,3\n",
            "gyro.csv:3: column 'x' holds nothing, which is no finite number; "
            "write the number, or delete the row",
        ),
        (
            "t,x,y,z\n0,1,2,3\n1,1,2,3\n1,9,2,3\n",
            "gyro.csv:4: time 1 s stands on two rows with different values; "
            "correct the time, or delete one",
        ),
        (
            "t,x,y,z\n" + "".join(f"{i},{i},0,0\n" for i in range(50)) + "0,0,0,1\n1,0,0,1\n",
            "gyro.csv:52: time goes back from 49 s to 0 s; "
            "split the file where its clock starts anew",
        ),
    ],
)
def test_a_bad_table_is_refused_with_its_line(tmp_path: Path, text: str | bytes, sentence: str):
    assert complaint(folder_with(tmp_path, GYRO, gyro=text)) == sentence


@pytest.mark.parametrize(
    ("toml", "sentence"),
    [
        (
            '[streams.gyro]\nfile = "gone.csv"\n',
            "log.toml:3: streams.gyro.file 'gone.csv' is missing; add it, or correct the name",
        ),
        (
            '[streams.gyro]\nfile = "../gyro.csv"\n',
            "log.toml:3: streams.gyro.file '../gyro.csv' lies outside the log's folder; "
            "move it beside",
        ),
        (
            '[streams.gyro]\nfile = "gyro.xlsx"\n',
            "log.toml:3: streams.gyro.file 'gyro.xlsx' is no format that can be read; "
            "save it as one of .csv, .parquet, .mat, .mcap",
        ),
        (
            GYRO + 'unit = "degs/s"\n',
            "log.toml:4: streams.gyro.unit is 'degs/s'; no unit named 'degs/s' "
            "(did you mean 'deg/s', 'mdeg/s', 'deg/h'?)",
        ),
        (
            GYRO + 'unit = "mm"\n',
            "log.toml:4: streams.gyro.unit is 'mm', but gyro is in rad/s; "
            "use a unit of rad/s, or add `scale`",
        ),
        (
            GYRO + 'time_unit = "deg"\n',
            "log.toml:4: streams.gyro.time_unit is 'deg', a unit of rad; use s, ms or us",
        ),
        (
            '[streams.gyros]\nfile = "gyro.csv"\n',
            "log.toml:2: streams.gyros.unit is missing, and gyros is no stream we know "
            "(did you mean 'gyro'?); name the stream so, or add its unit",
        ),
        (
            GYRO + 'columns = ["x", "y"]\n',
            "log.toml:4: streams.gyro.columns gives gyro 2 columns (x, y) for x, y, z; "
            "list the right ones in `columns`, and in `axes` which of the stream they are",
        ),
        (
            GYRO + 'columns = ["x", "y", "zz"]\n',
            "gyro.csv:1: no column named 'zz' (did you mean 'z'?); name a column of its first row",
        ),
        (
            GYRO + 'axes = ["roll"]\n',
            "log.toml:4: streams.gyro.axes names 'roll'; use some of x, y, z",
        ),
        (
            GYRO + "color = 3\n",
            "log.toml:4: streams.gyro.color is no key we know; did you mean 'columns'?, "
            "or remove it",
        ),
        (
            "[streams]\n",
            "log.toml:2: streams.streams names no stream; add [streams.gyro] or another",
        ),
        ("", "log.toml: streams is missing; add it"),
    ],
)
def test_a_bad_log_toml_is_refused_with_its_line(tmp_path: Path, toml: str, sentence: str):
    assert complaint(folder_with(tmp_path, toml, gyro=ROWS)) == sentence


LONG_LINE = (
    "holds a line of more than 1 MiB, so it is no table; export it as CSV with one row a line"
)


def test_one_giant_line_is_refused_before_the_rest_is_read(tmp_path: Path):
    folder = folder_with(tmp_path, GYRO, gyro="t,x,y,z\n0,1,2,3\n")
    with (folder / "gyro.csv").open("ab") as file:
        file.truncate(1 << 36)  # sparse: 64 GiB that nobody can hold in memory
    assert complaint(folder) == f"gyro.csv:3: {LONG_LINE}"


def test_one_giant_line_costs_no_memory(tmp_path: Path):
    folder = folder_with(tmp_path, GYRO, gyro="t")
    with (folder / "gyro.csv").open("ab") as file:
        file.truncate(1 << 30)
    code = (
        "import re, sys\n"
        "from twin.errors import LogError\n"
        "from twin.recording import open_log\n"
        "try: open_log(sys.argv[1])\n"
        "except LogError as error: print(error)\n"
        "print(re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)], capture_output=True, text=True, check=True
    )
    said, peak = done.stdout.splitlines()
    assert said.endswith(f"gyro.csv:1: {LONG_LINE}")
    assert int(peak) < 100_000, "kB of memory"


def test_an_endless_log_toml_is_refused(tmp_path: Path):
    folder = folder_with(tmp_path, GYRO, gyro=ROWS)
    with (folder / "log.toml").open("ab") as file:
        file.truncate(1 << 36)
    assert complaint(folder) == (
        "log.toml: holds more than 1 MiB, so it is no settings; check the path"
    )


@pytest.mark.parametrize("way", ["symlink", "absolute", "up"])
def test_a_file_outside_the_folder_is_refused(tmp_path: Path, way: str):
    folder, secret = tmp_path / "log", tmp_path / "secret.csv"
    folder.mkdir()
    secret.write_text(ROWS)
    (folder / "link.csv").symlink_to(secret)
    name = {"symlink": "link.csv", "absolute": str(secret), "up": "../secret.csv"}[way]
    (folder / "log.toml").write_text(f'platform = "sads"\n[streams.gyro]\nfile = "{name}"\n')
    assert complaint(folder) == (
        f"log.toml:3: streams.gyro.file {name!r} lies outside the log's folder; move it beside"
    )


def test_what_is_no_file_is_refused(tmp_path: Path):
    folder = folder_with(tmp_path, GYRO)
    os.mkfifo(folder / "gyro.csv")
    assert complaint(folder) == (
        "log.toml:3: streams.gyro.file 'gyro.csv' is no file; name the file of numbers"
    )


def test_noise_is_stated_for_all_columns_or_for_each(tmp_path: Path):
    folder = folder_with(tmp_path, GYRO + "noise = [1e-3, 2e-3]\n", gyro=ROWS)
    assert complaint(folder) == (
        "log.toml:4: streams.gyro.noise has 2 numbers for 3 columns; "
        "give one for all, or one a column"
    )


def test_a_quaternion_of_no_length_is_refused(tmp_path: Path):
    toml = '[streams.attitude]\nfile = "a.csv"\n'
    folder = folder_with(tmp_path, toml, a="t,w,x,y,z\n0,1,0,0,0\n1,0,0,0,0\n")
    assert complaint(folder) == (
        "a.csv:3: attitude has a quaternion of length 0; check `format` and `columns`, "
        "or delete the row"
    )


def test_a_file_of_numbers_alone_is_refused_with_what_it_needs(tmp_path: Path):
    (tmp_path / "a.mcap").write_bytes(b"")
    with pytest.raises(LogError) as error:
        open_log(tmp_path / "a.mcap")
    assert str(error.value).endswith(
        "a.mcap: is a file of numbers that does not say what they are; put it into a folder with "
        "a log.toml that does (docs/logs.md), and name the folder"
    )


def test_a_log_that_is_no_folder_is_refused(tmp_path: Path):
    with pytest.raises(LogError, match="there is no such folder; name the folder that holds"):
        read_log(tmp_path / "nowhere")
