"""Parquet: columns by name, timestamps in seconds, fields of structs by dotted names."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

GYRO = '[streams.gyro]\nfile = "a.parquet"\n'


def write(tmp_path: Path, columns: dict[str, object]) -> None:
    parquet.write_table(pa.table(columns), tmp_path / "a.parquet")


@pytest.fixture
def samples(tmp_path: Path) -> None:
    write(tmp_path, {"t": [0.0, 0.5, 1.0], "x": [1, 2, 3], "y": [0.1, 0.2, 0.3], "z": [True] * 3})


@pytest.mark.usefixtures("samples")
def test_the_first_column_is_the_time_and_the_rest_the_stream(log_of):
    gyro = log_of(GYRO)["gyro"]
    np.testing.assert_array_equal(gyro.time, [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(gyro.value[:, 0], [1, 2, 3])
    np.testing.assert_array_equal(gyro.value[:, 2], 1.0)


def test_timestamps_are_seconds_whatever_they_count(log_of, tmp_path: Path):
    stamps = np.array([0, 10, 20], dtype="datetime64[ms]")
    write(tmp_path, {"x": [1.0, 2.0, 3.0], "when": stamps})
    log = log_of(GYRO + 'time = "when"\ncolumns = ["x"]\naxes = ["x"]\n')
    np.testing.assert_allclose(log["gyro"].time, [0.0, 0.01, 0.02])


def test_the_only_timestamps_are_the_times_wherever_they_stand(log_of, tmp_path: Path):
    stamps = pa.array([1_700_000_000_000, 1_700_000_000_500], pa.timestamp("ms"))
    write(tmp_path, {"x": [1, 2], "y": [3, 4], "z": [5, 6], "__index_level_0__": stamps})
    gyro = log_of(GYRO)["gyro"]
    np.testing.assert_array_equal(gyro.time, [0.0, 0.5])
    np.testing.assert_array_equal(gyro.value, [[1, 3, 5], [2, 4, 6]])


def test_a_time_unit_beside_timestamps_is_refused(complaint, tmp_path: Path):
    write(tmp_path, {"when": np.array([0, 1], dtype="timedelta64[us]"), "x": [1.0, 2.0]})
    assert complaint(GYRO + 'axes = ["x"]\ntime_unit = "ms"\n') == (
        "log.toml:5: streams.gyro.time_unit is given, but when is in seconds by its type; remove it"
    )


def test_fields_of_a_struct_have_dotted_names(log_of, tmp_path: Path):
    rate = pa.array([{"x": 1.0, "y": 2.0, "z": 3.0}] * 2)
    write(tmp_path, {"t": [0.0, 1.0], "rate": rate})
    log = log_of(GYRO + 'columns = ["rate.z", "rate.y", "rate.x"]\n')
    np.testing.assert_array_equal(log["gyro"].value[0], [3.0, 2.0, 1.0])


def test_rows_without_a_number_are_left_out_and_counted(log_of, tmp_path: Path):
    sparse = [1.0, None, 3.0]
    write(tmp_path, {"t": [0.0, 1.0, 2.0], "x": sparse, "y": sparse, "z": sparse})
    log = log_of(GYRO)
    np.testing.assert_array_equal(log["gyro"].time, [0.0, 2.0])
    assert log.repairs == ("gyro (a.parquet): 1 row without a number left out",)


@pytest.mark.usefixtures("samples")
def test_a_column_that_is_not_there_is_refused(complaint):
    assert complaint(GYRO + 'columns = ["x", "y", "yy"]\n') == (
        "a.parquet: no column named 'yy' (did you mean 'y'?); name one of its columns"
    )


def test_text_is_refused(complaint, tmp_path: Path):
    write(tmp_path, {"t": [0.0], "x": ["1"], "y": [1.0], "z": [1.0]})
    assert complaint(GYRO) == (
        "a.parquet: column 'x' holds string, no numbers; name others in `columns`"
    )


def test_half_a_sample_is_refused_with_its_row(complaint, tmp_path: Path):
    write(tmp_path, {"t": [0.0, 1.0], "x": [1.0, 1.0], "y": [1.0, None], "z": [1.0, 1.0]})
    assert complaint(GYRO) == (
        "a.parquet: column 'y' holds nothing, which is no finite number (row 2); "
        "write the number, or delete the row"
    )


@pytest.mark.parametrize("content", [b"", b"t,x\n1,2\n", b"PAR1" + bytes(100) + b"PAR1"])
def test_what_is_no_parquet_file_is_refused(complaint, tmp_path: Path, content: bytes):
    (tmp_path / "a.parquet").write_bytes(content)
    sentence = complaint(GYRO)
    assert sentence.startswith("a.parquet: cannot be read as Parquet (")
    assert sentence.endswith("); write it again")


def test_a_table_without_rows_is_refused(complaint, tmp_path: Path):
    write(tmp_path, {"t": pa.array([], pa.float64())})
    assert complaint(GYRO) == "a.parquet: has no rows; check the export"


def test_two_columns_of_one_name_are_refused(complaint, tmp_path: Path):
    table = pa.Table.from_arrays([pa.array([0.0, 1.0])] * 3, names=["t", "x", "x"])
    parquet.write_table(table, tmp_path / "a.parquet")
    assert complaint(GYRO) == "a.parquet: names two columns 'x'; give each its own name"
