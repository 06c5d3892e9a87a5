"""The tables in a file: named columns on one clock, whatever the format."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.column_names import is_clock
from twin.recording.formats import (
    ARRAYS,
    TEXTS,
    TOPICS,
    NumberFile,
    OpenFiles,
    is_dataflash,
)

Array = NDArray[np.float64]

LOOKED_AT = 2000
"""Rows from which a column's kind is judged: enough for its size, its steps and its sign."""
_NO_STREAMS = r"Image|PointCloud|LaserScan|CameraInfo|Marker|String|Log$|Diagnostic|Parameter|TFM"
"""Types of messages that hold no stream of a machine."""


@dataclass
class DataTable:
    """Columns that share their rows."""

    file: NumberFile
    keys: Mapping[str, str]
    """What log.toml says of where the table is: `variable` or `topic`."""
    names: Sequence[str]
    """Of its columns, as log.toml names them."""
    preamble: Sequence[str] = ()
    """Lines of text above it."""
    type: str = ""
    """Of its messages."""
    _seen: dict[str, Array | None] | None = None

    def column(self, name: str) -> Array | None:
        """The first rows of a column, from its first number on; None where it holds none."""
        rows = self._rows(name)
        if rows is None:
            return None
        first = int(np.argmax(np.isfinite(rows)))
        return rows[first : first + LOOKED_AT]

    def _rows(self, name: str) -> Array | None:
        """As many as were read, of a text at least from where it holds numbers."""
        if self._seen is None:
            self._seen = self._look()
        return self._seen.get(name)

    def _look(self) -> dict[str, Array | None]:
        file = self.file.beginning()
        try:
            together = file.numbers(self.names)
            found = {name: column for name, column in zip(self.names, together.T, strict=True)}
        except LogError:  # text among them, or columns of several lengths
            found = {name: _whole(file, name) for name in self.names}
        late = [name for name, rows in found.items() if rows is not None and not _any(rows)]
        if late and file is not self.file:  # a camera that sees nothing for the first minutes
            found |= {name: _whole(self.file, name) for name in late}
        return {name: rows if _any(rows) else None for name, rows in found.items()}

    def columns(self, names: Sequence[str]) -> Array | None:
        """The first rows of some columns (m, k), those that are whole; None without any."""
        result = [rows for name in names if (rows := self._rows(name)) is not None]
        if not result or len(result) < len(names):
            return None
        shortest = min(map(len, result))
        finite = np.logical_and.reduce([np.isfinite(rows[:shortest]) for rows in result])
        (whole,) = np.nonzero(finite)
        if len(whole) < 2:
            return None
        return np.stack([rows[whole[:LOOKED_AT]] for rows in result], axis=-1)

    def unit(self, name: str) -> str:
        """The unit's text that the file states beside a column's name."""
        return self.file.units.get(name, "").strip("[]() ")


def _any(values: Array | None) -> bool:
    return values is not None and bool(np.isfinite(values).any())


def tables_in(path: Path) -> Iterator[DataTable]:
    """All tables of a file.

    Raises:
        LogError: it cannot be read.
    """
    ending = path.suffix.lower()
    files = OpenFiles()
    if ending in TOPICS:
        yield from _topics(path, files)
    elif is_dataflash(path):
        yield from _arrays(files.open(path, unit=""), "DataFlash")
    elif ending in ARRAYS and ending != ".xlsx":
        yield from _arrays(files.open(path, unit=""))
    elif ending in TEXTS:
        yield from _texts(path, files)
    else:
        file = files.open(path, unit="")
        yield DataTable(file, {}, file.header)


def _texts(path: Path, files: OpenFiles) -> Iterator[DataTable]:
    from twin.recording.formats.text_file import TextFile

    file = files.open(path, unit="")
    assert isinstance(file, TextFile)
    titles = file.titles()
    if len(titles) < 2:
        yield DataTable(file, {}, file.header, file.preamble)
    for title in titles if len(titles) > 1 else ():
        part = files.open(path, unit="", variable=title)
        assert isinstance(part, TextFile)
        yield DataTable(part, {"variable": title}, part.header, part.preamble)


def _arrays(file: NumberFile, kind: str = "") -> Iterator[DataTable]:
    """Of each group those columns that are as long as its clock, or as the longest of them; numbers
    that stand alone are said as lines of text: `sampling_rate 100`. A group without a clock has
    that of a group above or beside it, if that is as long."""
    groups: dict[str, list[str]] = {}
    for name in file.header:
        stem = re.sub(r"\.\d+$", "", name)
        groups.setdefault(stem.rpartition(".")[0], []).append(name)
    alone = list[str]()
    lengths: dict[str, dict[str, int]] = {}
    for group, names in groups.items():
        columns = {name: column for name in names if (column := _whole(file, name)) is not None}
        lengths[group] = {name: len(column) for name, column in columns.items() if len(column) > 1}
        alone += [f"{name} {column[0]:g}" for name, column in columns.items() if len(column) == 1]
    clocks = {group: _clocks(names) for group, names in lengths.items()}
    for group, names in lengths.items():
        if not names:
            continue
        usual = names[clocks[group][0]] if clocks[group] else max(names.values())
        whole = [name for name, rows in names.items() if rows == usual]
        above = [clock for clock in clocks if clock == "" or f"{group}.".startswith(f"{clock}.")]
        parent = group.rpartition(".")[0]
        beside = [clock for clock in clocks if parent and clock.startswith(f"{parent}.")]
        shared = [
            name
            for item in (*above, *beside)
            for name in clocks[item]
            if not clocks[group] and lengths[item][name] == usual
        ]
        if len(whole) > 1 or not clocks[group] or len(groups) == 1:
            yield DataTable(file, {}, [*shared[:1], *whole], alone, kind)


def _clocks(names: Iterable[str]) -> list[str]:
    return [name for name in names if is_clock(name.rpartition(".")[2])]


def _whole(file: NumberFile, name: str) -> Array | None:
    try:
        return file.numbers((name,))[:, 0]
    except LogError:
        return None


def _topics(path: Path, files: OpenFiles) -> Iterator[DataTable]:
    """Topics whose messages hold numbers; of each the first messages, for a file may be large."""
    messages = files.messages(path)
    types = messages.types()
    names = [name for name, kind in types.items() if not re.search(_NO_STREAMS, kind)]
    messages.look(names)
    for name in names:
        try:
            file = files.open(path, unit="", topic=name).beginning()
        except LogError:  # no numbers, or no message
            continue
        yield DataTable(file, {"topic": name}, file.header, type=types[name])
