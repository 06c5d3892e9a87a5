"""One [streams.NAME] of a log.toml, checked key by key, and the series in the file it names."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.config import Table
from twin.errors import UnknownName
from twin.recording.formats import ENDINGS, NumberFile, OpenFiles
from twin.recording.quaternions import DIRECTIONS, LAYOUTS, attitude
from twin.recording.recording import Series
from twin.recording.rows import Rows, mended
from twin.recording.turns import CONTINUOUS, unwrapped
from twin.signals import LOGGED, Stream, stream_named
from twin.units import Unit, unit_named

Array = NDArray[np.float64]

WXYZ = ("w", "x", "y", "z")
EULER = ("yaw", "pitch", "roll")
QUATERNIONS = LAYOUTS[:2]
TWICE = 3e-3
"""A scale that is so near to its unit's factor (0.0175 of a degree) converts a second time."""
_CLOCK = re.compile(r"(t|stamp|time(stamp)?(_\w+)?)(\W|$)", re.IGNORECASE)
LISTED = 8
"""Columns that an error names; of more it says how many."""


@dataclass(frozen=True)
class Entry:
    """What log.toml says of one stream."""

    table: Table
    name: str
    path: Path
    variable: str | None
    topic: str | None
    canonical: Stream | None
    time: str | None
    time_factor: float
    start: float
    rate: float
    """[Hz]; NaN with a column of times."""
    clock_lag: float
    """[s] by which the file's times are late."""
    columns: tuple[str, ...]
    """As named, those to be turned about with a minus before them; empty: the rest of the file."""
    axes: tuple[str, ...]
    unit: Unit
    scale: float
    layout: str
    world_to_body: bool
    noise: Array | None

    @property
    def si(self) -> str:
        """The SI unit of the series."""
        return self.canonical.unit if self.canonical else self.unit.si

    def facts(self, files: OpenFiles) -> dict[str, Any]:
        """What the recording says of where the stream is from, and how it was read."""
        return {
            "file": self.path.name,
            "unit": self.table.raw("unit"),
            "noise": self._noise_by_name(self._open(files)),
            "fit_scale": self.table.raw("scale") == "fit",
            "columns": list(self._columns(self._open(files))),
            "listed": bool(self.columns) and not self.axes,
            "time_unit": self.table.raw("time_unit"),
            "rate": self.table.raw("rate"),
            "clock_lag": self.clock_lag,
            "format": self.layout or None,
            "direction": DIRECTIONS[self.world_to_body] if self.layout else None,
        }

    @classmethod
    def read(cls, table: Table, folder: Path, name: str) -> "Entry":
        """Check the entry.

        Raises:
            LogError: a key is wrong, with its line.
        """
        canonical = _canonical(table, name)
        turned = canonical is not None and canonical.columns == WXYZ
        layout = table.text("format", LAYOUTS[0], among=LAYOUTS) if turned else ""
        direction = table.text("direction", DIRECTIONS[0], among=DIRECTIONS) if turned else ""
        has_time = "rate" not in table
        for key in () if has_time else ("time", "time_unit"):
            if key in table:
                raise table.fail(key, "is given beside `rate`", "remove the one or the other")
        for key in () if turned else ("format", "direction"):
            if key in table:
                raise table.fail(key, "is for attitudes", "remove it")
        path = _path(table, folder)
        unit = _unit(table, name, canonical, layout)
        entry = cls(
            table=table,
            name=name,
            path=path,
            variable=_part(table, "variable", path, ".mat"),
            topic=_part(table, "topic", path, ".mcap"),
            canonical=canonical,
            time=table.text("time", None) if has_time else None,
            time_factor=_time_factor(table) if has_time else 1.0,
            rate=table.number("rate", np.nan, low=1e-6, unit="Hz"),
            start=0.0 if has_time else table.number("start", 0.0, unit="s"),
            clock_lag=table.number("clock_lag", 0.0, unit="s"),
            columns=table.texts("columns", ()),
            axes=table.texts("axes", ()),
            unit=unit,
            scale=_scale(table, unit, _si(canonical, layout)),
            layout=layout,
            world_to_body=direction == DIRECTIONS[1],
            noise=_noise(table, canonical),
        )
        table.close()
        return entry

    def series(self, files: OpenFiles) -> tuple[Series, tuple[str, ...]]:
        """Read the file, mend what can be mended; a sentence for each repair.

        Raises:
            LogError: the file cannot be read, or does not hold what the entry says.
        """
        file = self._open(files)
        clock = self._clock(file)
        columns, signs = _signed(self._columns(file), file.header)
        layout = LAYOUTS[0] if file.by_name and not self.columns else self.layout
        names = self._names(columns, layout, file)
        where = f"{self.name} ({self.path.name})"
        rows = mended(*self._numbers(file, clock, columns), file, columns, clock, where)
        value, repairs = rows.value * signs * self.unit.factor, rows.repairs
        if not self.columns and columns != self._rest(file):
            given = ", ".join(self._rest(file))
            repairs = (*repairs, f"{where}: columns {given} taken by name, as {', '.join(columns)}")
        if self.unit.offset != 0.0:  # adding 0.0 would turn -0.0 into 0.0
            value = value + self.unit.offset
        value = value * self.scale
        if layout and names == WXYZ:
            scaled = Rows(rows.time, value, rows.origin, ())
            value, more = attitude(scaled, layout, self.world_to_body, file, where)
            repairs = (*repairs, *more)
        if self.name in CONTINUOUS:
            value, more = unwrapped(value, where)
            repairs = (*repairs, *more)
        if self.noise is not None and len(self.noise) not in (1, 3 if layout else len(names)):
            problem = f"has {len(self.noise)} numbers for {len(names)} columns"
            raise self.table.fail("noise", problem, "give one for all, or one a column")
        time = rows.time - self.clock_lag if self.clock_lag else rows.time
        return Series(time, np.ascontiguousarray(value), names, self.si), repairs

    def _open(self, files: OpenFiles) -> NumberFile:
        return files.open(self.path, unit=self.si, variable=self.variable, topic=self.topic)

    def _clock(self, file: NumberFile) -> str | None:
        """The column of times; None where `rate` gives them."""
        if self.time or not np.isnan(self.rate):
            return self.time
        named = [name for name in file.header if _CLOCK.match(name)]
        if named and file.time not in (*named, *file.clocks):
            raise self.table.fail(
                "file",
                f"has its times in {file.time!r}, its first column, unless `time` names another, "
                f"and one is called {named[0]!r}",
                f"add `time = {json.dumps(named[0])}` (or {json.dumps(file.time)})",
            )
        return file.time

    def _rest(self, file: NumberFile) -> tuple[str, ...]:
        """Every column but the clock, as the file has them."""
        clock = self._clock(file)
        return tuple(name for name in file.values if name != clock)

    def _columns(self, file: NumberFile) -> tuple[str, ...]:
        """Those of the stream, in its order: where all are named as the stream's are, by name."""
        rest = self._rest(file)
        place = {name.lower(): name for name in rest}
        expected = self._expected(self.layout)
        if self.columns or self.axes or len(place) != len(rest) or set(place) != set(expected):
            return self.columns or rest
        named = tuple(place[name] for name in expected)
        if self.layout in QUATERNIONS and "format" in self.table and not file.by_name:
            stated = tuple(place[name] for name in self.layout)
            if stated != rest:
                raise self.table.fail(
                    "format",
                    f"is {self.layout!r}, but the columns are named {', '.join(rest)}",
                    "remove `format`, and they are taken by name; if the names are wrong, list "
                    f"them as `columns = {json.dumps(rest)}`",
                )
            return rest
        return named

    def _noise_by_name(self, file: NumberFile) -> list[float] | None:
        """Of each column of the series, where the file gives one a column."""
        if self.noise is None:
            return None
        rest, noise = self._rest(file), self.noise.tolist()
        if self.columns or self.layout or len(noise) != len(rest):
            return noise
        return [noise[rest.index(name)] for name in self._columns(file)]

    def _expected(self, layout: str) -> tuple[str, ...]:
        """Names of the columns that the stream must have; empty where that is the machine's."""
        if layout == "euler_zyx":
            return EULER
        return self.canonical.columns if self.canonical else ()

    def _numbers(
        self, file: NumberFile, clock: str | None, columns: tuple[str, ...]
    ) -> tuple[Array, Array]:
        """Times [s] and values as the file has them."""
        if clock is None:
            value = file.numbers(columns)
            return self.start + np.arange(len(value)) / self.rate, value
        if clock in file.clocks and "time_unit" in self.table:
            problem = f"is given, but {clock} is in seconds by its type"
            raise self.table.fail("time_unit", problem, "remove it")
        table = file.numbers((clock, *columns))
        return table[:, 0] * self.time_factor, table[:, 1:]

    def _names(self, columns: tuple[str, ...], layout: str, file: NumberFile) -> tuple[str, ...]:
        expected = self._expected(layout)
        names = self.axes or expected or columns
        for axis in self.axes if expected else ():
            if axis not in expected:
                hint = f"use some of {', '.join(expected)}"
                raise self.table.fail("axes", f"names {axis!r}", hint)
        if len(names) != len(columns) or not columns:
            raise self._mismatch(columns, names, file)
        return names if layout != "euler_zyx" else WXYZ

    def _mismatch(
        self, columns: tuple[str, ...], names: tuple[str, ...], file: NumberFile
    ) -> Exception:
        listed = ", ".join(columns[:LISTED]) + (", ..." if len(columns) > LISTED else "")
        given = f"{len(columns)} columns ({listed})"
        if not columns:
            given = f"no column beside {', '.join(map(repr, file.header[:LISTED]))}"
        remedy = "list the right ones in `columns`, and in `axes` which of the stream they are"
        if not (self.columns or self.time or "rate" in self.table):
            remedy = f"give `rate` if the file has no times, else {remedy}"
        return self.table.fail(
            "columns" if self.columns else "file",
            f"gives {self.name} {given} for {', '.join(names) or 'its values'}",
            remedy,
        )


def _canonical(table: Table, name: str) -> Stream | None:
    try:
        return stream_named(name)
    except UnknownName:
        if "unit" in table:
            return None
        raise table.fail(
            "unit",
            f"is missing, and {name} is no stream we know "
            f"({UnknownName('stream', name, LOGGED).hint})",
            "name the stream so, or add its unit",
        ) from None


def _signed(columns: tuple[str, ...], header: tuple[str, ...]) -> tuple[tuple[str, ...], Array]:
    """The columns' names in the file, and the sign with which each is taken."""
    turned = [name.startswith("-") and name not in header for name in columns]
    names = tuple(name[t:] for name, t in zip(columns, turned, strict=True))
    return names, np.where(turned, -1.0, 1.0)


def _path(table: Table, folder: Path) -> Path:
    text = table.text("file")
    path = folder / text
    if not path.resolve().is_relative_to(folder.resolve()):
        raise table.fail("file", f"{text!r} lies outside the log's folder", "move it beside")
    if path.suffix.lower() not in ENDINGS:
        raise table.fail(
            "file",
            f"{text!r} is no format that can be read",
            f"save it as one of {', '.join(ENDINGS)}",
        )
    if not path.exists():
        raise table.fail("file", f"{text!r} is missing", "add it, or correct the name")
    if not path.is_file():
        raise table.fail("file", f"{text!r} is no file", "name the file of numbers")
    return path


def _part(table: Table, key: str, path: Path, ending: str) -> str | None:
    """The part of a file that a stream is in; such a key is for one format only."""
    if key in table and path.suffix.lower() != ending:
        raise table.fail(key, f"is for {ending} files, not for {path.name}", "remove it")
    return table.text(key, None) if path.suffix.lower() == ending else None


def _time_factor(table: Table) -> float:
    text = table.text("time_unit", "s")
    try:
        unit = unit_named(text)
    except UnknownName:
        raise table.fail("time_unit", f"is {text!r}, no unit", "use s, ms or us") from None
    if unit.si != "s":
        raise table.fail("time_unit", f"is {text!r}, a unit of {unit.si}", "use s, ms or us")
    return unit.factor


def _si(canonical: Stream | None, layout: str) -> str:
    """The unit that the file's values must come to; empty where any will do."""
    if layout == "euler_zyx":
        return "rad"
    return canonical.unit if canonical else ""


def _unit(table: Table, name: str, canonical: Stream | None, layout: str) -> Unit:
    si = _si(canonical, layout)
    text = table.text("unit", si or None)
    try:
        unit = unit_named(text)
    except UnknownName as unknown:
        raise table.fail("unit", f"is {text!r}", str(unknown)) from None
    if si and unit.si != si and "scale" not in table:
        raise table.fail(
            "unit", f"is {text!r}, but {name} is in {si}", f"use a unit of {si}, or add `scale`"
        )
    return unit


def _scale(table: Table, unit: Unit, si: str) -> float:
    if table.raw("scale", 1.0) == "fit":
        return 1.0
    scale = table.number("scale", 1.0)
    if scale == 0.0:
        raise table.fail("scale", "is 0", "give the factor to SI")
    converts = unit.si == si and unit.factor != 1.0
    if converts and abs(scale / unit.factor - 1.0) < TWICE:
        raise table.fail(
            "scale",
            f"is {scale:g}, which is {table.text('unit')} in {si}, and `unit` converts already",
            "remove `scale`, which multiplies what `unit` gives",
        )
    return scale


def _noise(table: Table, canonical: Stream | None) -> Array | None:
    if "noise" not in table:
        return None
    unit = canonical.unit if canonical else "its SI unit"
    size = None if isinstance(table.raw("noise"), list) else 1
    noise = table.numbers("noise", size, low=0.0, unit=unit)
    if not noise.all():
        raise table.fail("noise", "is 0", "give what a sample scatters by, or leave it out")
    return noise
