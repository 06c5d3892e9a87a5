"""MAT files: matrices, vectors beside each other, structs; what is not numeric is refused."""

import io
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from twin.errors import LogError
from twin.recording.formats import ARRAYS, TEXTS

GYRO = '[streams.gyro]\nfile = "a.mat"\n'
RATES = np.arange(15.0).reshape(5, 3)
TIMES = np.arange(5.0)
CHOICE = "name one of its numeric variables in `variable`: "


def save(tmp_path: Path, **variables: object) -> None:
    savemat(tmp_path / "a.mat", variables)


@pytest.mark.parametrize("format", ["4", "5"])
@pytest.mark.parametrize("compressed", [False, True])
def test_of_a_matrix_the_first_column_is_the_time(log_of, tmp_path: Path, format, compressed):
    matrix = np.column_stack([TIMES, RATES])
    options = {"format": format, "do_compression": compressed and format == "5"}
    savemat(tmp_path / "a.mat", {"gyro": matrix}, **options)
    gyro = log_of(GYRO + 'variable = "gyro"\n')["gyro"]
    np.testing.assert_array_equal(gyro.time, TIMES)
    np.testing.assert_array_equal(gyro.value, RATES)


@pytest.mark.parametrize("shape", [(5, 1), (1, 5)])
def test_a_vector_of_times_may_stand_beside_the_matrix(log_of, tmp_path: Path, shape):
    save(tmp_path, t=TIMES.reshape(shape) * 1e3, gyr=RATES, info="day 3", rate=100.0)
    toml = 'variable = "gyr"\ntime = "t"\ntime_unit = "ms"\nunit = "deg/s"\n'
    gyro = log_of(GYRO + toml)["gyro"]
    np.testing.assert_allclose(gyro.time, TIMES)
    np.testing.assert_allclose(gyro.value, np.deg2rad(RATES))


def test_columns_of_a_matrix_are_numbered_from_one(log_of, tmp_path: Path):
    save(tmp_path, gyr=RATES)
    log = log_of(GYRO + 'variable = "gyr"\nrate = 10.0\ncolumns = ["3"]\naxes = ["z"]\n')
    np.testing.assert_array_equal(log["gyro"].value[:, 0], RATES[:, 2])
    np.testing.assert_allclose(log["gyro"].time, TIMES / 10.0)


def test_fields_of_structs_have_dotted_names(log_of, tmp_path: Path):
    imu = {"t": TIMES, "gyr": {"xyz": RATES}, "q": np.full((5, 4), 0.5), "name": "MTi"}
    save(tmp_path, log={"imu": imu})
    toml = GYRO + 'variable = "log.imu"\ntime = "t"\ncolumns = ["gyr.xyz.1", "gyr.xyz.2", "q.1"]\n'
    np.testing.assert_array_equal(log_of(toml)["gyro"].value[:, :2], RATES[:, :2])
    toml = '[streams.attitude]\nfile = "a.mat"\nvariable = "log.imu.q"\ntime = "log.imu.t"\n'
    np.testing.assert_array_equal(log_of(toml)["attitude"].value, 0.5)


def test_rows_of_nan_are_left_out_and_counted(log_of, tmp_path: Path):
    matrix = np.column_stack([TIMES, RATES])
    matrix[1:3, 1:] = np.nan
    save(tmp_path, gyro=matrix)
    log = log_of(GYRO)
    assert len(log["gyro"]) == 3
    assert log.repairs == ("gyro (a.mat): 2 rows without a number left out",)


def object_array() -> np.ndarray:
    cells = np.empty((2, 1), dtype=object)
    cells[:] = [[RATES], ["text"]]
    return cells


@pytest.mark.parametrize(
    ("variables", "variable", "sentence"),
    [
        ({"log": object_array()}, "log", "variable 'log' is a cell array"),
        (
            {"log": {"x": object_array()}},
            "log",
            "variable 'log' holds no numbers (log.x is a cell array)",
        ),
        ({"log": "hello"}, "log", "variable 'log' is text"),
        ({"log": RATES + 1j}, "log", "variable 'log' is a complex matrix"),
        ({"log": np.zeros((2, 2, 2))}, "log", "variable 'log' is an array of 3 dimensions"),
        (
            {"log": np.zeros((1, 3), dtype=[("a", object)])},
            "log",
            "variable 'log' is a struct array of 3",
        ),
        ({"log": RATES}, "gyro", "has no variable 'gyro'"),
    ],
)
def test_what_is_not_numeric_is_refused_with_what_is(
    complaint, tmp_path: Path, variables, variable, sentence
):
    save(tmp_path, **variables, t=TIMES[:, None])
    numeric = "log (5 x 3), t (5 x 1)" if variable == "gyro" else "t (5 x 1)"
    said = complaint(GYRO + f'variable = "{variable}"\n')
    assert said == f"a.mat: {sentence}; {CHOICE}{numeric}"


def test_a_column_that_is_not_there_is_refused(complaint, tmp_path: Path):
    save(tmp_path, gyr=RATES)
    toml = 'variable = "gyr"\nrate = 10.0\ncolumns = ["1", "2", "gyr.4"]\n'
    assert complaint(GYRO + toml) == (
        "a.mat: no column named 'gyr.4' (did you mean 'gyr.3', 'gyr.2', 'gyr.1'?); "
        "name one of its columns"
    )


def test_a_file_of_cells_only_is_refused(complaint, tmp_path: Path):
    save(tmp_path, log=object_array())
    assert complaint(GYRO) == (
        "a.mat: holds no numeric variable (log is a cell array); save numeric arrays in it"
    )
    assert complaint(GYRO + 'variable = "log"\n') == (
        "a.mat: variable 'log' is a cell array; save numeric arrays in it"
    )


def test_a_matrix_on_its_side_is_refused(complaint, tmp_path: Path):
    save(tmp_path, gyro=np.zeros((3, 500)))
    assert complaint(GYRO + "rate = 100.0\n") == (
        "a.mat: variable 'gyro' is 3 x 500, a sample a column; turn it in MATLAB: gyro = gyro.'"
    )


def test_columns_of_different_length_are_refused(complaint, tmp_path: Path):
    save(tmp_path, t=np.arange(4.0), gyr=RATES)
    assert complaint(GYRO + 'variable = "gyr"\ntime = "t"\n') == (
        "a.mat: has 4 samples in 't' and 5 in '1'; name `columns` of one length, or the right "
        "`time`"
    )


def test_a_matrix_without_times_is_asked_for_its_rate(complaint, tmp_path: Path):
    save(tmp_path, gyr=RATES)
    assert complaint(GYRO + 'variable = "gyr"\n') == (
        "log.toml:3: streams.gyro.file gives gyro 2 columns (2, 3) for x, y, z; give `rate` if "
        "the file has no times, else list the right ones in `columns`, and in `axes` which of the "
        "stream they are"
    )


@pytest.mark.parametrize("head", [b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3 MAT-file, Platform: GLNXA64"])
def test_a_damaged_file_of_version_7_3_is_refused(complaint, tmp_path: Path, head: bytes):
    (tmp_path / "a.mat").write_bytes(head.ljust(600, b" "))
    assert complaint(GYRO).startswith("a.mat: cannot be read as HDF5 (")


def test_a_variable_of_a_parquet_file_is_refused(complaint, tmp_path: Path):
    (tmp_path / "a.parquet").write_bytes(b"")
    kinds = ", ".join((*TEXTS, *ARRAYS))
    assert complaint('[streams.gyro]\nfile = "a.parquet"\nvariable = "gyr"\n') == (
        f"log.toml:4: streams.gyro.variable is for {kinds} files, not for a.parquet; remove it"
    )


@pytest.mark.parametrize("content", [b"", b"t,x\n1,2\n" * 40, bytes(4000), b"\x7fELF" * 400])
def test_what_is_no_mat_file_is_refused(complaint, tmp_path: Path, content: bytes):
    (tmp_path / "a.mat").write_bytes(content)
    assert complaint(GYRO) == "a.mat: is no MAT file; save it in MATLAB with -v7"


def test_a_file_cut_anywhere_is_read_or_refused(complaint, log_of, tmp_path: Path):
    whole = io.BytesIO()
    savemat(whole, {"gyro": np.column_stack([np.arange(500.0), np.zeros((500, 3))])})
    content = whole.getvalue()
    generator = np.random.default_rng(7)
    for size in generator.integers(0, len(content), 40):
        (tmp_path / "a.mat").write_bytes(content[:size])
        assert complaint(GYRO).startswith("a.mat: "), size
    for place in generator.integers(0, 300, 60):
        flipped = bytearray(content)
        flipped[place] ^= 0xFF
        (tmp_path / "a.mat").write_bytes(flipped)
        with suppress(LogError):
            log_of(GYRO)
