"""One [streams.NAME] of a log.toml, checked key by key, and the series in the file it names."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.config import Table
from twin.errors import UnknownName
from twin.recording.column_names import (
    in_order,
    is_clock,
    is_counter,
    stated_time_unit,
    stated_unit,
)
from twin.recording.entry_units import noise_of, scale_of, si_of, time_factor, unit_of
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
TURN = 2.0 * np.pi
"""Angles beyond are of a body that turns on, or in degrees [rad]."""
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
        unit = unit_of(table, name, canonical, layout)
        entry = cls(
            table=table,
            name=name,
            path=path,
            variable=_part(table, "variable", path, ".mat"),
            topic=_part(table, "topic", path, ".mcap"),
            canonical=canonical,
            time=table.text("time", None) if has_time else None,
            time_factor=time_factor(table) if has_time else 1.0,
            rate=table.number("rate", np.nan, low=1e-6, unit="Hz"),
            start=0.0 if has_time else table.number("start", 0.0, unit="s"),
            clock_lag=table.number("clock_lag", 0.0, unit="s"),
            columns=table.texts("columns", ()),
            axes=table.texts("axes", ()),
            unit=unit,
            scale=scale_of(table, unit, si_of(canonical, layout)),
            layout=layout,
            world_to_body=direction == DIRECTIONS[1],
            noise=noise_of(table, canonical),
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
        self._check_names(columns, clock, file)
        rows = mended(*self._numbers(file, clock, columns), file, columns, clock, where)
        value, repairs = rows.value * signs * self.unit.factor, rows.repairs
        if not self.columns and columns != self._rest(file):
            given = ", ".join(self._rest(file))
            repairs = (*repairs, f"{where}: columns {given} taken by name, as {', '.join(columns)}")
        if self.unit.offset != 0.0:  # adding 0.0 would turn -0.0 into 0.0
            value = value + self.unit.offset
        value = value * self.scale
        angles = value
        if layout and names == WXYZ:
            scaled = Rows(rows.time, value, rows.origin, ())
            value, more = attitude(scaled, layout, self.world_to_body, file, where)
            repairs = (*repairs, *more)
        if layout == "euler_zyx" and {"unit", "scale"}.isdisjoint(self.table.keys):
            self._check_angles(angles)
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
        named = [name for name in file.header if is_clock(name)]
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
        listed = self.columns or self.axes
        named = None if listed else in_order(rest, self._expected(self.layout))
        if named is None:
            return self.columns or rest
        if self.layout in QUATERNIONS and "format" in self.table and not file.by_name:
            if in_order(rest, self.layout) != rest:
                raise self.table.fail(
                    "format",
                    f"is {self.layout!r}, but the columns are named {', '.join(rest)}",
                    "remove `format`, and they are taken by name; if the names are wrong, list "
                    f"them as `columns = {json.dumps(rest)}`",
                )
            return rest
        return named

    def _check_names(self, columns: tuple[str, ...], clock: str | None, file: NumberFile) -> None:
        """Refuse columns that stand for two things, and units that only their names state."""
        named = (*columns, clock) if clock else columns
        named = (*columns, clock) if clock else columns
        for key, names in (("columns", named), ("axes", self.axes)):
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is None:
                continue
            if key == "columns" and twice == clock:
                problem = f"lists {twice!r}, which the times are taken from"
                raise self.table.fail(
                    key, problem, "take it out, name another `time`, or give `rate`"
                )
            raise self.table.fail(key, f"lists {twice!r} twice", "name each once")
        open_unit = {"unit", "scale"}.isdisjoint(self.table.keys)
        for name in columns if open_unit else ():
            text = stated_unit(name)
            if text and unit_named(text) != self.unit:
                raise self.table.fail(
                    "unit",
                    f"is not given, and a column is named {name!r}",
                    f'add `unit = "{text}"`, or `unit = "{self.si}"` if the name is wrong',
                )
        text = "" if clock is None or clock in file.clocks else stated_time_unit(clock)
        if text and "time_unit" not in self.table and unit_named(text).factor != 1.0:
            raise self.table.fail(
                "time_unit",
                f"is not given, and the times are named {clock!r}",
                f'add `time_unit = "{text}"`, or `time_unit = "s"` if the name is wrong',
            )

    def _check_angles(self, value: Array) -> None:
        """Degrees that nobody called so turn the body far oftener than it turned."""
        most = float(np.nanmax(np.abs(value)))
        if most > TURN:
            raise self.table.fail(
                "unit",
                f"is not given, and the angles reach {most:.4g}",
                'add `unit = "deg"`, or `unit = "rad"` if the body turned on and on',
            )

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
        counts = self.time is None and is_counter(clock) and len(table) > 1
        if counts and (np.diff(table[:, 0]) == 1.0).all():
            raise self.table.fail(
                "file",
                f"has its times in {clock!r}, its first column, and that counts rows",
                f"name a column of times as `time` ({json.dumps(clock)} if these are seconds), or "
                "give `rate`",
            )
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
