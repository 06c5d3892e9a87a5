"""A LabVIEW file (`.tdms`) with nptdms: channels by group, with the times of their waveforms."""

import logging
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.recording.formats.array_file import Numbers, Variables, damage, imported, library_errors

_AS = "TDMS", "save it again"
EPOCH = np.datetime64("1970-01-01T00:00:00", "us")


@dataclass(frozen=True)
class _Channel:
    """A channel, read when it is asked for."""

    path: Path
    group: str
    name: str
    shape: tuple[int, ...]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[np.generic]:
        with _opened(self.path) as (file, _):
            values = np.asarray(file[self.group][self.name][:])
        if values.dtype.kind == "M":
            values = (values - EPOCH) / np.timedelta64(1, "s")
        return np.asarray(values, dtype=dtype)


@dataclass(frozen=True)
class _Clock:
    """Times of a waveform: its start and its interval [s]."""

    start: float
    interval: float
    shape: tuple[int, ...]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[np.generic]:
        times = self.start + self.interval * np.arange(self.shape[0])
        return np.asarray(times, dtype=dtype)


def read_tdms(path: Path) -> Variables:
    """The channels of a file; no number is read yet.

    Raises:
        LogError: it is no TDMS file, is damaged, or nptdms is not installed.
    """
    arrays: dict[str, Numbers] = {}
    others: dict[str, str] = {}
    clocks: list[str] = []
    units: dict[str, str] = {}
    with _opened(path) as (file, complaints):
        for group in file.groups():
            for channel in group.channels():
                name = f"{group.name}.{channel.name}"
                rows, kind = len(channel), channel.dtype.kind
                if not rows or kind not in "biufM":
                    others[name] = "text" if rows else "empty"
                    continue
                clock = f"{group.name}.time"
                interval = channel.properties.get("wf_increment")
                if interval and clock not in arrays:
                    arrays[clock] = _Clock(_start(channel.properties), interval, (rows,))
                    clocks.append(clock)
                arrays[name] = _Channel(path, group.name, channel.name, (rows,))
                if kind == "M":
                    clocks.append(name)
                units[name] = str(channel.properties.get("unit_string") or "")
    repairs = damage(path) if complaints.heard else ()
    return Variables(arrays, others, clocks, units, repairs=repairs)


class _Complaints(logging.Filter):
    """Takes what the library would print of damage, in the place of the user's terminal."""

    heard = False

    def filter(self, record: logging.LogRecord) -> bool:
        self.heard |= record.levelno >= logging.WARNING
        return False


@contextmanager
def _opened(path: Path) -> Generator[tuple[Any, _Complaints]]:
    """The file, and whether the library complains of it in this block."""
    nptdms = imported("nptdms", path)
    complaints = _Complaints()
    printer = imported("nptdms.log", path).log_manager.console_handler
    printer.addFilter(complaints)
    try:
        # on damage the library does not close what it opened itself
        with (
            library_errors(path, *_AS),
            path.open("rb") as content,
            nptdms.TdmsFile.open(content) as file,
        ):
            yield file, complaints
    finally:
        printer.removeFilter(complaints)


def _start(properties: Any) -> float:
    """Of a waveform [s]: since 1970 where it is dated."""
    start = float(properties.get("wf_start_offset") or 0.0)
    dated = properties.get("wf_start_time")
    if dated is None:
        return start
    return start + float((np.datetime64(dated, "us") - EPOCH) / np.timedelta64(1, "s"))
