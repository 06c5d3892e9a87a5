"""One [streams.NAME] of a log.toml, checked key by key, and the series in the file it names."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
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
    names_a_clock,
    stated_time_unit,
    stated_unit,
)
from twin.recording.formats import ARRAYS, ENDINGS, TEXTS, TOPICS, NumberFile, OpenFiles
from twin.recording.recording import Series
from twin.recording.rows import (
    CONTINUOUS,
    DIRECTIONS,
    LAYOUTS,
    attitude,
    columns_of,
    mended,
    started,
    unwrapped,
    writable,
)
from twin.recording.timeline import (
    Timeline,
    clocks_among,
    counted,
    counts_samples,
    is_count,
    lost_by_counter,
    over_midnight,
)
from twin.signals import LOGGED, Stream, stream_named
from twin.units import Unit, known_unit, unit_named

Array = NDArray[np.float64]


TWICE = 3e-3
"""A scale that is so near to its unit's factor (0.0175 of a degree) converts a second time."""


def time_factor(table: Table) -> float:
    """To seconds."""
    if "time_scale" in table:
        if "time_unit" in table:
            raise table.fail("time_scale", "is given beside `time_unit`", "remove one of them")
        scale = table.number("time_scale", low=0.0, unit="s a count")
        if scale == 0.0:
            raise table.fail("time_scale", "is 0", "give the seconds of one count")
        return scale
    text = table.text("time_unit", "s")
    try:
        unit = unit_named(text)
    except UnknownName:
        raise table.fail(
            "time_unit",
            f"is {text!r}, no unit",
            "use s, ms or us, or `time_scale`, the seconds of one count",
        ) from None
    if unit.si != "s":
        raise table.fail("time_unit", f"is {text!r}, a unit of {unit.si}", "use s, ms or us")
    return unit.factor


def si_of(canonical: Stream | None, layout: str) -> str:
    """The unit that the file's values must come to; empty where any will do."""
    if layout.startswith("euler") or layout in ("rotation_vector", "heading"):
        return "rad"
    return canonical.unit if canonical else ""


def unit_of(table: Table, name: str, canonical: Stream | None, layout: str) -> Unit:
    """Of the file's values."""
    si = si_of(canonical, layout)
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


def scale_of(table: Table, unit: Unit, si: str) -> Array:
    """(1,) or (k,) what the values are multiplied by after that, one for all or one a column."""
    if table.raw("scale", 1.0) == "fit":
        return np.ones(1)
    listed = isinstance(table.raw("scale", 1.0), list)
    scale = table.numbers("scale", None if listed else 1, np.ones(1))
    if not scale.all():
        raise table.fail("scale", "is 0" if not listed else "holds 0", "give the factor to SI")
    converts = unit.si == si and unit.factor != 1.0
    if converts and (np.abs(scale / unit.factor - 1.0) < TWICE).any():
        raise table.fail(
            "scale",
            f"is {scale[0]:g}, which is {table.text('unit')} in {si}, and `unit` converts already",
            "remove `scale`, which multiplies what `unit` gives",
        )
    return scale


def noise_of(table: Table, canonical: Stream | None) -> Array | None:
    """(k,) or (1,) 1 sigma of a sample [SI]; None where nothing is stated."""
    if "noise" not in table:
        return None
    unit = canonical.unit if canonical else "its SI unit"
    size = None if isinstance(table.raw("noise"), list) else 1
    noise = table.numbers("noise", size, low=0.0, unit=unit)
    if not noise.all():
        raise table.fail("noise", "is 0", "give what a sample scatters by, or leave it out")
    return noise


WXYZ = ("w", "x", "y", "z")
QUATERNIONS = LAYOUTS[:2]
WITH_VARIABLES = (*TEXTS, *ARRAYS)
FEW_KINDS = 5
"""A first column with more different numbers tells no kinds of rows."""
LEAST_OF_KIND = 0.02
"""Share of the rows that each kind has at least."""
TURN = 2.0 * np.pi
"""Angles beyond are of a body that turns on, or in degrees [rad]."""
LISTED = 8
"""Columns that an error names; of more it says how many."""


@dataclass(frozen=True)
class Selection:
    """Where in its file a stream is."""

    file: NumberFile
    clock: str | None
    """The column of times, or of a counter beside `rate`; None where the rows alone count."""
    columns: tuple[str, ...]
    signs: Array
    """With which each is taken."""
    layout: str
    """Of an attitude."""
    names: tuple[str, ...]
    """Of the stream's columns."""
    kinds: tuple[str, ...]
    """Columns that pick the rows."""
    kind_of_row: str | None
    """A column that nobody named, and that may tell rows of several kinds."""

    @property
    def tables(self) -> tuple[tuple[str, ...], ...]:
        """What the file is asked for: times, values, what picks the rows, and what tells kinds.

        Each is an array of its own, so that none is copied out of another; the times of several
        streams are the same one.
        """
        clocks = () if self.clock is None else (self.clock,)
        first = () if self.kind_of_row is None else (self.kind_of_row,)
        return clocks, self.columns, self.kinds, first


@dataclass(frozen=True)
class Entry:
    """What log.toml says of one stream."""

    table: Table
    name: str
    path: Path
    variable: str | None
    topic: str | None
    decimal: str | None
    kinds: Mapping[str, float]
    """Only rows with these values in these columns are of the stream."""
    canonical: Stream | None
    time: str | None
    time_factor: float
    start: float
    rate: float
    """[Hz]; NaN with a column of times. With one beside it, that counts samples."""
    clock_lag: float
    """[s] by which the file's times are late."""
    columns: tuple[str, ...]
    """As named, those to be turned about with a minus before them; empty: the rest of the file."""
    axes: tuple[str, ...]
    unit: Unit
    scale: Array
    """(1,) or (k,) on top of what the unit gives."""
    layout: str
    world_to_body: bool
    noise: Array | None

    @property
    def si(self) -> str:
        """The SI unit of the series."""
        return self.canonical.unit if self.canonical else self.unit.si

    @property
    def is_of_whole(self) -> bool:
        """Whether a part of the file does not do: angles count turns from the log's start, or show
        by the largest of them that they are degrees."""
        unstated = {"unit", "scale"}.isdisjoint(self.table.keys)
        return self.name in CONTINUOUS or (unstated and self.layout.startswith("euler"))

    def facts(self, selection: "Selection") -> dict[str, Any]:
        """What the recording says of where the stream is from, and how it was read."""
        return {
            "file": self.path.name,
            "unit": self.table.raw("unit"),
            "noise": self._noise_by_name(selection.file),
            "fit_scale": self.table.raw("scale") == "fit",
            "columns": list(self._columns(selection.file)),
            "listed": bool(self.columns) and not self.axes,
            "time_unit": self.table.raw("time_unit"),
            "time_scale": self.table.raw("time_scale"),
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
        has_rate = "rate" in table
        for key in ("time_unit", "time_scale") if has_rate else ():
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
            variable=_part(table, "variable", path, WITH_VARIABLES),
            topic=_part(table, "topic", path, TOPICS),
            decimal=_decimal(table, path),
            kinds=_kinds(table),
            canonical=canonical,
            time=table.text("time", None),
            time_factor=1.0 if has_rate else time_factor(table),
            rate=table.number("rate", np.nan, low=1e-6, unit="Hz"),
            start=table.number("start", 0.0, unit="s") if has_rate else 0.0,
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

    def select(self, files: OpenFiles, *, whole: bool = True) -> "Selection":
        """Find the stream's columns in the file, and tell the file which numbers it will give: all
        that the stream has, or what `timeline` asks for.

        Raises:
            LogError: the file cannot be read, or does not have what the entry says.
        """
        file = files.open(
            self.path,
            unit=self.si,
            variable=self.variable,
            topic=self.topic,
            decimal=self.decimal,
        )
        clock = self._clock(file)
        columns, signs = _signed(self._columns(file), file.header)
        layout = LAYOUTS[0] if file.by_name and not self.columns else self.layout
        names = self._names(columns, layout, file)
        self._check_names(columns, clock, file)
        clocks = () if clock is None else (clock,)
        kind_of_row = self._kind_of_row(file, (*clocks, *columns))
        kinds = tuple(self.kinds)
        selection = Selection(
            file, clock, columns, signs, layout, names, kinds=kinds, kind_of_row=kind_of_row
        )
        for table in selection.tables:
            if whole or table != columns:
                file.expect(table)
        if not whole:
            file.expect_filled(columns)
        return selection

    def timeline(self, selection: "Selection") -> "Timeline":
        """When each row was, before any number of the stream is kept.

        Raises:
            LogError: the file cannot be read, or does not hold what the entry says.
        """
        file = selection.file
        filled = file.filled(selection.columns)
        time, rows, lost = self._timed(selection, len(filled))
        if self.kinds:
            filled = filled[rows]
        has = filled > 0
        if selection.layout in QUATERNIONS:  # zeros before the sensor started
            has &= np.maximum.accumulate(filled) > 1
        has &= np.isfinite(time)
        return Timeline(time, rows if self.kinds else None, lost, has, self.clock_lag)

    def series(
        self, selection: "Selection", timeline: "Timeline | None" = None
    ) -> tuple[Series, tuple[str, ...]]:
        """Read the numbers, mend what can be mended; a sentence for each repair.

        Args:
            selection: where they are.
            timeline: when the file's rows were, of which it then gives some (`NumberFile.only`).

        Raises:
            LogError: the file cannot be read, or does not hold what the entry says.
        """
        file, columns, layout = selection.file, selection.columns, selection.layout
        names = selection.names
        where = f"{self.name} ({self.path.name})"
        time, value, origin, lost = self._numbers(selection, timeline)
        rows = mended(time, value, file, columns, selection.clock, where, origin)
        if layout in QUATERNIONS:
            rows = started(rows, where)
        del time, value
        factor = selection.signs * self.unit.factor
        value = rows.value
        if (factor != 1.0).any():
            value = np.multiply(value, factor, out=writable(value))
        repairs = (*rows.repairs, *lost)
        if not self.columns and columns != self._rest(file):
            given = ", ".join(self._rest(file))
            repairs = (*repairs, f"{where}: columns {given} taken by name, as {', '.join(columns)}")
        if self.unit.offset != 0.0:  # adding 0.0 would turn -0.0 into 0.0
            value = np.add(value, self.unit.offset, out=writable(value))
        if len(self.scale) not in (1, value.shape[1]):
            problem = f"has {len(self.scale)} numbers for {value.shape[1]} columns"
            raise self.table.fail("scale", problem, "give one for all, or one a column")
        if (self.scale != 1.0).any():
            value = np.multiply(value, self.scale, out=writable(value))
        rows = replace(rows, value=value)
        if layout and names == WXYZ:
            value, more = attitude(rows, layout, self.world_to_body, file, where)
            repairs = (*repairs, *more)
        angles = layout.startswith("euler") or layout == "heading"
        if angles and {"unit", "scale"}.isdisjoint(self.table.keys):
            self._check_angles(rows.value)
        if self.name in CONTINUOUS:
            value, more = unwrapped(value, where)
            repairs = (*repairs, *more)
        if self.noise is not None and len(self.noise) not in (1, 3 if layout else len(names)):
            problem = f"has {len(self.noise)} numbers for {len(names)} columns"
            raise self.table.fail("noise", problem, "give one for all, or one a column")
        time = rows.time - self.clock_lag if self.clock_lag else rows.time
        return Series(time, np.ascontiguousarray(value), names, self.si), repairs

    def _clock(self, file: NumberFile) -> str | None:
        """The column of times, or of a counter beside `rate`; None where the rows alone count."""
        if self.time:
            return self.time
        if not np.isnan(self.rate):
            listed = {name.removeprefix("-") for name in self.columns}
            unused = [name for name in file.header if name not in listed]
            return next((name for name in unused if is_counter(name)), None)
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
        for name in file.repeated if not (self.columns or self.axes) else ():
            numbered = [column for column in columns if column.startswith(f"{name}.")]
            if numbered:
                listed = " or ".join(f'"{item}"' for item in numbered)
                raise file.fault(
                    f"names two columns {name!r}",
                    f"give each its own name, or list them in `columns` as {listed}",
                )
        # what stands behind the parts of a quaternion or a matrix is no unit
        without_unit = self.layout in (*QUATERNIONS, "matrix")
        open_unit = not without_unit and {"unit", "scale"}.isdisjoint(self.table.keys)
        for name in columns if open_unit else ():
            text = file.units.get(name) or stated_unit(name)
            unit = known_unit(text.strip("[]() ")) if text else self.unit
            if unit is None:
                raise self.table.fail(
                    "unit",
                    f"is not given, and {text!r}, which is no unit we know, stands by {name!r}",
                    f'add `unit = "{self.si}"`, or the right one',
                )
            if unit != self.unit and unit.si != "1":
                text = text.strip("[]() ")
                below = file.units.get(name)
                stands = (
                    f"{text!r} stands below {name!r}" if below else f"a column is named {name!r}"
                )
                raise self.table.fail(
                    "unit",
                    f"is not given, and {stands}",
                    f'add `unit = "{text}"`, or `unit = "{self.si}"` if that is wrong',
                )
        self._check_time_unit(clock, file)

    def _check_time_unit(self, clock: str | None, file: NumberFile) -> None:
        if clock is None or clock in file.clocks or not np.isnan(self.rate):
            return
        if not {"time_unit", "time_scale"}.isdisjoint(self.table.keys):
            return
        text = (file.units.get(clock) or stated_time_unit(clock)).strip("[]() ")
        unit = known_unit(text) if text else None
        if text and unit is None:
            raise self.table.fail(
                "time_unit",
                f"is not given, and {text!r}, no unit of time that we know, stands by {clock!r}",
                'add `time_unit = "s"`, or `time_scale`, the seconds of one count',
            )
        if unit is not None and unit.si == "s" and unit.factor != 1.0:
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
        if layout and layout not in QUATERNIONS:
            return columns_of(layout)
        return self.canonical.columns if self.canonical else ()

    def _numbers(
        self, selection: "Selection", timeline: "Timeline | None"
    ) -> tuple[Array, Array, NDArray[np.intp], tuple[str, ...]]:
        """Times [s] and values as the file has them, their rows, and what a counter says."""
        file = selection.file
        value = file.numbers(selection.columns)
        if timeline is None:
            time, rows, lost = self._timed(selection, len(value))
            return time, value[rows] if self.kinds else value, rows, lost
        time, here, rows = timeline.part(file.offset, len(value))
        return time, value if len(here) == len(value) else value[here], rows, timeline.lost

    def _timed(
        self, selection: "Selection", count: int
    ) -> tuple[Array, NDArray[np.intp], tuple[str, ...]]:
        """Times [s] of the stream's rows, which rows of the file they are, and what a counter says.

        Args:
            selection: where they are.
            count: of the values, which the file has as many of as of times.
        """
        file, clock = selection.file, selection.clock
        clocks, columns, kinds_of, first_of = selection.tables
        times, kinds, first = (
            file.numbers(names) if names else np.empty((0, 0))
            for names in (clocks, kinds_of, first_of)
        )
        for names, table in ((clocks, times), (kinds_of, kinds)):
            if names and len(table) != count:
                raise file.fault(
                    f"has {len(table)} samples in {names[0]!r} and {count} in {columns[0]!r}",
                    "name `columns` of one length, or the right `time`",
                )
        if selection.kind_of_row:
            self._check_single_kind(selection.kind_of_row, first[:, 0])
        rows = np.arange(count)
        if self.kinds:
            rows = np.flatnonzero((kinds == list(self.kinds.values())).all(axis=1))
            times = times[rows]
        if not len(rows):
            wanted = ", ".join(f"{key} = {value:g}" for key, value in self.kinds.items())
            raise self.table.fail("rows", f"picks none: no row has {wanted}", "correct it")
        if clock is None:
            return self.start + np.arange(len(rows)) / self.rate, rows, ()
        time = times[:, 0]
        if not np.isnan(self.rate):
            number, fault = counted(time)
            if number is None and self.time is not None:
                raise file.fault(f"column {clock!r} {fault}", "name another as `time`")
            if number is None or (self.time is None and not counts_samples(number)):
                return self.start + np.arange(len(rows)) / self.rate, rows, ()
            lost = lost_by_counter(number, clock, f"{self.name} ({self.path.name})")
            return self.start + number / self.rate, rows, lost
        if clock in file.clocks:
            for key in ("time_unit", "time_scale"):
                if key in self.table:
                    problem = f"is given, but {clock} is in seconds by its type"
                    raise self.table.fail(key, problem, "remove it")
            time, said = over_midnight(time, f"{self.name} ({self.path.name})")
            return time, rows, said
        self._check_clock(file, clock, time)
        if self.time_factor != 1.0:
            time = time * self.time_factor
        return time, rows, ()

    def _check_clock(self, file: NumberFile, clock: str, time: Array) -> None:
        """Refuse a first column that counts rows, by its name or beside a clock, and propose it."""
        if self.time is not None or is_clock(clock) or not is_count(time):
            return
        listed = {name.removeprefix("-") for name in self.columns}
        others = [name for name in file.header if name not in (clock, *listed)]
        result = clocks_among(file.beginning(), others)
        if not is_counter(clock) and not any(map(names_a_clock, result)):
            return  # seconds, one a row
        named = " or ".join(f"`time = {json.dumps(name)}`" for name in result)
        raise self.table.fail(
            "file",
            f"has its times in {clock!r}, its first column, and that counts rows",
            (f"write {named}" if result else "name a column of times as `time`")
            + f" ({json.dumps(clock)} if these are seconds), or give `rate`",
        )

    def _kind_of_row(self, file: NumberFile, used: tuple[str, ...]) -> str | None:
        """The column that may tell kinds of rows: the first, of a file without names."""
        key = file.header[0]
        asked = "rows" not in self.table and file.numbered and key not in used[1:]
        return key if asked else None

    def _check_single_kind(self, key: str, first: Array) -> None:
        """Refuse rows of several kinds, told by their first number."""
        kinds, counts = np.unique(first, return_counts=True)
        if not 1 < len(kinds) <= FEW_KINDS or counts.min() < LEAST_OF_KIND * len(first):
            return
        if (kinds != np.round(kinds)).any():
            return
        listed = " or ".join(f"{kind:g}" for kind in kinds)
        raise self.table.fail(
            "file",
            f"begins each row with {listed}: rows of several kinds, it seems",
            f'pick those of {self.name} with `rows = {{ "{key}" = {kinds[0]:g} }}`, or all of them '
            "with `rows = {}`",
        )

    def _names(self, columns: tuple[str, ...], layout: str, file: NumberFile) -> tuple[str, ...]:
        expected = self._expected(layout)
        names = self.axes or expected or columns
        for axis in self.axes if expected else ():
            if axis not in expected:
                hint = f"use some of {', '.join(expected)}"
                raise self.table.fail("axes", f"names {axis!r}", hint)
        if len(names) != len(columns) or not columns:
            raise self._mismatch(columns, names, file)
        return names if not layout or layout in QUATERNIONS else WXYZ

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


def _part(table: Table, key: str, path: Path, endings: tuple[str, ...]) -> str | None:
    """The part of a file that a stream is in; such a key is for some formats only."""
    if key in table and path.suffix.lower() not in endings:
        kinds = ", ".join(endings)
        raise table.fail(key, f"is for {kinds} files, not for {path.name}", "remove it")
    return table.text(key, None)


def _decimal(table: Table, path: Path) -> str | None:
    if "decimal" in table and path.suffix.lower() not in TEXTS:
        raise table.fail("decimal", f"is for text files, not for {path.name}", "remove it")
    return table.text("decimal", None, among=(",", "."))


def _kinds(table: Table) -> dict[str, float]:
    """The values of columns that pick the stream's rows."""
    rows = table.table("rows", required=False)
    return {key: rows.number(key) for key in rows.keys}
