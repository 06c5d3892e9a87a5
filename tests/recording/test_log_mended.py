"""What can be mended in a table is, and each repair is counted and said."""

from pathlib import Path

import numpy as np
import pytest

from twin.recording.log import read_log
from twin.recording.timeline import over_midnight

GYRO = '[streams.gyro]\nfile = "gyro.csv"\n'


def test_quaternions_off_length_are_scaled_and_counted(folder_with, tmp_path: Path):
    toml = '[streams.attitude]\nfile = "a.csv"\n'
    log = read_log(folder_with(tmp_path, toml, a="t,w,x,y,z\n0,1,0,0,0\n1,1.01,0,0,0\n"))
    assert log.repairs == (
        "attitude (a.csv): 1 of 2 quaternions scaled to length 1, the worst was 1.01",
    )


def test_late_rows_are_sorted_and_counted(folder_with, tmp_path: Path):
    text = "t,x,y,z\n0,1,1,1\n2,3,3,3\n1,2,2,2\n3,4,4,4\n"
    log = read_log(folder_with(tmp_path, GYRO, gyro=text))
    np.testing.assert_array_equal(log["gyro"].value[:, 0], [1, 2, 3, 4])
    assert log.repairs == ("gyro (gyro.csv): 1 row out of order sorted by time",)


def test_repeated_rows_are_dropped_and_counted(folder_with, tmp_path: Path):
    text = "t,x,y,z\n0,1,1,1\n1,2,2,2\n1,2,2,2\n1,2,2,2\n2,3,3,3\n"
    log = read_log(folder_with(tmp_path, GYRO, gyro=text))
    assert len(log["gyro"]) == 3
    assert log.repairs == ("gyro (gyro.csv): 2 rows that repeat the one before dropped",)


def test_rows_without_a_number_are_left_out_and_counted(folder_with, tmp_path: Path):
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


def test_rows_left_out_keep_the_times_of_a_file_without_times(folder_with, tmp_path: Path):
    log = read_log(folder_with(tmp_path, GYRO + "rate = 2.0\n", gyro="x,y,z\n1,2,3\n,,\n4,5,6\n"))
    np.testing.assert_array_equal(log["gyro"].time, [0.0, 1.0])


def test_a_last_row_that_was_cut_is_left_out_and_said(folder_with, tmp_path: Path):
    log = read_log(folder_with(tmp_path, GYRO, gyro="t,x,y,z\n0,1,1,1\n1,2,2,2\n2,3,"))
    np.testing.assert_array_equal(log["gyro"].time, [0.0, 1.0])
    assert log.repairs == ("gyro.csv:4: a last row that was cut short left out",)


def test_a_hinge_that_is_wrapped_at_a_turn_turns_on_and_one_that_jumps_otherwise_stays(
    folder_with, tmp_path: Path
):
    time = np.arange(200) / 50.0
    turned = 9.0 * np.sin(0.8 * time)
    toml = '[streams.joint_angle]\nfile = "angle.csv"\naxes = ["pivot"]\nunit = "deg"\n'

    def read(angles):
        rows = zip(time, np.rad2deg(angles), strict=True)
        text = "t,angle\n" + "".join(f"{t:.17g},{angle:.17g}\n" for t, angle in rows)
        return read_log(folder_with(tmp_path, toml, angle=text))

    log = read((turned + np.pi) % (2.0 * np.pi) - np.pi)
    np.testing.assert_allclose(log["joint_angle"].value[:, 0], turned, atol=1e-12)
    assert log.repairs == ("joint_angle (angle.csv): 2 jumps of a whole turn taken out",)
    spiked = np.where(np.arange(200) == 100, 4.0, 0.1 * time)
    log = read(spiked)
    np.testing.assert_allclose(log["joint_angle"].value[:, 0], spiked, atol=1e-12)
    assert log.repairs == ()


@pytest.mark.parametrize(
    ("clock", "goes_on"),
    [([86399.0, 86399.5, 0.0, 0.5], True), ([100.0, 100.5, 3.0, 3.5], False)],
)
def test_times_of_day_go_on_after_midnight_and_a_clock_that_is_set_back_does_not(clock, goes_on):
    time, said = over_midnight(np.array(clock), "gyro")
    assert (np.diff(time) > 0.0).all() == goes_on
    assert bool(said) == goes_on, "what is mended is said"
