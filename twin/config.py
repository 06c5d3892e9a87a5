"""TOML tables that know where each value stands, so that an error can name file and line.

`Table` hands out values by type and range and remembers which keys were asked for; `close`
refuses the rest, so that a misspelt key is an error and never a silently ignored setting.
"""

import copy
import difflib
import math
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from twin.errors import FileError, UnknownName

_REQUIRED: Any = object()
LARGEST = 1 << 20
"""A larger file holds no settings [bytes]; it is not read."""

_PARTS = 64
"""Of a dotted key; a reader takes the square of their number."""

_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DOTTED = re.compile(rf"(?<![\w\"'-])(?:{_PART}[ \t]*+\.[ \t]*+){{{_PARTS}}}")

_HEADER = re.compile(r"\s*\[+[^\[\],=]+\]+\s*(#.*)?$")


class Table:
    """One table of a TOML file."""

    def __init__(
        self,
        path: Path,
        data: dict[str, Any],
        lines: Sequence[str],
        name: str = "",
        first_line: int = 0,
        error: type[FileError] = FileError,
    ) -> None:
        self.path = path
        self.name = name
        self._data = data
        self._lines = lines
        self._first_line = first_line
        self._error = error
        self._asked: set[str] = set()
        self._below: Table | None = None

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys of the table, asked for or not."""
        below = () if self._below is None else self._below.keys
        return tuple(dict.fromkeys((*below, *self._data)))

    def __contains__(self, key: str) -> bool:
        return key in self._data or (self._below is not None and key in self._below)

    def over(self, below: "Table") -> "Table":
        """A table with this one's values where it has them, and those of `below` elsewhere.

        Tables lie over tables, and a table lies over each row of an array of tables. An error
        about a value names the line of the one that counts.
        """
        table = copy.copy(self)  # what was asked of the copy was asked of this
        table._below = below
        return table

    def fail(self, key: str, problem: str, remedy: str) -> FileError:
        """The error to raise about `key`, with its line."""
        if self._below is not None and (key not in self._data):
            return self._below.fail(key, problem, remedy)
        full = f"{self.name}.{key}" if self.name else key
        return self._error(self.path, f"{full} {problem}", remedy, line=self.line(key))

    def line(self, key: str) -> int | None:
        """The line (from 1) on which `key` of this table is set; the table's own without it."""
        full = re.escape(f"{self.name}.{key}" if self.name else key)
        header = re.compile(rf"\s*\[+\s*{full}\s*[\].]")
        assignment = re.compile(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=")
        first = self._first_line + 1
        own = True
        for number, text in enumerate(self._lines[self._first_line :], first):
            own = own and (not _HEADER.match(text) or (bool(self.name) and number == first))
            if header.match(text) or (own and assignment.match(text)):
                return number
        return first if self.name else None

    def number(
        self,
        key: str,
        default: Any = _REQUIRED,
        *,
        low: float = -math.inf,
        high: float = math.inf,
        unit: str = "",
        infinite: bool = False,
    ) -> float:
        """A number in [low, high], finite unless `infinite` means that there is no limit.

        `unit` is for the error's sentence only.
        """
        value = self._get(key, default)
        if value is default and default is not _REQUIRED:
            return value
        number = as_number(value)
        if math.isnan(number):
            raise self.fail(key, f"is {value!r}", f"give a number{_in(unit)}")
        if not low <= number <= high:
            raise self.fail(key, f"is {number:g}{_unit(unit)}", _range(low, high, unit))
        if math.isinf(number) and not infinite:
            raise self.fail(key, f"is {number:g}{_unit(unit)}", f"give a finite number{_in(unit)}")
        return number

    def whole(
        self,
        key: str,
        default: Any = _REQUIRED,
        *,
        low: float = -math.inf,
        high: float = math.inf,
    ) -> int:
        """An integer in [low, high], to its last digit; 2e3 is one, too."""
        value = self.number(key, default, low=low, high=high)
        if value is default and default is not _REQUIRED:
            return default
        if not value.is_integer():
            raise self.fail(key, f"is {value:g}", "give a whole number")
        return int(self._get(key, default))

    def numbers(
        self,
        key: str,
        size: int | None,
        default: Any = _REQUIRED,
        *,
        low: float = -math.inf,
        high: float = math.inf,
        unit: str = "",
    ) -> NDArray[np.float64]:
        """A list of `size` finite numbers (any length when None); one number stands for all."""
        value = self._get(key, default)
        if value is default and default is not _REQUIRED:
            return value
        if size is not None and not math.isnan(as_number(value)):
            value = [value] * size
        entries = cast(list[object], value) if isinstance(value, list) else []
        numeric = bool(entries) and all(math.isfinite(as_number(x)) for x in entries)
        if not numeric or (size is not None and len(entries) != size):
            count = {None: "a list of numbers", 1: "a number"}.get(size, f"{size} numbers")
            raise self.fail(key, f"is {value!r}", f"give {count}{_in(unit)}")
        array = np.array(entries, dtype=np.float64)
        outside = array[(array < low) | (array > high)]
        if outside.size:
            raise self.fail(key, f"holds {outside[0]:g}{_unit(unit)}", _range(low, high, unit))
        return array

    def text(self, key: str, default: Any = _REQUIRED, *, among: Sequence[str] = ()) -> str:
        """A string, one of `among` where that is given."""
        value = self._get(key, default)
        if value is default and default is not _REQUIRED:
            return value
        if not isinstance(value, str):
            raise self.fail(key, f"is {value!r}", "give a text in quotes")
        if among and value not in among:
            raise self.fail(key, f"is {value!r}", "use one of " + ", ".join(map(repr, among)))
        return value

    def texts(self, key: str, default: Any = _REQUIRED) -> tuple[str, ...]:
        """A list of strings."""
        value = self._get(key, default)
        if value is default and default is not _REQUIRED:
            return value
        if not isinstance(value, list) or not all(
            isinstance(x, str) for x in cast(list[object], value)
        ):
            raise self.fail(key, f"is {value!r}", "give a list of texts in quotes")
        return tuple(cast(list[str], value))

    def table(self, key: str, *, required: bool = True) -> "Table":
        """The table [key]; an empty one when it is absent and not required."""
        if self._below is not None:
            below = self._below.table(key, required=required and key not in self._data)
            return self._layer_table(key).over(below) if key in self._data else below
        value = self._get(key, _REQUIRED if required else {})
        if not isinstance(value, dict):
            raise self.fail(key, f"is {value!r}", f"make it a table: [{self._child(key)}]")
        return self._table(key, cast(dict[str, Any], value), occurrence=0)

    def _layer_table(self, key: str) -> "Table":
        alone = copy.copy(self)
        alone._below = None
        return alone.table(key)

    def tables(self, key: str) -> "list[Table]":
        """The array of tables [[key]]; empty when absent."""
        if self._below is not None:
            rows = self._below.tables(key)
            return [self._layer_table(key).over(row) for row in rows] if key in self._data else rows
        value = self._get(key, [])
        if not isinstance(value, list) or not all(
            isinstance(x, dict) for x in cast(list[object], value)
        ):
            raise self.fail(key, f"is {value!r}", f"make it tables: [[{self._child(key)}]]")
        rows = cast(list[dict[str, Any]], value)
        return [self._table(key, row, occurrence=i) for i, row in enumerate(rows)]

    def raw(self, key: str, default: Any = None) -> Any:
        """The value as TOML gives it, for free-form notes."""
        return self._get(key, default)

    def close(self) -> None:
        """Raise on the first key nobody asked for."""
        if self._below is not None:
            self._below.close()
        for key in self._data:
            if key not in self._asked:
                hint = UnknownName("key", key, self._asked).hint
                raise self.fail(key, "is no key we know", f"{hint}, or remove it")

    def _get(self, key: str, default: Any) -> Any:
        self._asked.add(key)
        if key in self._data:
            if self._below is not None:
                self._below._asked.add(key)
            return self._data[key]
        if self._below is not None:
            return self._below._get(key, default)
        if default is _REQUIRED:
            unknown = [other for other in self._data if other not in self._asked]
            for close in difflib.get_close_matches(key, unknown, n=1, cutoff=0.8):
                raise self.fail(close, "is no key we know", f"is it meant to be {key!r}?")
            raise self.fail(key, "is missing", "add it")
        return default

    def _child(self, key: str) -> str:
        return f"{self.name}.{key}" if self.name else key

    def _table(self, key: str, data: dict[str, Any], occurrence: int) -> "Table":
        name = self._child(key)
        header = re.compile(rf"\s*\[+\s*{re.escape(name)}\s*\]")
        result = [i for i, text in enumerate(self._lines, 1) if header.match(text)]
        first = result[occurrence] if occurrence < len(result) else self.line(key) or 0
        return Table(self.path, data, self._lines, name, max(first - 1, 0), self._error)


def read_toml(path: Path, error: type[FileError] = FileError) -> Table:
    """Read a TOML file.

    Raises:
        FileError (or the given subclass): the file is missing, too large, not UTF-8, or no TOML.
    """
    try:
        if path.exists() and not path.is_file():
            # to read a pipe is to wait for whoever writes into it
            what = "a folder" if path.is_dir() else "no regular file"
            raise error(path, f"is {what}", "name a TOML file")
        with path.open("rb") as file:
            content = file.read(LARGEST + 1)
        if len(content) > LARGEST:
            raise error(path, "holds more than 1 MiB, so it is no settings", "check the path")
        text = content.decode("utf-8-sig")  # editors of Windows begin with a mark
    except FileNotFoundError:
        raise error(path, "there is no such file", "check the path") from None
    except OSError as problem:
        raise error(path, f"cannot be read ({problem.strerror})", "check the path") from None
    except UnicodeDecodeError:
        raise error(path, "is not UTF-8 text", "save it as UTF-8") from None
    if long := _DOTTED.search(text):
        line = text.count("\n", 0, long.start()) + 1
        raise error(path, f"has a key of more than {_PARTS} parts", "shorten it", line=line)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        line = re.search(r"at line (\d+)", str(problem))
        raise error(
            path, str(problem), "mend the TOML", line=int(line[1]) if line else None
        ) from None
    except (ValueError, RecursionError):
        raise error(
            path,
            "holds a number of thousands of digits, or brackets within brackets without end",
            "mend the TOML",
        ) from None
    return Table(path, data, text.splitlines(), error=error)


def as_number(value: object) -> float:
    """A value of TOML; NaN of what is no number, infinite where a float cannot hold it."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""


def _in(unit: str) -> str:
    return f" in {unit}" if unit else ""


def _range(low: float, high: float, unit: str) -> str:
    if math.isinf(high):
        return f"it must be at least {low:g}{_unit(unit)}"
    if math.isinf(low):
        return f"it must be at most {high:g}{_unit(unit)}"
    return f"it must lie between {low:g} and {high:g}{_unit(unit)}"
