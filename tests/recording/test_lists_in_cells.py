"""Columns of lists, scales of one a column, attitudes of one angle: how a log of valves is read."""

from pathlib import Path

import numpy as np
import pytest

from twin import rotation
from twin.errors import LogError
from twin.recording.log import read_log

ROWS = 't,yaw,"valves, all",x\n0,10,"[1, 0]",5\n1,20,"[0,1]",6\n2,370,"[1, 1]",7\n'
VALVES = """
[streams.command_thruster]
file = "log.csv"
columns = ["valves, all[0]", "valves, all[1]"]
axes = ["left", "right"]
scale = [0.5, 2.0]
"""
YAW = """
[streams.attitude]
file = "log.csv"
columns = ["yaw"]
format = "heading"
unit = "deg"
"""


def written(folder: Path, rows: str, entries: str) -> Path:
    (folder / "log.csv").write_text(rows, encoding="utf-8")
    (folder / "log.toml").write_text(entries, encoding="utf-8")
    return folder


def test_a_column_of_lists_is_as_many_columns_each_with_its_scale(tmp_path: Path):
    log = read_log(written(tmp_path, ROWS, VALVES))
    assert log["command_thruster"].columns == ("left", "right")
    assert log["command_thruster"].value.tolist() == [[0.5, 0.0], [0.0, 2.0], [0.5, 2.0]]


def test_lists_may_stand_between_semicolons(tmp_path: Path):
    rows = 't;valves, all;x\n0;"[1, 0]";5\n1;"[0, 1]";6\n'
    log = read_log(written(tmp_path, rows, VALVES))
    assert log["command_thruster"].value.tolist() == [[0.5, 0.0], [0.0, 2.0]]


def test_a_list_of_another_length_is_told_with_its_line(tmp_path: Path):
    rows = ROWS.replace('"[0,1]"', '"[0,1,1]"')
    with pytest.raises(LogError, match=r"log\.csv:3: is a row of 6 under 5 column names"):
        read_log(written(tmp_path, rows, VALVES))


def test_a_list_of_scales_has_one_for_each_column(tmp_path: Path):
    entries = VALVES.replace("[0.5, 2.0]", "[0.5, 2.0, 1.0]")
    with pytest.raises(LogError, match="has 3 numbers for 2 columns; give one for all, or one"):
        read_log(written(tmp_path, ROWS, entries))


def test_an_attitude_of_one_angle_turns_about_the_vertical(tmp_path: Path):
    attitude = read_log(written(tmp_path, ROWS, YAW))["attitude"].value
    yaw, pitch, roll = rotation.to_euler_zyx(attitude).T
    assert np.degrees(np.unwrap(yaw)) == pytest.approx([10.0, 20.0, 10.0])
    assert np.abs(pitch).max() == np.abs(roll).max() == 0.0


def test_degrees_that_nobody_called_so_are_refused(tmp_path: Path):
    with pytest.raises(LogError, match='add `unit = "deg"`'):
        read_log(written(tmp_path, ROWS, YAW.replace('unit = "deg"\n', "")))
