"""A measured log or a recording on disk -> `Recording`.

A measured log on disk: a folder with log.toml and tables (docs/design.md 4.3) -> `Recording`.
What is wrong with a table is an error with file, line and remedy; what can be mended without
guessing is mended, counted and said in `Recording.repairs`. Nothing is dropped silently.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from twin.config import Table, read_toml
from twin.errors import LogError, RecordingError, UnknownName, UsageError
from twin.library import find_model
from twin.recording.entry import Entry, Selection
from twin.recording.environment import read_field, read_gravity
from twin.recording.formats import ENDINGS, NumberFile, OpenFiles, Say, silent
from twin.recording.pauses import FOLLOWED, restricted, without_long_pauses
from twin.recording.read import read_recording, which
from twin.recording.recording import Recording, Series
from twin.recording.timeline import Timeline
from twin.stop import check

SOON = 60.0
"""A log that begins later than this [s], and than it is long, counts from 1970 or from power-on:
its own start becomes 0. What drifts is taken to have been as stated at time 0."""


def read_log(
    path: str | Path,
    say: Say = silent,
    *,
    start: float | None = None,
    stop: float | None = None,
) -> Recording:
    """Read a measured log: its folder, or the log.toml in it; each file in one pass.

    Of a log with `start` or `stop`, the rows between are kept, and what was commanded by then; a
    text or a file of messages is then passed over twice, first for its clocks.

    `provenance` holds `kind` ("log"), `source`, `platform` (a name, the path of a folder, or None),
    `environment`, `notes`, and under `streams` each stream's file, unit and stated noise [SI].

    Args:
        path: of the folder, or of its log.toml.
        say: takes a line of progress where reading takes more than a moment.
        start: leave out what was before [s], beyond what log.toml leaves out.
        stop: leave out what was after [s].

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
    stated_part = _Part.of(
        table.number("start", -math.inf, unit="s"), table.number("stop", math.inf, unit="s")
    )
    if stated_part.start >= stated_part.stop:
        raise table.fail(
            "stop",
            f"is {stated_part.stop:g} s, and `start` {stated_part.start:g} s",
            "name a later time",
        )
    asked = _Part.of(start, stop)
    notes = table.table("notes", required=False)
    streams_table = table.table("streams")
    streams: dict[str, Series] = {}
    facts: dict[str, Any] = {}
    repairs: list[str] = []
    files = OpenFiles(say)
    entries = [Entry.read(streams_table.table(name), folder, name) for name in streams_table.keys]
    part = asked if stated_part.whole else stated_part
    # all are selected before the first is read, so that a file is read once for all its streams
    selections = [entry.select(files, whole=part.whole) for entry in entries]
    timelines: list[Timeline | None] = [None] * len(entries)
    whole: dict[str, Series] | None = None
    if not part.whole:
        read = [entry.timeline(one) for entry, one in zip(entries, selections, strict=True)]
        whole = {entry.name: one.series() for entry, one in zip(entries, read, strict=True)}
        timelines = [*_keep_only(part, whole, entries, selections, read)]
    for entry, selection, timeline in zip(entries, selections, timelines, strict=True):
        streams[entry.name], mended = entry.series(selection, timeline)
        facts[entry.name] = entry.facts(selection)
        repairs += (repair for repair in mended if repair not in repairs)
    if not streams:
        raise streams_table.fail("streams", "names no stream", "add [streams.gyro] or another")
    table.close()
    origin = _origin(streams if whole is None else whole)
    streams = {name: _shifted(series, origin) for name, series in streams.items()}
    if whole is not None:
        whole = {name: _shifted(series, origin) for name, series in whole.items()}
    streams, paused = without_long_pauses(streams, whole)
    provenance = {
        "kind": "log",
        "source": str(folder),
        "platform": platform,
        "environment": environment,
        "notes": {key: _plain(notes.raw(key)) for key in notes.keys},
        "streams": facts,
        "time_origin": stated + origin,
    }
    recording = Recording(streams, provenance, (*repairs, *paused))
    reach = _reach(recording if whole is None else without_long_pauses(whole)[0])
    if not stated_part.whole:
        try:
            recording = stated_part.cut(recording, reach)
        except LogError:
            raise table.fail(
                "start" if "start" in table else "stop",
                f"leaves nothing: the log has {reach[0]:g} to {reach[1]:g} s",
                "name times between",
            ) from None
        reach = recording.start, recording.stop
    return asked.cut(recording, reach)


@dataclass(frozen=True)
class _Part:
    """Which times of a log are kept [s]."""

    start: float
    stop: float

    @classmethod
    def of(cls, start: float | None, stop: float | None) -> "_Part":
        """Without an end, it is open there."""
        return cls(-math.inf if start is None else start, math.inf if stop is None else stop)

    @property
    def whole(self) -> bool:
        """Whether all are."""
        return math.isinf(self.start) and math.isinf(self.stop)

    def cut(self, recording: Recording, reach: tuple[float, float]) -> Recording:
        """The rows between, of a log that reaches so far [s]."""
        first = None if math.isinf(self.start) else self.start
        last = None if math.isinf(self.stop) else self.stop
        return restricted(recording, start=first, stop=last, rate=None, reach=reach)


NEIGHBOURS = 32
"""Rows beside a part that are read too: some of them may be late and belong into it."""


def _keep_only(
    part: _Part,
    whole: Mapping[str, Series],
    entries: Sequence[Entry],
    selections: Sequence[Selection],
    timelines: Sequence[Timeline],
) -> list[Timeline]:
    """The rows of each stream that will do for a part of the log; each file leaves out the others.

    Raises:
        LogError: a clock was set back within the part.
    """
    origin = _origin(whole)
    shifted, _ = without_long_pauses({n: _shifted(s, origin) for n, s in whole.items()})
    begins, ends = _reach(shifted)
    start, stop = max(part.start, begins), min(part.stop, ends)
    kept: dict[int, tuple[NumberFile, int, int]] = {}
    result = list[Timeline]()
    for entry, selection, timeline in zip(entries, selections, timelines, strict=True):
        time, shown = whole[entry.name].time, shifted[entry.name].time
        within = time[(shown >= start) & (shown <= stop)]
        if len(within):
            where = f"{entry.name} ({entry.path.name})"
            begins_at, ends_at = float(within[0]), float(within[-1])
            timeline = timeline.single_run(begins_at, ends_at, selection.file, where)
        first = max(int(np.searchsorted(shown, start - FOLLOWED)) - 1, 0)
        last = int(np.searchsorted(shown, stop, side="right"))
        if entry.is_of_whole:
            first, last = 0, len(time)
        last = min(max(last, first), len(time) - 1)
        low, high = timeline.rows_between(float(time[first]), float(time[last]), NEIGHBOURS)
        result.append(replace(timeline, span=(low, high)))
        file, lowest, highest = kept.get(id(selection.file), (selection.file, low, high))
        kept[id(file)] = file, min(low, lowest), max(high, highest)
        file.expect(selection.columns)
    for file, low, high in kept.values():
        file.only(low, high + 1)
    return result


def _origin(streams: Mapping[str, Series]) -> float:
    """The time that becomes 0 [s]; 0 where the log's own times stay."""
    origin, last = _reach(streams)
    return origin if abs(origin) > max(SOON, last - origin) else 0.0


def _reach(streams: Mapping[str, Series]) -> tuple[float, float]:
    """From the first time of any stream to the last [s]."""
    return (
        min(float(series.time[0]) for series in streams.values()),
        max(float(series.time[-1]) for series in streams.values()),
    )


def _platform(table: Table, folder: Path) -> str | None:
    if "platform" not in table:
        return None
    name = table.text("platform")
    if (result := _platform_at(folder / name)) is not None:
        return result
    try:
        find_model(name)
    except UnknownName:
        return _platform_at(folder.resolve().parent / name) or name
    except UsageError:  # of two machines, --platform may yet name one
        return name
    return name


def _platform_at(place: Path) -> str | None:
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
    if origin == 0.0:
        return series
    return Series(series.time - origin, series.value, series.columns, series.unit)


def _plain(value: Any) -> Any:
    """JSON has no dates: they become text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}  # pyright: ignore
    if isinstance(value, list):
        return [_plain(entry) for entry in value]  # pyright: ignore
    return value if isinstance(value, str | int | float | bool) else str(value)


def open_log(
    path: str | Path,
    say: Say = silent,
    *,
    start: float | None = None,
    stop: float | None = None,
) -> Recording:
    """Read an `.rrd`, a folder that holds a log.toml, or that log.toml; its `provenance` has the
    path as its `source`. `say` takes a line of progress where that takes more than a moment.
    With `start` or `stop` [s], what was between, and what was commanded by then.

    Raises:
        RecordingError: no such thing, or an `.rrd` that cannot be read.
        LogError: a folder that cannot be read, or a file that belongs into one.
        Stopped: a stop was requested.
    """
    check()
    path = Path(path)
    if path.is_dir() or path.name == "log.toml":
        return _from(path, read_log(path, say, start=start, stop=stop))
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
    recording = _from(path, read_recording(path))
    return restricted(recording, start=start, stop=stop, rate=None)


def _from(path: Path, recording: Recording) -> Recording:
    return replace(recording, provenance={**recording.provenance, "source": str(path)})
