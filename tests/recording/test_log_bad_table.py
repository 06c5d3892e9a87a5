"""A table that cannot be read is refused with file, line and remedy."""

import errno
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import PATIENCE

GYRO = '[streams.gyro]\nfile = "gyro.csv"\n'


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
            "gyro.csv:1: has no column names, but '"
            + 40 * "x"
            + "...' of 200000 characters; add them",
        ),
        (b"t,x\0\n0,1\n", "gyro.csv:1: is not text but binary; export it as CSV"),
        (b"t,x\n0,\xff\xfe\n", "gyro.csv:2: is not UTF-8 text; save it as CSV in UTF-8"),
        ("t,x,y,z\n", "gyro.csv:1: has column names but no rows; check the export"),
        (
            "t,x,y,z\n0,0,1,0,2,0,3,0\n",
            "gyro.csv:2: is a row of 8 under 4 column names; "
            "write decimal points, or separate the columns by semicolons",
        ),
        (
            "t,x,y,z\n[s],[deg/s],[deg/s],[deg/s]\n0,1,2,3\n",
            "log.toml:2: streams.gyro.unit is not given, and 'deg/s' stands below 'x'; add "
            '`unit = "deg/s"`, or `unit = "rad/s"` if that is wrong',
        ),
        (
            "t;x;y;z\n0;0,5;1;1\n1;0.5;1;1\n",
            "gyro.csv:3: column 'x' holds '0.5', and other numbers have decimal commas; write all "
            "alike, with points or with commas",
        ),
        (
            "x,y,z,Time [s]\n1,2,3,0\n1,2,3,1\n",
            "log.toml:3: streams.gyro.file has its times in 'x', its first column, unless `time` "
            'names another, and one is called \'Time [s]\'; add `time = "Time [s]"` (or "x")',
        ),
        (
            "t,wx [deg/s],wy [deg/s],wz [deg/s]\n0,1,2,3\n",
            "log.toml:2: streams.gyro.unit is not given, and a column is named 'wx [deg/s]'; add "
            '`unit = "deg/s"`, or `unit = "rad/s"` if that is wrong',
        ),
        (
            "time_ms,x,y,z\n0,1,2,3\n",
            "log.toml:2: streams.gyro.time_unit is not given, and the times are named 'time_ms'; "
            'add `time_unit = "ms"`, or `time_unit = "s"` if the name is wrong',
        ),
        (
            "sample,x,y,z\n" + "".join(f"{i},1,2,{i}\n" for i in range(9)),
            "log.toml:3: streams.gyro.file has its times in 'sample', its first column, and that "
            'counts rows; write `time = "z"` ("sample" if these are seconds), or give `rate`',
        ),
        (
            "t,x,y,z\n" + "".join(f"{i / 100 - 0.053 * (i > 20):.3f},1,2,{i}\n" for i in range(40)),
            "gyro.csv:23: time goes back from 0.2 s to 0.157 s, where no row was missing; its "
            "clock was set back: split the file there",
        ),
        (
            "t,x,y,z\n" + "".join(f"{0.1 * (7 * i % 10)},1,2,{i}\n" for i in range(10)),
            "gyro.csv: time goes back to 6 rows of 10: it is no clock; name the column of times as "
            "`time`, or give `rate`",
        ),
        (
            "t,x,y,z\n0,1,2,\n1,1,3,\n",
            "gyro.csv: has nothing in column 'z'; list the others in `columns`, and in `axes`",
        ),
        (
            't,x,y,z\n"0,0","1,5","2,0","3,0"\n',
            "gyro.csv:2: holds decimal commas, '0,0'; write decimal points, or separate the "
            "columns by semicolons",
        ),
        (
            "t;x;y;z\n0.0;1,5;2;3\n",
            "gyro.csv:2: column 't' holds '0.0', and other numbers have decimal commas; write all "
            "alike, with points or with commas",
        ),
        (
            "t,x,x,z\n0,1,2,3\n",
            "gyro.csv: names two columns 'x'; give each its own name, or list them in `columns` as "
            '"x.1" or "x.2"',
        ),
        (
            "t;x;y;z\n0;200,000;1;2\n1;199,990;1;2\n",
            "gyro.csv:2: holds '200,000', with a decimal comma or with one of thousands; write "
            '`decimal = ","` for the one, `decimal = "."` for the other',
        ),
        (
            "0,1,2,3\n1,4,5,6\n0,7,8,9\n1,4,5,7\n",
            "log.toml:3: streams.gyro.file begins each row with 0 or 1: rows of several "
            'kinds, it seems; pick those of gyro with `rows = { "1" = 0 }`, or all of them with '
            "`rows = {}`",
        ),
        (
            "t,wx [deg/sx],wy,wz\n0,1,2,3\n",
            "log.toml:2: streams.gyro.unit is not given, and 'deg/sx', which is no unit we know, "
            "stands by 'wx [deg/sx]'; add `unit = \"rad/s\"`, or the right one",
        ),
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
            "t,x,y,z\n0,1,2,3\n1, nan,2,3\n",
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
            "split the file there, or take a part on one side of it with `start` and `stop`",
        ),
    ],
)
def test_a_bad_table_is_refused_with_its_line(
    folder_with, complaint, tmp_path: Path, text: str | bytes, sentence: str
):
    assert complaint(folder_with(tmp_path, GYRO, gyro=text)) == sentence


LONG_LINE = (
    "holds a line of more than 1 MiB, so it is no table; export it as CSV with one row a line"
)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        (
            'columns = ["x", "x", "z"]',
            "log.toml:4: streams.gyro.columns lists 'x' twice; name each once",
        ),
        (
            'columns = ["t", "y", "z"]',
            "log.toml:4: streams.gyro.columns lists 't', which the times are taken from; take it "
            "out, name another `time`, or give `rate`",
        ),
        (
            'columns = ["x", "y"]\naxes = ["x", "x"]',
            "log.toml:5: streams.gyro.axes lists 'x' twice; name each once",
        ),
    ],
)
def test_a_column_that_stands_for_two_things_is_refused(
    folder_with, complaint, tmp_path: Path, keys: str, sentence: str
):
    folder = folder_with(tmp_path, f"{GYRO}{keys}\n", gyro="t,x,y,z\n0,1,2,3\n1,2,3,4\n")
    assert complaint(folder) == sentence


def test_a_first_column_that_counts_beside_a_clock_is_no_clock(
    folder_with, complaint, tmp_path: Path
):
    rows = "".join(f"{i},{0.06 * i:.2f},1,2,{i}\n" for i in range(5))
    toml = f'{GYRO}columns = ["x", "y", "z"]\n'
    assert complaint(folder_with(tmp_path, toml, gyro="Step,Control_Time,x,y,z\n" + rows)) == (
        "log.toml:3: streams.gyro.file has its times in 'Step', its first column, and that counts "
        'rows; write `time = "Control_Time"` ("Step" if these are seconds), or give `rate`'
    )


def test_degrees_that_nobody_called_so_are_asked_for(folder_with, complaint, tmp_path: Path):
    toml = '[streams.attitude]\nfile = "a.csv"\nformat = "euler_zyx"\n'
    folder = folder_with(tmp_path, toml, a="t,yaw,pitch,roll\n0,1,0.5,0.5\n1,46,0.5,0.5\n")
    assert complaint(folder) == (
        "log.toml:2: streams.attitude.unit is not given, and the angles reach 46; add "
        '`unit = "deg"`, or `unit = "rad"` if the body turned on and on'
    )


def test_one_giant_line_is_refused_before_the_rest_is_read(folder_with, complaint, tmp_path: Path):
    folder = folder_with(tmp_path, GYRO, gyro="t,x,y,z\n0,1,2,3\n")
    with (folder / "gyro.csv").open("ab") as file:
        file.truncate(1 << 36)  # sparse: 64 GiB that nobody can hold in memory
    assert complaint(folder) == f"gyro.csv:3: {LONG_LINE}"


def test_one_giant_line_costs_no_memory(folder_with, tmp_path: Path):
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
        [sys.executable, "-c", code, str(folder)],
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE,
    )
    said, peak = done.stdout.splitlines()
    assert said.endswith(f"gyro.csv:1: {LONG_LINE}")
    assert int(peak) < 100_000, "kB of memory"


@pytest.mark.parametrize(("number", "length"), [("0", "0"), ("1e200", "inf")])
def test_a_quaternion_of_no_length_or_an_endless_one_is_refused(
    folder_with, complaint, tmp_path: Path, number: str, length: str
):
    toml = '[streams.attitude]\nfile = "a.csv"\n'
    folder = folder_with(tmp_path, toml, a=f"t,w,x,y,z\n0,1,0,0,0\n1,{number},0,0,0\n")
    assert complaint(folder) == (
        f"a.csv:3: attitude has a quaternion of length {length}; check `format` and `columns`, "
        "or delete the row"
    )


@pytest.mark.parametrize("ending", ["csv", "mat", "mcap"])
def test_a_file_that_the_disk_does_not_give_is_refused(
    folder_with, complaint, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
):
    folder = folder_with(tmp_path, GYRO.replace("csv", ending))
    (folder / f"gyro.{ending}").write_bytes(b"")
    whole = Path.open

    def failing(path: Path, *how, **more):
        if path.suffix == f".{ending}":
            raise OSError(errno.EIO, "Input/output error")
        return whole(path, *how, **more)

    monkeypatch.setattr(Path, "open", failing)
    assert complaint(folder) == (
        f"gyro.{ending}: cannot be read (Input/output error); check the path"
    )
