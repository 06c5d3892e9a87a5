"""A measured log is read as its log.toml says."""

from pathlib import Path

import numpy as np
import pytest

from twin import rotation
from twin.library import library
from twin.recording.log import read_log

PENDULUM = library("models") / "dfki_pendulum" / "logs"
GYRO = '[streams.gyro]\nfile = "gyro.csv"\n'
ROWS = "t,x,y,z\n0,1,2,3\n1,4,5,6\n2,7,8,9\n"


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


@pytest.mark.parametrize(
    "text",
    [ROWS.replace(",", ";"), ROWS.replace(",", "\t"), "t;x;y;z\n0;1;2,0;3\n1;4;5;6e0\n2;7,;8;9\n"],
)
def test_columns_may_be_separated_by_semicolons_or_tabs_and_numbers_have_commas_then(
    folder_with, tmp_path: Path, text: str
):
    log = read_log(folder_with(tmp_path, GYRO, gyro=text))
    np.testing.assert_array_equal(log["gyro"].time, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(log["gyro"].value, np.arange(1.0, 10.0).reshape(3, 3))


def test_a_comma_in_a_remark_makes_no_decimal_commas(folder_with, tmp_path: Path):
    text = "t;x;y;z;note\n0;1.5;2;3;warm, 20 C\n1;4;5;6;1,2 or 3\n"
    log = read_log(folder_with(tmp_path, GYRO + 'columns = ["x", "y", "z"]\n', gyro=text))
    np.testing.assert_array_equal(log["gyro"].value[:, 0], [1.5, 4.0])


def test_log_toml_itself_may_be_named(folder_with, tmp_path: Path):
    folder = folder_with(tmp_path, GYRO, gyro=ROWS)
    assert len(read_log(folder / "log.toml")["gyro"]) == 3


def test_units_times_columns_and_scale_become_si(folder_with, tmp_path: Path):
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


def test_a_scale_is_no_second_conversion_where_the_unit_is_of_another_kind(
    folder_with, tmp_path: Path
):
    toml = GYRO + 'unit = "mV"\nscale = 1e-3\n'
    log = read_log(folder_with(tmp_path, toml, gyro=ROWS))
    np.testing.assert_allclose(log["gyro"].value[0], [1e-6, 2e-6, 3e-6])


def test_names_that_numpy_marks_as_a_comment_are_names(folder_with, tmp_path: Path):
    log = read_log(folder_with(tmp_path, GYRO, gyro="# t,x,y,z\n0,1,2,3\n1,4,5,6\n"))
    np.testing.assert_array_equal(log["gyro"].value, [[1, 2, 3], [4, 5, 6]])


def test_a_name_with_a_blank_is_one_column(folder_with, tmp_path: Path):
    toml = '[streams.joint_rate]\nfile = "r.csv"\nrate = 10.0\n'
    log = read_log(folder_with(tmp_path, toml, r="rate of pivot\n 1.0\n 2.0\n"))
    np.testing.assert_array_equal(log["joint_rate"].value, [[1.0], [2.0]])


def test_a_file_without_times_gets_them_from_rate_and_start(folder_with, tmp_path: Path):
    log = read_log(
        folder_with(
            tmp_path, GYRO + "rate = 4.0\nstart = 1.0\n", gyro="x,y,z\n1,2,3\n" * 1 + "4,5,6\n"
        )
    )
    np.testing.assert_allclose(log["gyro"].time, [1.0, 1.25])


def test_fewer_columns_than_the_stream_are_named_by_axes(folder_with, tmp_path: Path):
    log = read_log(folder_with(tmp_path, GYRO + 'axes = ["y"]\n', gyro="t,w\n0,1\n1,2\n"))
    assert log["gyro"].columns == ("y",)


def test_epoch_stamps_count_from_the_start_of_the_log(folder_with, tmp_path: Path):
    text = "t,x,y,z\n1700000000.5,1,2,3\n1700000001.0,1,2,3\n"
    log = read_log(folder_with(tmp_path, GYRO, gyro=text))
    np.testing.assert_allclose(log["gyro"].time, [0.0, 0.5])
    assert log.provenance["time_origin"] == 1700000000.5


def test_notes_environment_and_stated_noise_are_kept(folder_with, tmp_path: Path):
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
def test_every_attitude_format_gives_the_same_attitude(
    folder_with, tmp_path: Path, layout: str, direction: str
):
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


def test_several_streams_keep_their_own_rates_and_gaps(folder_with, tmp_path: Path):
    toml = GYRO + '[streams.attitude]\nfile = "mocap.csv"\ntime_unit = "ms"\n'
    mocap = "t,w,x,y,z\n" + "".join(f"{t},1,0,0,0\n" for t in (3, 7, 11, 90, 94))
    log = read_log(folder_with(tmp_path, toml, gyro=ROWS, mocap=mocap))
    np.testing.assert_allclose(log["attitude"].time, [0.003, 0.007, 0.011, 0.09, 0.094])
    np.testing.assert_array_equal(log["gyro"].time, [0.0, 1.0, 2.0])
    assert log.repairs == ()


def test_a_scale_to_fit_is_handed_on(folder_with, tmp_path: Path):
    folder = folder_with(tmp_path, GYRO + 'unit = "V"\nscale = "fit"\n', gyro=ROWS)
    log = read_log(folder)
    assert log.provenance["streams"]["gyro"]["fit_scale"] is True
    assert log.provenance["streams"]["gyro"]["unit"] == "V"
    np.testing.assert_array_equal(log["gyro"].value[0], [1.0, 2.0, 3.0])


def test_a_minus_turns_a_column_about_and_a_clock_lag_comes_off_the_times(
    folder_with, tmp_path: Path
):
    toml = GYRO + 'columns = ["y", "-x", "z"]\nclock_lag = 0.25\n'
    log = read_log(folder_with(tmp_path, toml, gyro=ROWS))
    np.testing.assert_array_equal(log["gyro"].value[0], [2.0, -1.0, 3.0])
    np.testing.assert_array_equal(log["gyro"].time, [-0.25, 0.75, 1.75])


def test_a_column_whose_name_begins_with_a_minus_is_taken_as_it_is(folder_with, tmp_path: Path):
    toml = GYRO + 'columns = ["-x", "y", "z"]\n'
    log = read_log(folder_with(tmp_path, toml, gyro="t,-x,y,z\n0,1,2,3\n1,2,3,4\n"))
    np.testing.assert_array_equal(log["gyro"].value[0], [1.0, 2.0, 3.0])


def test_a_log_may_name_no_platform(tmp_path: Path):
    (tmp_path / "log.toml").write_text(GYRO)
    (tmp_path / "gyro.csv").write_text(ROWS)
    assert read_log(tmp_path).provenance["platform"] is None


def test_a_log_that_begins_long_after_power_on_counts_from_its_start(folder_with, tmp_path: Path):
    rows = "".join(f"{2000 + i / 10},1,2,3\n" for i in range(600))
    log = read_log(folder_with(tmp_path, GYRO, gyro=f"t,x,y,z\n{rows}"))
    assert log.start == 0.0
    assert log.provenance["time_origin"] == 2000.0
