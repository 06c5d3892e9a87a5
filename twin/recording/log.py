"""A measured log on disk: a folder with log.toml and tables (docs/design.md 4.3) -> `Recording`.

What is wrong with a table is an error with file, line and remedy; what can be mended without
guessing is mended, counted and said in `Recording.repairs`. Nothing is dropped silently.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.config import Table, read_toml
from twin.errors import LogError, UnknownName
from twin.recording.recording import Recording, Series
from twin.recording.table import CsvFile, read_csv
from twin.recording.timing import in_order
from twin.signals import Stream, stream_named
from twin.units import Unit, unit_named

Array = NDArray[np.float64]

READABLE = (".csv",)
"""Endings of the tables that can be read."""

ROUNDING = 1e-12
"""Quaternions whose length is off by less stay as they are, to the last bit."""

EPOCH = 1e6
"""Times above this [s] count from 1970 or from power-on: the log's own start becomes 0."""


def read_log(path: str | Path) -> Recording:
    """Read a measured log: its folder, or the log.toml in it.

    `provenance` holds `kind` ("log"), `source`, `platform` (a name, or the path of a folder),
    `environment`, `notes`, and under `streams` each stream's file, unit and stated noise [SI].

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
    notes = table.table("notes", required=False)
    streams_table = table.table("streams")
    streams: dict[str, Series] = {}
    facts: dict[str, Any] = {}
    repairs: list[str] = []
    files: dict[Path, CsvFile] = {}
    for name in streams_table.keys:
        entry = _Entry.read(streams_table.table(name), folder, name)
        streams[name], mended = entry.series(files)
        facts[name] = entry.facts
        repairs += mended
    if not streams:
        raise streams_table.fail("streams", "names no stream", "add [streams.gyro] or another")
    table.close()
    origin = min(series.time[0] for series in streams.values())
    if abs(origin) > EPOCH:
        streams = {name: _shifted(series, origin) for name, series in streams.items()}
    provenance = {
        "kind": "log",
        "source": str(folder),
        "platform": platform,
        "environment": environment,
        "notes": {key: _plain(notes.raw(key)) for key in notes.keys},
        "streams": facts,
        "time_origin": origin if abs(origin) > EPOCH else 0.0,
    }
    return Recording(streams, provenance, tuple(repairs))


@dataclass(frozen=True)
class _Entry:
    """One [streams.NAME] of log.toml, checked but for its file."""

    table: Table
    name: str
    path: Path
    canonical: Stream | None
    time: str | None
    time_factor: float
    start: float
    rate: float
    columns: tuple[str, ...]
    axes: tuple[str, ...]
    unit: Unit
    scale: float
    format: str
    world_to_body: bool
    noise: Array | None

    @property
    def facts(self) -> dict[str, Any]:
        """What the recording says of where the stream is from."""
        raw_scale = self.table.raw("scale")
        return {
            "file": self.path.name,
            "unit": self.table.raw("unit"),
            "noise": None if self.noise is None else self.noise.tolist(),
            "fit_scale": raw_scale == "fit",
        }

    @classmethod
    def read(cls, table: Table, folder: Path, name: str) -> "_Entry":
        canonical = _canonical(table, name)
        attitude = canonical is not None and canonical.columns == ("w", "x", "y", "z")
        layout = "wxyz"
        if attitude:
            layout = table.text("format", "wxyz", among=("wxyz", "xyzw", "euler_zyx"))
        directions = ("body_to_world", "world_to_body")
        direction = table.text("direction", directions[0], among=directions) if attitude else ""
        has_time = "rate" not in table
        scale = _scale(table)
        entry = cls(
            table=table,
            name=name,
            path=_path(table, folder),
            canonical=canonical,
            time=table.text("time", None) if has_time else None,
            time_factor=_time_factor(table) if has_time else 1.0,
            rate=table.number("rate", np.nan, low=1e-6, unit="Hz"),
            start=0.0 if has_time else table.number("start", 0.0, unit="s"),
            columns=table.texts("columns", ()),
            axes=table.texts("axes", ()),
            unit=_unit(table, name, canonical, layout, scaled="scale" in table),
            scale=scale,
            format=layout,
            world_to_body=direction == "world_to_body",
            noise=_noise(table, canonical),
        )
        table.close()
        return entry

    def series(self, files: dict[Path, CsvFile]) -> tuple[Series, list[str]]:
        """Read the file (once for all its streams), mend what can be mended."""
        if self.path not in files:
            files[self.path] = read_csv(self.path)
        file = files[self.path]
        time_column = (self.time or file.header[0],) if np.isnan(self.rate) else ()
        columns = self.columns or tuple(c for c in file.header if c not in time_column)
        names = self._names(file, columns)
        table = file.numbers((*time_column, *columns))
        if time_column:
            time, value = table[:, 0] * self.time_factor, table[:, 1:]
        else:
            time, value = self.start + np.arange(len(table)) / self.rate, table
        where = f"{self.name} ({self.path.name})"
        time, value, repairs = in_order(time, value, file, where)
        value = value * self.unit.factor
        if self.unit.offset != 0.0:  # adding 0.0 would turn -0.0 into 0.0
            value = value + self.unit.offset
        value = value * self.scale
        if names == ("w", "x", "y", "z"):
            value = self._attitude(value, file, where, repairs)
        si = self.canonical.unit if self.canonical else self.unit.si
        return Series(time, np.ascontiguousarray(value), names, si), repairs

    def _names(self, file: CsvFile, columns: tuple[str, ...]) -> tuple[str, ...]:
        expected = self.canonical.columns if self.canonical else ()
        if self.format == "euler_zyx":
            expected = ("yaw", "pitch", "roll")
        names = self.axes or expected or columns
        for axis in self.axes if expected else ():
            if axis not in expected:
                hint = f"use some of {', '.join(expected)}"
                raise self.table.fail("axes", f"names {axis!r}", hint)
        if len(names) != len(columns):
            raise self.table.fail(
                "columns" if self.columns else "file",
                f"gives {self.name} {len(columns)} columns ({', '.join(columns)}) for "
                f"{', '.join(names)}",
                "list the right ones in `columns`, and in `axes` which of the stream they are",
            )
        return names if self.format != "euler_zyx" else ("w", "x", "y", "z")

    def _attitude(self, value: Array, file: CsvFile, where: str, repairs: list[str]) -> Array:
        if self.format == "euler_zyx":
            quaternion = rotation.from_euler_zyx(*value.T)
        else:
            quaternion = value[:, [3, 0, 1, 2]] if self.format == "xyzw" else value
            length = np.linalg.norm(quaternion, axis=1)
            if length.min() < 0.1:
                row = int(np.argmin(length))
                raise LogError(
                    self.path,
                    f"{self.name} has a quaternion of length {length[row]:.3g}",
                    "check `format` and `columns`, or delete the row",
                    line=file.line_of(row),
                )
            off = np.abs(length - 1.0)
            if off.max() > 1e-3:
                repairs.append(
                    f"{where}: {np.count_nonzero(off > 1e-3)} of {len(off)} quaternions scaled to "
                    f"length 1, the worst was {length[np.argmax(off)]:.4g}"
                )
            if off.max() > ROUNDING:
                quaternion = rotation.normalized(quaternion)
        if self.world_to_body:
            quaternion = rotation.conjugate(quaternion)
        flips = np.einsum("ij,ij->i", quaternion[1:], quaternion[:-1]) < 0.0
        sign = np.where(np.concatenate([[0], np.cumsum(flips)]) % 2, -1.0, 1.0)
        return quaternion * sign[:, None]


def _platform(table: Table, folder: Path) -> str:
    name = table.text("platform")
    beside = folder / name
    return str(beside.resolve()) if (beside / "platform.toml").is_file() else name


def _environment(table: Table) -> dict[str, Any]:
    environment = table.table("environment", required=False)
    known: dict[str, Any] = {}
    if "magnetic_field" in environment:
        field = environment.numbers("magnetic_field", 3, unit="T")
        known["magnetic_field"] = field.tolist()
    if "gravity" in environment:
        known["gravity"] = environment.number("gravity", low=0.0, unit="m/s^2")
    environment.close()
    return known


def _canonical(table: Table, name: str) -> Stream | None:
    try:
        return stream_named(name)
    except UnknownName as unknown:
        if "unit" in table:
            return None
        hint = str(unknown).split("(", 1)[1].rstrip(")")
        raise table.fail(
            "unit",
            f"is missing, and {name} is no stream we know ({hint})",
            "name the stream so, or add its unit",
        ) from None


def _path(table: Table, folder: Path) -> Path:
    text = table.text("file")
    path = folder / text
    if not path.resolve().is_relative_to(folder.resolve()):
        raise table.fail("file", f"{text!r} lies outside the log's folder", "move it beside")
    if path.suffix.lower() not in READABLE:
        raise table.fail(
            "file",
            f"{text!r} is no format that can be read",
            f"save it as one of {', '.join(READABLE)}",
        )
    if not path.exists():
        raise table.fail("file", f"{text!r} is missing", "add it, or correct the name")
    return path


def _time_factor(table: Table) -> float:
    text = table.text("time_unit", "s")
    try:
        unit = unit_named(text)
    except UnknownName as unknown:
        raise table.fail("time_unit", f"is {text!r}", str(unknown)) from None
    if unit.si != "s":
        raise table.fail("time_unit", f"is {text!r}, a unit of {unit.si}", "use s, ms or us")
    return unit.factor


def _unit(table: Table, name: str, canonical: Stream | None, layout: str, scaled: bool) -> Unit:
    si = canonical.unit if canonical else ""
    if layout == "euler_zyx":
        si = "rad"
    text = table.text("unit", si or None)
    try:
        unit = unit_named(text)
    except UnknownName as unknown:
        raise table.fail("unit", f"is {text!r}", str(unknown)) from None
    if si and unit.si != si and not scaled:
        raise table.fail(
            "unit", f"is {text!r}, but {name} is in {si}", f"use a unit of {si}, or add `scale`"
        )
    return unit


def _scale(table: Table) -> float:
    if table.raw("scale", 1.0) == "fit":
        return 1.0
    scale = table.number("scale", 1.0)
    if scale == 0.0:
        raise table.fail("scale", "is 0", "give the factor to SI")
    return scale


def _noise(table: Table, canonical: Stream | None) -> Array | None:
    if "noise" not in table:
        return None
    unit = canonical.unit if canonical else "its SI unit"
    if isinstance(table.raw("noise"), list):
        return table.numbers("noise", None, low=0.0, unit=unit)
    return table.numbers("noise", 1, low=0.0, unit=unit)


def _shifted(series: Series, origin: float) -> Series:
    return Series(series.time - origin, series.value, series.columns, series.unit)


def _plain(value: Any) -> Any:
    """JSON has no dates: they become text."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}  # pyright: ignore
    if isinstance(value, list):
        return [_plain(entry) for entry in value]  # pyright: ignore
    return value if isinstance(value, str | int | float | bool) else str(value)
