"""The lines that are offered for log.toml make the log read rightly."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.conventions import convention_advice
from twin.conventions.advice import corrected_lines
from twin.conventions.correction import (
    attitude_changes,
    axes_change,
    lag_change,
    signed_permutations,
)
from twin.recording import Recording, Series, read_log

ATTITUDE = {"wxyz": "w,x,y,z", "xyzw": "x,y,z,w"}


def folder(tmp_path: Path, gyro: str = "", attitude: str = "", names: str = "w,x,y,z") -> Path:
    """A gyro and an attitude of any values: what matters is how they are read."""
    draw = np.random.default_rng(1)
    for name, columns in (("gyro", "wx,wy,wz"), ("attitude", names)):
        rows = draw.normal(size=(30, columns.count(",") + 1))
        if name == "attitude":
            rows /= np.linalg.norm(rows, axis=1, keepdims=True)
        text = "".join(
            f"{0.1 * i},{','.join(map(repr, row.tolist()))}\n" for i, row in enumerate(rows)
        )
        (tmp_path / f"{name}.csv").write_text(f"t,{columns}\n{text}")
    (tmp_path / "log.toml").write_text(
        'platform = "sads"\n'
        f'[streams.gyro]\nfile = "gyro.csv"\n{gyro}'
        f'[streams.attitude]\nfile = "attitude.csv"\n{attitude}'
    )
    return tmp_path


def mended(path: Path, lines: list[str]) -> Recording:
    """The log read again after the lines were written into its log.toml."""
    text = (path / "log.toml").read_text()
    for block in re.split(r"(?=^\[)", "\n".join(lines), flags=re.MULTILINE):
        head, *keys = block.splitlines() or [""]
        if not head:
            continue
        start = text.index(head) + len(head)
        end = text.find("\n[", start) if "\n[" in text[start:] else len(text)
        table = text[start:end]
        for key in keys:
            table = re.sub(rf"\n{key.split(' = ')[0]} = .*", "", table)
        text = text[:start] + "\n" + "\n".join(keys) + table + text[end:]
    (path / "log.toml").write_text(text)
    return read_log(path)


@pytest.mark.parametrize("columns", ["", 'columns = ["wy", "-wx", "wz"]\nclock_lag = 0.25\n'])
def test_turned_axes_and_clocks_build_on_what_stands_there(tmp_path: Path, columns: str):
    path = folder(tmp_path, gyro=columns)
    log = read_log(path)
    for axes in signed_permutations(3)[5:30:6]:
        change, clock = axes_change("gyro", axes, ("x", "y", "z")), lag_change("gyro", 0.5)
        lines = corrected_lines(log, [change, clock])
        right = mended(folder(tmp_path, gyro=columns), lines)
        np.testing.assert_allclose(right["gyro"].value, log["gyro"].value @ axes.T)
        np.testing.assert_allclose(right["gyro"].time, log["gyro"].time - 0.5)


@pytest.mark.parametrize("layout", ["wxyz", "xyzw"])
@pytest.mark.parametrize("direction", ["body_to_world", "world_to_body"])
def test_every_reading_of_an_attitude_can_be_written(tmp_path: Path, layout: str, direction: str):
    stated = f'format = "{layout}"\ndirection = "{direction}"\n'
    log = read_log(folder(tmp_path, attitude=stated, names=ATTITUDE[layout]))
    for matrix, change in attitude_changes(log):
        if change is None:
            continue
        lines = corrected_lines(log, [change])
        right = mended(folder(tmp_path, attitude=stated, names=ATTITUDE[layout]), lines)
        wanted = log["attitude"].value @ matrix.T
        np.testing.assert_allclose(
            np.abs(np.sum(wanted * right["attitude"].value, axis=1)), 1.0, err_msg=str(lines)
        )


def test_a_log_in_degrees_and_milliseconds_is_told_in_lines_to_paste():
    draw = np.random.default_rng(3)
    time = np.arange(6000) / 100.0
    rate = 0.1 * np.sin(0.5 * time[:, None] + np.array([0.0, 1.0, 2.0]))
    angle = np.cumsum(rate[:, 2]) / 100.0
    turned = np.zeros((6000, 4))
    turned[:, 0], turned[:, 3] = np.cos(angle / 2.0), np.sin(angle / 2.0)
    rate[:, :2] = 0.0
    gyro = np.rad2deg(rate + draw.normal(0.0, 1e-3, rate.shape))
    streams = {
        "gyro": Series(time, gyro, ("x", "y", "z"), "rad/s"),
        "attitude": Series(1e3 * time, turned, ("w", "x", "y", "z"), "1"),
        "battery_voltage": Series(time[::100], np.ones((60, 1)), ("1",), "V"),
    }
    advice = convention_advice(Recording(streams, {"kind": "log"}), None)
    assert advice.text == (
        "The times of attitude look like ms, read as s.\n"
        "Gyro looks like deg/s, read as rad/s.\n"
        "To read it so, write in log.toml:\n"
        "  [streams.attitude]\n"
        '  time_unit = "ms"\n'
        "  [streams.gyro]\n"
        '  unit = "deg/s"'
    )
    assert advice.warning.startswith("The log looks misread, so what follows may be wrong: ")


def test_a_stream_whose_scale_is_to_be_fitted_is_not_judged():
    draw = np.random.default_rng(4)
    time = np.arange(3000) / 100.0
    angle = np.sin(time)[:, None] + draw.normal(0.0, 1e-3, (3000, 1))
    volts = 55.0 * np.cos(time)[:, None] + draw.normal(0.0, 1e-2, (3000, 1))
    streams = {
        "joint_angle": Series(time, angle, ("j",), "rad"),
        "joint_rate": Series(time, volts, ("j",), "rad/s"),
    }
    recording = Recording(streams, {"kind": "log"})
    assert convention_advice(recording, None).sentences
    told = {"streams": {"joint_rate": {"fit_scale": True, "unit": "V"}}}
    assert not convention_advice(replace(recording, provenance=told), None).sentences
