"""A file that several streams share is read once, in little memory, and a person sees how far."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from tests.processes import PATIENCE
from twin.recording import read_log
from twin.recording.formats import array_file

NAMES = ("t", "x", "y", "z", "w", "note")
COLUMNS = {"gyro": ["x", "y", "z"], "attitude": ["w", "x", "y", "z"], "accelerometer": list("zyx")}
READ_AHEAD = 32 << 20
"""Blocks of text that Arrow's threads hold, as they come [bytes]."""
UNITS = {"gyro": "deg/s", "attitude": "1", "accelerometer": "g"}


def rows(count: int) -> Iterator[dict[str, Any]]:
    """Samples with a long note that no stream takes."""
    for index in range(count):
        x, y = 0.1 + index % 7 * 0.01, 0.2 + index % 11 * 0.01
        yield dict(zip(NAMES, (index / 100.0, x, y, -x, 0.9, "n" * 500), strict=True))


def write_csv(path: Path, count: int) -> None:
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(NAMES) + "\n")
        file.writelines(",".join(map(str, row.values())) + "\n" for row in rows(count))


def write_mcap(path: Path, count: int) -> None:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=100_000, compression=CompressionType.NONE)
        writer.start()
        topics = [writer.register_channel(name, "json", 0) for name in ("/g", "/other")]
        for row in rows(count):
            stamp = round(1e9 * row["t"])
            for topic in topics:
                writer.add_message(topic, stamp, json.dumps(row).encode(), stamp)
        writer.finish()


WRITERS = {"csv": write_csv, "mcap": write_mcap}


def entry(stream: str, ending: str) -> str:
    topic = 'topic = "/g"\n' if ending == "mcap" else ""
    clock = 'time = "t"\ntime_unit = "s"\n'
    columns = f"columns = {json.dumps(COLUMNS[stream])}\n"
    unit = f'unit = "{UNITS[stream]}"\n'
    return f'[streams.{stream}]\nfile = "a.{ending}"\n{topic}{clock}{columns}{unit}'


def log_in(folder: Path, ending: str, streams: tuple[str, ...]) -> Path:
    (folder / "log.toml").write_text("".join(entry(stream, ending) for stream in streams))
    return folder


@pytest.fixture
def bytes_read(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Of each file, by its name, from now on."""
    counted: dict[str, int] = {}
    opened: Callable[..., Any] = Path.open

    def spied(path: Path, *words: Any, **named: Any) -> Any:
        file = opened(path, *words, **named)
        read = file.read

        class Spy:
            def __enter__(self) -> "Spy":
                return self

            def __exit__(self, *_: object) -> None:
                file.close()

            def read(self, size: int = -1) -> Any:
                data = read(size)
                counted[path.name] = counted.get(path.name, 0) + len(data)
                return data

            def __getattr__(self, name: str) -> Any:
                return getattr(file, name)

        return Spy()

    monkeypatch.setattr(Path, "open", spied)
    return counted


@pytest.mark.parametrize("ending", WRITERS)
def test_a_file_of_several_streams_is_read_once(tmp_path: Path, ending: str, bytes_read):
    path = tmp_path / f"a.{ending}"
    WRITERS[ending](path, 20_000 if ending == "csv" else 2_000)
    log = log_in(tmp_path, ending, tuple(COLUMNS))
    bytes_read.clear()
    streams = read_log(log)
    # at the layout and the end three blocks of 1 MiB, however long the file; the first message
    looks = 4_000_000 if ending == "csv" else 200_000
    assert path.stat().st_size <= bytes_read[path.name] < path.stat().st_size + looks
    by_itself = {name: read_log(log_in(tmp_path, ending, (name,)))[name] for name in COLUMNS}
    for name, alone in by_itself.items():
        np.testing.assert_array_equal(streams[name].time, alone.time)
        np.testing.assert_array_equal(streams[name].value, alone.value)


@pytest.mark.parametrize("ending", WRITERS)
def test_two_streams_of_the_same_columns_do_not_disturb_each_other(tmp_path: Path, ending: str):
    WRITERS[ending](tmp_path / f"a.{ending}", 100)
    log = log_in(tmp_path, ending, ("gyro",))
    again = entry("gyro", ending).replace("streams.gyro", "streams.truth_rate")
    with (log / "log.toml").open("a") as file:
        file.write(again.replace("deg/s", "rad/s"))
    streams = read_log(log)
    degrees = np.degrees(streams["gyro"].value)
    np.testing.assert_allclose(degrees, streams["truth_rate"].value, rtol=1e-15)
    np.testing.assert_array_equal(streams["truth_rate"].value[0], [0.1, 0.2, -0.1])


CODE = """
import sys
from twin.recording import read_log
read_log(sys.argv[1])
print(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="asks the kernel for the peak")
@pytest.mark.parametrize("ending", WRITERS)
def test_memory_grows_with_the_numbers_kept_and_not_with_the_file(tmp_path: Path, ending: str):
    peaks, sizes = list[int](), list[int]()
    counts = (50_000, 200_000) if ending == "csv" else (1_000, 20_000)
    for count in counts:
        folder = tmp_path / str(count)
        folder.mkdir()
        path = folder / f"a.{ending}"
        WRITERS[ending](path, count)
        log_in(folder, ending, ("gyro", "attitude"))
        done = subprocess.run(
            [sys.executable, "-c", CODE, str(folder)],
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=True,
        )
        peaks.append(1024 * int(done.stdout))
        sizes.append(path.stat().st_size)
    kept = 8 * (1 + 3 + 4) * (counts[1] - counts[0])
    # one array more for a moment: of times, of rows' numbers or of lengths
    assert peaks[1] - peaks[0] < 2 * kept + READ_AHEAD
    assert peaks[1] - peaks[0] < (sizes[1] - sizes[0]) / 2


@pytest.mark.parametrize("ending", WRITERS)
def test_who_waits_for_a_file_is_told_its_share_and_the_time_left(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
):
    WRITERS[ending](tmp_path / f"a.{ending}", 20_000 if ending == "csv" else 2_000)
    log = log_in(tmp_path, ending, ("gyro", "attitude"))
    said = list[str]()
    read_log(log, said.append)
    assert said == [], "soon done"
    monkeypatch.setattr(array_file, "SOON", 0.0)
    monkeypatch.setattr(array_file, "AGAIN", 0.0)
    read_log(log, said.append)
    shares = [int(words.split(": ")[1].split("%")[0]) for words in said]
    assert all(words.startswith(f"reading a.{ending}: ") for words in said)
    assert all(words.endswith(" left") for words in said)
    assert len(shares) > 2
    assert shares == sorted(shares)
    assert shares[-1] == 100
