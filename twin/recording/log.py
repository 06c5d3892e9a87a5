"""A measured log or a recording on disk -> `Recording`.

A measured log on disk: a folder with log.toml and tables (docs/design.md 4.3) -> `Recording`.
What is wrong with a table is an error with file, line and remedy; what can be mended without
guessing is mended, counted and said in `Recording.repairs`. Nothing is dropped silently.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from twin.config import Table, read_toml
from twin.errors import LogError, RecordingError, UnknownName
from twin.library import find_model
from twin.recording.entry import Entry
from twin.recording.environment import read_field, read_gravity
from twin.recording.formats import ENDINGS, OpenFiles, Say, silent
from twin.recording.pauses import restricted, without_long_pauses
from twin.recording.read import read_recording, which
from twin.recording.recording import Recording, Series
from twin.stop import check

SOON = 60.0
"""A log that begins later than this [s], and than it is long, counts from 1970 or from power-on:
its own start becomes 0. What drifts is taken to have been as stated at time 0."""


def read_log(path: str | Path, say: Say = silent) -> Recording:
    """Read a measured log: its folder, or the log.toml in it; each file in one pass.

    Of a log with `start` or `stop`, the rows between are read, and what was commanded by then.

    `provenance` holds `kind` ("log"), `source`, `platform` (a name, the path of a folder, or None),
    `environment`, `notes`, and under `streams` each stream's file, unit and stated noise [SI].

    Args:
        path: of the folder, or of its log.toml.
        say: takes a line of progress where reading takes more than a moment.

    Raises:
        LogError: anything in the folder that cannot be read; with file, line and remedy.
    """
    folder = Path(path)
    if folder.name == "log.toml":
        folder = folder.parent
    if not folder.is_dir():
        raise LogError(folder, "there is no such folder", "name the folder that holds log.toml")
    table = read_toml(folder / "log.toml", LogError)
    platform = _platform(table, folder)
    environment = _environment(table)
    stated = table.number("time_origin", 0.0, unit="s")
    start = table.number("start", -math.inf, unit="s")
    stop = table.number("stop", math.inf, unit="s")
    if start >= stop:
        raise table.fail("stop", f"is {stop:g} s, and `start` {start:g} s", "name a later time")
    notes = table.table("notes", required=False)
    streams_table = table.table("streams")
    streams: dict[str, Series] = {}
    facts: dict[str, Any] = {}
    repairs: list[str] = []
    files = OpenFiles(say)
    entries = [Entry.read(streams_table.table(name), folder, name) for name in streams_table.keys]
    # all are selected before the first is read, so that a file is read once for all its streams
    selections = [entry.select(files) for entry in entries]
    for entry, selection in zip(entries, selections, strict=True):
        streams[entry.name], mended = entry.series(selection)
        facts[entry.name] = entry.facts(selection)
        repairs += (repair for repair in mended if repair not in repairs)
    if not streams:
        raise streams_table.fail("streams", "names no stream", "add [streams.gyro] or another")
    table.close()
    origin = min(series.time[0] for series in streams.values())
    late = abs(origin) > max(SOON, max(series.time[-1] for series in streams.values()) - origin)
    if late:
        streams = {name: _shifted(series, origin) for name, series in streams.items()}
    streams, paused = without_long_pauses(streams)
    provenance = {
        "kind": "log",
        "source": str(folder),
        "platform": platform,
        "environment": environment,
        "notes": {key: _plain(notes.raw(key)) for key in notes.keys},
        "streams": facts,
        "time_origin": stated + (origin if late else 0.0),
    }
    recording = Recording(streams, provenance, (*repairs, *paused))
    if {"start", "stop"}.isdisjoint(table.keys):
        return recording
    return _part(table, recording, start, stop)


def _part(table: Table, recording: Recording, start: float, stop: float) -> Recording:
    """The rows of a log between two of its times."""
    first = None if math.isinf(start) else start
    last = None if math.isinf(stop) else stop
    try:
        return restricted(recording, start=first, stop=last, rate=None)
    except LogError:
        raise table.fail(
            "start" if "start" in table else "stop",
            f"leaves nothing: the log has {recording.start:g} to {recording.stop:g} s",
            "name times between",
        ) from None


def _platform(table: Table, folder: Path) -> str | None:
    if "platform" not in table:
        return None
    name = table.text("platform")
    if (result := _found_at(folder / name)) is not None:
        return result
    try:
        find_model(name)
    except UnknownName:
        return _found_at(folder.resolve().parent / name) or name
    return name


def _found_at(place: Path) -> str | None:
    """The platform folder (and variant) at a path; None where there is none."""
    try:
        result, variant = find_model(str(place.resolve()))
    except UnknownName:
        return None
    return f"{result}:{variant}" if variant else str(result)


def _environment(table: Table) -> dict[str, Any]:
    environment = table.table("environment", required=False)
    known: dict[str, Any] = {}
    if (field := read_field(environment, None)) is not None:
        known["magnetic_field"] = field.tolist()
    if (gravity := read_gravity(environment, None)) is not None:
        known["gravity"] = gravity
    environment.close()
    return known


def _shifted(series: Series, origin: float) -> Series:
    return Series(series.time - origin, series.value, series.columns, series.unit)


def _plain(value: Any) -> Any:
    """JSON has no dates: they become text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}  # pyright: ignore
    if isinstance(value, list):
        return [_plain(entry) for entry in value]  # pyright: ignore
    return value if isinstance(value, str | int | float | bool) else str(value)


def open_log(path: str | Path, say: Say = silent) -> Recording:
    """Read an `.rrd`, a folder that holds a log.toml, or that log.toml; its `provenance` has the
    path as its `source`. `say` takes a line of progress where that takes more than a moment.

    Raises:
        RecordingError: no such thing, or an `.rrd` that cannot be read.
        LogError: a folder that cannot be read, or a file that belongs into one.
        Stopped: a stop was requested.
    """
    check()
    path = Path(path)
    if path.is_dir() or path.name == "log.toml":
        return _from(path, read_log(path, say))
    if not which(path)[0].exists():
        raise RecordingError(
            path, "there is no such log", "name an .rrd, or a folder that holds a log.toml"
        )
    if path.suffix.lower() in ENDINGS:
        raise LogError(
            path,
            "is a file of numbers that does not say what they are",
            "put it into a folder with a log.toml that does (docs/logs.md), and name the folder",
        )
    return _from(path, read_recording(path))


def _from(path: Path, recording: Recording) -> Recording:
    return replace(recording, provenance={**recording.provenance, "source": str(path)})
