"""Captures of terminals, logs of autopilots and dates of any country are read as they are meant."""

import secrets
import struct
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from twin.errors import LogError
from twin.recording.formats import OpenFiles
from twin.recording.formats.text_layout import is_date, seconds_of

SEED = secrets.randbits(32)

PATTERNS = (
    "%Y-%m-%dT%H:%M:%S.%f",
    "%Y/%m/%d %H:%M:%S.%f",
    "%d.%m.%Y %H:%M:%S,%f",
    "%m/%d/%Y %I:%M:%S.%f %p",
    "%d/%m/%Y %H:%M:%S.%f",
    "%Y.%m.%d, %H:%M:%S.%f",
)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("round_", range(5))
def test_dates_of_any_country_keep_their_differences_over_midnight(pattern: str, round_: int):
    draw = np.random.default_rng([SEED, round_])
    start = datetime(2026, 1, 1) + timedelta(days=int(draw.integers(360)), hours=23, minutes=59)
    steps = np.cumsum(draw.uniform(0.01, 20.0, 20)).round(6)
    texts = [(start + timedelta(seconds=step)).strftime(pattern) for step in steps.tolist()]
    assert all(map(is_date, texts)), SEED
    found = seconds_of(texts)
    np.testing.assert_allclose(np.diff(found), np.diff(steps), atol=2e-6, err_msg=str(SEED))


@pytest.mark.parametrize("text", ["1.5", "12:30", "2026", "-3", "1.2.3", "10:99:00x"])
def test_numbers_and_versions_are_no_dates(text: str):
    assert not is_date(text)


def test_lines_of_names_between_the_rows_are_left_out_and_counted(tmp_path: Path):
    draw = np.random.default_rng(SEED)
    rows = [f"{i},{i * i}\n" for i in range(300)]
    again = sorted(draw.choice(np.arange(1, 300), 4, replace=False).tolist(), reverse=True)
    for place in again:
        rows.insert(place, "t,x\n")
    (tmp_path / "a.csv").write_text("t,x\n" + "".join(rows))
    file = OpenFiles().open(tmp_path / "a.csv", unit="")
    np.testing.assert_array_equal(file.numbers(("x",))[:, 0], np.arange(300.0) ** 2)
    assert any("4 lines of names between the rows" in said for said in file.repairs)


def test_an_error_in_a_capture_names_the_line_of_the_file(tmp_path: Path):
    lines = [f"10:00:{i:02d}.000 -> {i},{2 * i}" for i in range(40)]
    lines[0] = "10:00:00.000 -> a,b"
    lines[25] = "10:00:25.000 -> 25,none"
    (tmp_path / "a.txt").write_text("\n".join(lines) + "\n")
    file = OpenFiles().open(tmp_path / "a.txt", unit="")
    with pytest.raises(LogError, match=r"a\.txt:26"):
        file.numbers(("b",))


def test_lines_that_a_plotter_would_not_draw_are_no_rows(tmp_path: Path):
    lines = [f"gx:{i}.5 gy:{-i}" for i in range(30)]
    lines[7:7] = ["I2C timeout", "gx:3 gy:4 gz:5"]
    (tmp_path / "a.txt").write_text("\n".join(lines) + "\n")
    file = OpenFiles().open(tmp_path / "a.txt", unit="")
    assert file.header == ("gx", "gy")
    np.testing.assert_array_equal(file.numbers(("gx",))[:, 0], np.arange(30) + 0.5)


@pytest.mark.parametrize("round_", range(3))
def test_a_damaged_dataflash_log_is_read_up_to_and_after_the_damage(round_: int, tmp_path: Path):
    draw = np.random.default_rng([SEED, round_])
    kind = struct.pack("<BB4s16s64s", 7, 15, b"ABC", b"Qf", b"TimeUS,X")
    messages = [b"\xa3\x95\x07" + struct.pack("<Qf", 1000 * i, float(i)) for i in range(50)]
    lost = int(draw.integers(5, 45))
    messages[lost] = bytes(draw.integers(0, 0x80, int(draw.integers(1, 14))).astype(np.uint8))
    (tmp_path / "a.bin").write_bytes(b"\xa3\x95\x80" + kind + b"".join(messages))
    file = OpenFiles().open(tmp_path / "a.bin", unit="")
    kept = np.delete(np.arange(50.0), lost)
    np.testing.assert_array_equal(file.numbers((file.find("ABC.X"),))[:, 0], kept, str(SEED))
