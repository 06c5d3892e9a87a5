"""A log.toml that cannot be followed is refused with its line and what would do."""

import os
from pathlib import Path

import pytest

from twin.errors import LogError
from twin.recording import open_log
from twin.recording.formats import ENDINGS
from twin.recording.log import read_log
from twin.recording.rows import LAYOUTS
from twin.signals import LOGGED

GYRO = '[streams.gyro]\nfile = "gyro.csv"\n'
ATTITUDE = '[streams.attitude]\nfile = "gyro.csv"\n'
ROWS = "t,x,y,z\n0,1,2,3\n1,4,5,6\n2,7,8,9\n"


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
            '[streams.gyro]\nfile = "gyro.pdf"\n',
            "log.toml:3: streams.gyro.file 'gyro.pdf' is no format that can be read; save it as "
            f"one of {', '.join(ENDINGS)}",
        ),
        (
            GYRO + 'unit = "degr/s"\n',
            "log.toml:4: streams.gyro.unit is 'degr/s'; no unit named 'degr/s' "
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
            GYRO + 'time_unit = "ticks"\n',
            "log.toml:4: streams.gyro.time_unit is 'ticks', no unit; use s, ms or us, or "
            "`time_scale`, the seconds of one count",
        ),
        (
            GYRO + 'time_unit = "ms"\ntime_scale = 1e-4\n',
            "log.toml:5: streams.gyro.time_scale is given beside `time_unit`; remove one of them",
        ),
        (
            GYRO + 'decimal = ";"\n',
            "log.toml:4: streams.gyro.decimal is ';'; use one of ',', '.'",
        ),
        (
            "start = 5\nstop = 4\n" + GYRO,
            "log.toml:3: stop is 4 s, and `start` 5 s; name a later time",
        ),
        (
            "start = 5\n" + GYRO,
            "log.toml:2: start leaves nothing: the log has 0 to 2 s; name times between",
        ),
        (
            GYRO + "rows = { x = 7.5 }\n",
            "log.toml:4: streams.gyro.rows picks none: no row has x = 7.5; correct it",
        ),
        (
            GYRO + "time_unit = 3\n",
            "log.toml:4: streams.gyro.time_unit is 3; give a text in quotes",
        ),
        (
            GYRO + "noise = 0.0\n",
            "log.toml:4: streams.gyro.noise is 0; give what a sample scatters by, or leave it out",
        ),
        (
            GYRO + 'scale = "auto"\n',
            "log.toml:4: streams.gyro.scale is 'auto'; give a number",
        ),
        (
            '[streams.zzz]\nfile = "gyro.csv"\n',
            f"log.toml:2: streams.zzz.unit is missing, and zzz is no stream we know "
            f"(known: {', '.join(sorted(LOGGED))}); name the stream so, or add its unit",
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
            GYRO + 'clock_lag = "late"\n',
            "log.toml:4: streams.gyro.clock_lag is 'late'; give a number in s",
        ),
        (
            GYRO + 'unit = "deg/s"\nscale = 0.01745\n',
            "log.toml:5: streams.gyro.scale is 0.01745, which is deg/s in rad/s, and `unit` "
            "converts already; remove `scale`, which multiplies what `unit` gives",
        ),
        (
            GYRO + "scale = 0\n",
            "log.toml:4: streams.gyro.scale is 0; give the factor to SI",
        ),
        (
            GYRO + "noise = -1.0\n",
            "log.toml:4: streams.gyro.noise holds -1 rad/s; it must be at least 0 rad/s",
        ),
        (
            GYRO + "rate = 0\n",
            "log.toml:4: streams.gyro.rate is 0 Hz; it must be at least 1e-06 Hz",
        ),
        (
            GYRO + 'rate = 10\ntime_unit = "ms"\n',
            "log.toml:5: streams.gyro.time_unit is given beside `rate`; remove the one or the "
            "other",
        ),
        (
            GYRO + 'format = "wxyz"\n',
            "log.toml:4: streams.gyro.format is for attitudes; remove it",
        ),
        (
            ATTITUDE + 'format = "zyx"\n',
            "log.toml:4: streams.attitude.format is 'zyx'; use one of "
            f"{', '.join(map(repr, LAYOUTS))}",
        ),
        (
            ATTITUDE + 'direction = "up"\n',
            "log.toml:4: streams.attitude.direction is 'up'; use one of 'body_to_world', "
            "'world_to_body'",
        ),
        (
            GYRO + 'columns = "x"\n',
            "log.toml:4: streams.gyro.columns is 'x'; give a list of texts in quotes",
        ),
        (
            GYRO + 'unit = "V"\n',
            "log.toml:4: streams.gyro.unit is 'V', but gyro is in rad/s; use a unit of "
            "rad/s, or add `scale`",
        ),
        (
            "[streams.gyro]\n",
            "log.toml:2: streams.gyro.file is missing; add it",
        ),
        (
            GYRO + "[environment]\nmagnetic_field = [22.0, 0.0, -42.0]\n",
            "log.toml:5: environment.magnetic_field is [22.0, 0.0, -42.0] T, and the earth's is "
            "25e-6 to 65e-6 T; give it in T: 1 uT is 1e-6 T, 1 G is 1e-4 T",
        ),
        (
            GYRO + "[environment]\ngravity = 9810\n",
            "log.toml:5: environment.gravity is 9810 m/s^2; it must lie between 0 and 100 m/s^2",
        ),
        (
            GYRO + "[environment]\nmagnetic_field = [1, 2]\n",
            "log.toml:5: environment.magnetic_field is [1, 2]; give 3 numbers in T",
        ),
        (
            "[streams]\n",
            "log.toml:2: streams.streams names no stream; add [streams.gyro] or another",
        ),
        ("", "log.toml: streams is missing; add it"),
    ],
)
def test_a_bad_log_toml_is_refused_with_its_line(
    folder_with, complaint, tmp_path: Path, toml: str, sentence: str
):
    assert complaint(folder_with(tmp_path, toml, gyro=ROWS)) == sentence


def test_an_endless_log_toml_is_refused(folder_with, complaint, tmp_path: Path):
    folder = folder_with(tmp_path, GYRO, gyro=ROWS)
    with (folder / "log.toml").open("ab") as file:
        file.truncate(1 << 36)
    assert complaint(folder) == (
        "log.toml: holds more than 1 MiB, so it is no settings; check the path"
    )


@pytest.mark.parametrize("way", ["symlink", "absolute", "up"])
def test_a_file_outside_the_folder_is_refused(complaint, tmp_path: Path, way: str):
    folder, secret = tmp_path / "log", tmp_path / "secret.csv"
    folder.mkdir()
    secret.write_text(ROWS)
    (folder / "link.csv").symlink_to(secret)
    name = {"symlink": "link.csv", "absolute": str(secret), "up": "../secret.csv"}[way]
    (folder / "log.toml").write_text(f'platform = "sads"\n[streams.gyro]\nfile = "{name}"\n')
    assert complaint(folder) == (
        f"log.toml:3: streams.gyro.file {name!r} lies outside the log's folder; move it beside"
    )


def test_what_is_no_file_is_refused(folder_with, complaint, tmp_path: Path):
    folder = folder_with(tmp_path, GYRO)
    os.mkfifo(folder / "gyro.csv")
    assert complaint(folder) == (
        "log.toml:3: streams.gyro.file 'gyro.csv' is no file; name the file of numbers"
    )


def test_noise_is_stated_for_all_columns_or_for_each(folder_with, complaint, tmp_path: Path):
    folder = folder_with(tmp_path, GYRO + "noise = [1e-3, 2e-3]\n", gyro=ROWS)
    assert complaint(folder) == (
        "log.toml:4: streams.gyro.noise has 2 numbers for 3 columns; "
        "give one for all, or one a column"
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
