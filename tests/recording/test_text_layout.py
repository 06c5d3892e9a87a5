"""A table in a text file is found whatever stands above it and however its rows are written."""

import secrets
from pathlib import Path

import numpy as np
import pytest

from tests.seeds import seed_of
from twin.recording import read_log
from twin.recording.formats.text_layout import layout_of

GYRO = '[streams.gyro]\nfile = "gyro.csv"\n'


def text_of(head: str, rows: np.ndarray, separator: str, point: str = ".") -> str:
    cells = [[f"{x:.6f}".replace(".", point) for x in row] for row in rows]
    return head + "".join(separator.join(row) + "\n" for row in cells)


@pytest.fixture
def rows(request: pytest.FixtureRequest) -> np.ndarray:
    seed = seed_of(request)
    draw = np.random.default_rng(seed)
    count = int(draw.integers(20, 3000))
    return np.column_stack([0.01 * np.arange(count), draw.normal(size=(count, 3))])


@pytest.mark.parametrize(
    ("head", "separator", "point", "said"),
    [
        ("", ",", ".", "no column names: numbered 1 to 4"),
        ("", " ", ".", "no column names: numbered 1 to 4"),
        ("\n", ";", ",", "no column names: numbered 1 to 4"),
        ("# bench 2\n# third run\nt,x,y,z\n", ",", ".", "2 lines above the table"),
        ("Bench 2\n\nName: A. B.\n\nt;x;y;z\n", ";", ",", "2 lines above the table"),
        ("t\tx\ty\tz\n", "\t", ",", ""),
        ("  t    x    y    z\n", "   ", ".", ""),
        ("sep=;\nt;x;y;z\n", ";", ".", "1 line above the table"),
        ("t,x,y,z\ns,rad/s,rad/s,rad/s\n", ",", ".", ""),
        ("t,x,y,z\n[s],[rad s^-1],[rad s^-1],[rad s^-1]\n", ",", ".", ""),
    ],
)
def test_rows_are_read_from_below_whatever_stands_above(
    folder_with, tmp_path: Path, rows, head, separator, point, said
):
    log = read_log(folder_with(tmp_path, GYRO, gyro=text_of(head, rows, separator, point)))
    np.testing.assert_allclose(log["gyro"].time, rows[:, 0], atol=1e-6)
    np.testing.assert_allclose(log["gyro"].value, rows[:, 1:], atol=1e-6)
    assert any(said in repair for repair in log.repairs) if said else log.repairs == ()


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_other_encodings_of_text_are_read(folder_with, tmp_path: Path, rows, encoding: str):
    text = text_of("t;wx [°/s];wy [°/s];wz [°/s]\n", rows, ";", ",")
    toml = GYRO + 'unit = "deg/s"\n'
    log = read_log(folder_with(tmp_path, toml, gyro=text.encode(encoding)))
    np.testing.assert_allclose(log["gyro"].value, np.deg2rad(rows[:, 1:]), atol=1e-7)


def test_a_counter_beside_a_rate_makes_gaps_of_lost_samples(folder_with, tmp_path: Path, rows):
    draw = np.random.default_rng(len(rows))
    kept = np.sort(draw.permutation(len(rows))[: int(0.9 * len(rows))])
    kept[0] = 0
    first = int(draw.integers(0, 2**16))
    table = np.column_stack([(first + kept) % 2**16, rows[kept, 1:]])
    text = "packet,x,y,z\n" + "".join(f"{int(n)},{a},{b},{c}\n" for n, a, b, c in table)
    toml = GYRO + 'time = "packet"\nrate = 100\n'
    log = read_log(folder_with(tmp_path, toml, gyro=text))
    np.testing.assert_allclose(log["gyro"].time, 0.01 * (kept - kept[0]), atol=1e-9)
    lost = int(kept[-1]) + 1 - len(kept)
    assert any(f"{lost} row" in one and "by the counter" in one for one in log.repairs) or not lost


def test_a_column_that_is_only_called_like_a_counter_tells_no_times(
    folder_with, tmp_path: Path, rows
):
    """The steps of an experiment, beside a stated rate."""
    text = "step,x,y,z\n" + "".join(
        f"{i // 7},{a},{b},{c}\n" for i, (_, a, b, c) in enumerate(rows)
    )
    toml = GYRO + 'columns = ["x", "y", "z"]\nrate = 100\n'
    log = read_log(folder_with(tmp_path, toml, gyro=text))
    np.testing.assert_allclose(log["gyro"].time, rows[:, 0], atol=1e-9)


def test_ticks_are_seconds_by_time_scale(folder_with, tmp_path: Path, rows):
    table = rows * [1e4, 1.0, 1.0, 1.0]
    toml = GYRO + "time_scale = 1e-4\n"
    log = read_log(folder_with(tmp_path, toml, gyro=text_of("t,x,y,z\n", table, ",")))
    np.testing.assert_allclose(log["gyro"].time, rows[:, 0], atol=1e-9)


def test_thousands_and_decimal_commas_are_read_as_log_toml_says(folder_with, tmp_path: Path):
    text = "t;x;y;z\n0;200,000;1;2\n1;199,990;1;2\n"
    for mark, factor in ((",", 1.0), (".", 1e3)):
        toml = GYRO + f'decimal = "{mark}"\n'
        log = read_log(folder_with(tmp_path, toml, gyro=text))
        np.testing.assert_allclose(log["gyro"].value[:, 0], np.array([200.0, 199.99]) * factor)


def test_commas_that_can_only_be_of_thousands_are_left_out(folder_with, tmp_path: Path):
    text = "t;x;y;z\n0;1,200.5;1;2\n1;1,199.25;1;2\n"
    log = read_log(folder_with(tmp_path, GYRO, gyro=text))
    np.testing.assert_allclose(log["gyro"].value[:, 0], [1200.5, 1199.25])
    assert any("commas of thousands left out" in repair for repair in log.repairs)


def test_rows_of_one_kind_are_picked_by_a_key_column(folder_with, tmp_path: Path):
    text = "".join(f"{i % 2} {0.1 * i:.1f} {i} {2 * i} {-i}\n" for i in range(40))
    toml = GYRO + 'time = "2"\ncolumns = ["3", "4", "5"]\nrows = { "1" = 1 }\n'
    log = read_log(folder_with(tmp_path, toml, gyro=text))
    odd = np.arange(1.0, 40.0, 2.0)
    np.testing.assert_allclose(log["gyro"].time, 0.1 * odd)
    np.testing.assert_array_equal(log["gyro"].value, np.outer(odd, [1.0, 2.0, -1.0]))


def test_dates_are_seconds(folder_with, tmp_path: Path):
    text = "when,x,y,z\n" + "".join(
        f"2026-02-03 23:59:{59.5 + 0.1 * i:.1f},1,2,{i}\n" for i in range(5)
    )
    log = read_log(folder_with(tmp_path, GYRO, gyro=text))
    np.testing.assert_allclose(log["gyro"].time, 0.1 * np.arange(5), atol=1e-6)
    assert log.provenance["time_origin"] == pytest.approx(1770163199.5)


def test_a_part_of_a_log_is_read_and_said(folder_with, tmp_path: Path, rows):
    stop = float(rows[-1, 0])
    toml = f"start = {0.25 * stop}\nstop = {0.5 * stop}\n" + GYRO
    log = read_log(folder_with(tmp_path, toml, gyro=text_of("t,x,y,z\n", rows, ",")))
    assert log.start >= 0.25 * stop - 1e-9
    assert log.stop <= 0.5 * stop + 1e-9
    assert any("read from" in repair for repair in log.repairs)


def test_stamps_from_before_a_clock_was_set_lay_no_grid_over_years(
    folder_with, tmp_path: Path, rows
):
    stamps = 1.7e9 + rows[:, 0]
    stamps[0] = 0.0
    table = np.column_stack([stamps, rows[:, 1:]])
    log = read_log(folder_with(tmp_path, GYRO, gyro=text_of("t,x,y,z\n", table, ",")))
    assert log.stop - log.start < 60.0 + rows[-1, 0] + 1.0
    assert any("no stream has a row from 0 to 1.7e+09 s" in repair for repair in log.repairs)


def test_zeros_before_a_sensor_of_attitude_starts_are_left_out(folder_with, tmp_path: Path):
    text = "t,w,x,y,z\n0,0,0,0,0\n1,0,0,0,0\n2,1,0,0,0\n3,1,0,0,0\n"
    toml = '[streams.attitude]\nfile = "gyro.csv"\n'
    log = read_log(folder_with(tmp_path, toml, gyro=text))
    assert len(log["attitude"]) == 2
    assert any("2 rows of zeros before the sensor started" in one for one in log.repairs)


@pytest.mark.parametrize("layout", ["euler_xyz", "euler_zxz", "rotation_vector", "matrix"])
def test_attitudes_in_any_representation_become_the_same_quaternions(
    folder_with, tmp_path: Path, layout: str
):
    from scipy.spatial.transform import Rotation

    seed = secrets.randbits(32)
    print("seed", seed)
    turns = Rotation.random(50, random_state=seed % 2**31)
    if layout == "matrix":
        values = turns.as_matrix().reshape(-1, 9)
    elif layout == "rotation_vector":
        values = turns.as_rotvec()
    else:
        values = turns.as_euler(layout.removeprefix("euler_").upper())
    names = ",".join(f"c{i}" for i in range(values.shape[1]))
    rows = "".join(
        f"{i}," + ",".join(f"{x:.9f}" for x in row) + "\n" for i, row in enumerate(values)
    )
    toml = f'[streams.attitude]\nfile = "gyro.csv"\nformat = "{layout}"\n'
    log = read_log(folder_with(tmp_path, toml, gyro=f"t,{names}\n{rows}"))
    true = turns.as_quat(scalar_first=True)
    dot = np.abs(np.sum(true * log["attitude"].value, axis=1))
    np.testing.assert_allclose(dot, 1.0, atol=1e-8)


def test_a_mirror_is_no_attitude(folder_with, complaint, tmp_path: Path):
    row = "1,0,0,0,1,0,0,0,-1"
    toml = '[streams.attitude]\nfile = "gyro.csv"\nformat = "matrix"\n'
    text = "t," + ",".join(f"m{i}" for i in range(9)) + f"\n0,{row}\n1,{row}\n"
    assert "a matrix that is no rotation, but mirrors" in complaint(
        folder_with(tmp_path, toml, gyro=text)
    )


def test_names_of_objects_stand_before_those_of_their_columns():
    layout = layout_of(
        [
            "Format Version,1.23,Rotation Type,Quaternion",
            "",
            ",Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body",
            ",Name,Table,Table,Wand,Wand",
            ",,Rotation,Position,Rotation,Position",
            "Frame,Time (Seconds),X,X,X,X",
            "0,0.000,1,2,3,4",
            "1,0.010,1,2,3,4",
        ]
    )
    assert layout.names == (
        *("Frame", "Time (Seconds)", "Table.Rotation.X", "Table.Position.X"),
        *("Wand.Rotation.X", "Wand.Position.X"),
    )
    assert layout.first_line == 7
