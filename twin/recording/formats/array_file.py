"""Columns of numbers from other programs' files: the interface of a format, and its limits.

Arrays by dotted names as columns: what MATLAB, HDF5, LabVIEW and PX4 write.
`imu.gyr` is the field of a struct or the data set of a group; of a matrix, each row is a sample and
`imu.gyr.1` is the first column. Names are looked up in the variable that log.toml names, then in
the whole file, so that a vector of times may stand beside the matrix that it belongs to.

One pass over a file for all the streams in it: the tables they ask for, and how far it is.
A file that does not fit into the memory is read once, from its beginning to its end. Each stream
says beforehand which columns it will ask for; the pass appends their numbers, eight bytes each, to
one table a request, and keeps nothing else of the file.
"""

import time
from abc import ABC, abstractmethod
from array import array
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError, UnknownName

Array = NDArray[np.float64]


def imported(module: str, path: Path) -> Any:
    """A module of a library that may be missing.

    Raises:
        LogError: it is not installed; about the file that needs it, with the command that does.
    """
    try:
        return import_module(module)
    except ImportError:
        raise LogError(
            path,
            f"needs the library {module.split('.', 1)[0]}, which is not installed",
            "pip install 'airbearing-twin[formats]'",
        ) from None


@contextmanager
def library_errors(path: Path, kind: str, remedy: str) -> Generator[None]:
    """What a library raises in this block, on damaged bytes whatever its parts raise, as our error.

    Args:
        path: of the file.
        kind: of file, as what it is read.
        remedy: what would do.

    Raises:
        LogError: the library raised anything.
    """
    try:
        yield
    except LogError:
        raise
    except Exception as problem:
        text = str(problem).split("\n", 1)[0] or type(problem).__name__
        raise LogError(path, f"cannot be read as {kind} ({text})", remedy) from None


def damage(path: Path) -> tuple[str, ...]:
    """The repair of a file of which a library has read what it could."""
    return (f"{path.name} was cut short or is damaged; what could be decoded is here",)


UNPACKED = 200
"""Times its own size that a file may unpack to: numbers of sensors shrink by ten at most."""
SMALL = 64 << 20
"""What any file may unpack to [bytes]."""


def check_unpacked(path: Path, size: int) -> None:
    """Refuse a file that would fill the memory.

    Args:
        path: of the file.
        size: what it says that it unpacks to [bytes].

    Raises:
        LogError: far more than such a file can hold.
    """
    if size > SMALL and size > UNPACKED * path.stat().st_size:
        times = size // max(path.stat().st_size, 1)
        raise LogError(
            path,
            f"would unpack to {size >> 20} MiB, {times} times its size",
            "save the log's numbers again",
        )


def filled_in(numbers: Array) -> NDArray[np.uint8]:
    """Of each row (m, k): 0 nothing, 1 zeros, 2 another number."""
    finite = np.isfinite(numbers).any(axis=1).astype(np.uint8)
    return finite + (finite & (np.nan_to_num(numbers) != 0.0).any(axis=1))


class NumberFile(ABC):
    """A file, or the part of one that log.toml names, as columns of numbers."""

    by_name = False
    """Whether a quaternion's parts have names, so that they come as w, x, y, z by themselves."""

    def __init__(self, path: Path, header: Sequence[str], clocks: Sequence[str] = ()) -> None:
        self.path = path
        self.header = tuple(header)
        """Names of the columns, in order."""
        self.clocks = tuple(clocks)
        """Those that hold times in seconds by their type, whatever `time_unit` says."""
        self.units: Mapping[str, str] = {}
        """Texts of the units that the file states beside its columns' names."""
        self.repeated: tuple[str, ...] = ()
        """Names that several columns have in the file; `header` numbers those."""
        self.numbered = False
        """Whether the file names no columns, and `header` counts them from 1."""
        self.repairs: tuple[str, ...] = ()
        """A sentence for each thing that was mended on reading the file."""
        self.offset = 0
        """The row of the file that `numbers` begins with."""

    @property
    def time(self) -> str:
        """The column of times, where log.toml names none: the first."""
        return self.header[0]

    @property
    def values(self) -> tuple[str, ...]:
        """The columns of values, where log.toml names none (the time may be among them)."""
        return tuple(name for name in self.header if name not in self.clocks)

    def expect(self, names: Sequence[str]) -> None:  # noqa: B027  (arrays are read one by one)
        """Say that `numbers` will be asked for these columns: one pass then reads all of them."""

    def filled(self, names: Sequence[str]) -> NDArray[np.uint8]:
        """What each row has in these columns (rows,): 0 nothing, 1 zeros, 2 another number."""
        return filled_in(self.numbers(names))

    def expect_filled(self, names: Sequence[str]) -> None:  # noqa: B027
        """Say that `filled` will be asked for these columns."""

    def only(self, first: int, last: int) -> None:  # noqa: B027  (arrays are in the memory whole)
        """Say that of what `numbers` is asked for from now on, these rows will do; a pass over a
        file leaves out the others, and `offset` is then the first that it gives."""

    @abstractmethod
    def numbers(self, names: Sequence[str]) -> Array:
        """The named columns, shape (rows, len(names)); NaN where the file has nothing.

        An array that the caller may write into, or a read-only one.

        Raises:
            LogError: a name that is no column, or what is there are no numbers.
        """

    def fault(self, problem: str, remedy: str, row: int | None = None) -> LogError:
        """The error about a row (from 0), or about the file."""
        where = "" if row is None else f" (row {row + 1})"
        return LogError(self.path, problem + where, remedy)

    def beginning(self) -> "NumberFile":
        """The same file as far as a look at it needs."""
        return self

    def not_finite(self, row: int, name: str, value: float) -> LogError:
        """The error about one number that is none."""
        return self.fault(
            f"column {name!r} holds {'nothing' if np.isnan(value) else value}, "
            "which is no finite number",
            "write the number, or delete the row",
            row,
        )

    def find(self, name: str) -> str:
        """A column's name as the header has it.

        Raises:
            LogError: there is no such column.
        """
        if name not in self.header:
            problem = str(UnknownName("column", name, self.header))
            raise self.fault(problem, "name one of its columns")
        return name


WIDEST = 100
"""A matrix with more columns than this, and fewer rows, lies on its side."""
LISTED = 8
"""Variables that an error names."""
LARGEST = 1 << 28
"""Numbers of an array that is read; a larger one is no log on this computer."""


class Numbers(Protocol):
    """An array of one or two dimensions, in memory or not yet."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __array__(self) -> NDArray[np.generic]: ...


@dataclass(frozen=True)
class Variables:
    """What a file of arrays holds."""

    arrays: Mapping[str, Numbers]
    """Those of numbers, by dotted name."""
    others: Mapping[str, str]
    """What the other variables are."""
    clocks: Sequence[str] = ()
    """Names of those that are times in seconds by their type, in the order in which they count."""
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    """Texts of the units that the file states."""
    save: str = ""
    """What turns a matrix that lies on its side, to be filled with its name."""
    repairs: tuple[str, ...] = ()
    """A sentence for each thing that was mended on reading the file."""


class ArrayFile(NumberFile):
    """One variable of a file of arrays, or all of them, as columns."""

    def __init__(self, path: Path, variables: Variables, variable: str | None) -> None:
        """Look for the variable among those of the file.

        Raises:
            LogError: there is none of that name, or it is not numeric; lists those that are.
        """
        arrays = variables.arrays
        own = [key for key in arrays if key not in variables.clocks]
        name = own[0] if variable is None and len(own) == 1 else variable
        self._prefix = "" if name is None else f"{name}."
        self._arrays = arrays
        self._columns = dict(_columns(arrays))
        inside = [column for column in self._columns if f"{column}.".startswith(self._prefix)]
        if not inside:
            raise LogError(path, *_refusal(name, variables))
        clocks = [clock for clock in variables.clocks if f"{clock}.".startswith(self._prefix)]
        inside = [*clocks, *(column for column in inside if column not in clocks)]
        names = [column.removeprefix(self._prefix) for column in inside]
        super().__init__(path, names, [clock.removeprefix(self._prefix) for clock in clocks])
        self.repairs = variables.repairs
        places = zip(names, (self._columns[column][0] for column in inside), strict=True)
        self.units = {name: variables.units.get(array, "") for name, array in places}

    def numbers(self, names: Sequence[str]) -> Array:
        read: dict[str, Array] = {}
        columns: list[Array] = []
        for name in names:
            array, index = self._columns[self.find(name)]
            if array not in read:
                read[array] = self._read(array)
            columns.append(read[array].ravel() if index is None else read[array][:, index])
        for name, column in zip(names, columns, strict=True):
            if len(column) != len(columns[0]):
                raise self.fault(
                    f"has {len(columns[0])} samples in {names[0]!r} and {len(column)} in {name!r}",
                    "name `columns` of one length, or the right `time`",
                )
        return np.stack(columns, axis=-1)

    def _read(self, name: str) -> Array:
        array = self._arrays[name]
        size = int(np.prod(array.shape, dtype=np.float64))
        if size > LARGEST:
            raise self.fault(f"has {size} numbers in {name!r}", "save the part that is the log")
        with np.errstate(invalid="ignore"):  # damaged bytes make floats that NumPy warns of
            return np.asarray(array, dtype=np.float64)

    def find(self, name: str) -> str:
        """A column's full name, looked up in the variable first, then in the file."""
        for full in (f"{self._prefix}{name}", name):
            if full in self._columns:
                return full
        problem = str(UnknownName("column", name, {*self.header, *self._columns}))
        raise self.fault(problem, "name one of its columns")


def _columns(arrays: Mapping[str, Numbers]) -> Iterator[tuple[str, tuple[str, int | None]]]:
    """Name of a column -> its array, and which of that it is."""
    for name, values in arrays.items():
        if len(values.shape) == 1 or 1 in values.shape:
            yield name, (name, None)
        elif not _lies(values):
            for index in range(values.shape[1]):
                yield f"{name}.{index + 1}", (name, index)


def _lies(array: Numbers) -> bool:
    rows, columns = array.shape
    return 1 < rows < columns and columns > WIDEST


def _refusal(name: str | None, variables: Variables) -> tuple[str, str]:
    """What is wrong with the variable, and what would do."""
    arrays, others = variables.arrays, variables.others
    sizes = {key: " x ".join(map(str, array.shape)) for key, array in arrays.items()}
    if name is not None and name in arrays:
        turn = variables.save.replace("NAME", name) or "save it with a sample a row"
        return f"variable {name!r} is {sizes[name]}, a sample a column", turn
    remedy = "save numeric arrays in it"
    if arrays:
        listed = ", ".join(f"{key} ({size})" for key, size in sizes.items())
        remedy = f"name one of its numeric variables in `variable`: {listed}"
    if name is None:
        listed = ", ".join(f"{key} is {kind}" for key, kind in list(others.items())[:LISTED])
        objects = [key for key, kind in others.items() if kind.endswith("of MATLAB")]
        if objects:
            item = objects[0]
            remedy = (
                f"save its parts in MATLAB: s.time = {item}.Time (of a timetable seconds of it), "
                f"s.data = {item}.Data (of a timetable {item}.Variables), "
                "save('log.mat', '-struct', 's')"
            )
        return f"holds no numeric variable{f' ({listed})' if listed else ''}", remedy
    if name in others:
        return f"variable {name!r} is {others[name]}", remedy
    inside = [f"{key} is {kind}" for key, kind in others.items() if key.startswith(f"{name}.")]
    if inside:
        return f"variable {name!r} holds no numbers ({', '.join(inside)})", remedy
    return f"has no variable {name!r}", remedy


Names = tuple[str, ...]
Say = Callable[[str], None]

SOON = 2.0
"""A file that is read within this time needs no line of progress [s]."""
AGAIN = 0.5
"""Between two lines of progress [s]."""


class Tables:
    """Tables of some columns of one file, each filled once and handed to whom asked for it."""

    def __init__(self) -> None:
        self._asked = Counter[Names]()
        self._shared = set[Names]()
        self._filled: dict[Names, array[float]] = {}

    def expect(self, names: Sequence[str]) -> None:
        """Count one request for these columns, which `take` will hand out."""
        if names:
            self._asked[tuple(names)] += 1
        if self._asked[tuple(names)] > 1:
            self._shared.add(tuple(names))

    def missing(self) -> list[Names]:
        """Requests whose table the next pass has to fill."""
        return [names for names in self._asked if names not in self._filled]

    def fill(self, tables: dict[Names, "array[float]"]) -> None:
        """Keep what a pass has read, row after row."""
        self._filled |= tables

    def __contains__(self, names: Names) -> bool:
        return names in self._filled

    def take(self, names: Names) -> Array:
        """A filled table (rows, len(names)), read-only where several streams asked for it.

        The last request takes it out of the memory here.
        """
        self._asked[names] -= 1
        if self._asked[names] > 0:
            rows = self._filled[names]
        else:
            rows = self._filled.pop(names)
            del self._asked[names]
        # an empty array has no buffer that NumPy takes
        table = np.frombuffer(rows) if rows else np.empty(0)
        table.flags.writeable = names not in self._shared
        return table.reshape(-1, len(names))


class ReadProgress:
    """Says how far the reading of a file is, where that takes more than a moment."""

    def __init__(self, say: Say, path: Path) -> None:
        """Begin to count.

        Args:
            say: takes the words.
            path: the file, for the words.
        """
        self._say, self._path = say, path
        self._start = time.monotonic()
        self._next = self._start + SOON

    def at(self, done: float, total: float) -> None:
        """Called as often as convenient: `done` of `total` bytes, or messages, are read."""
        now = time.monotonic()
        if now < self._next or not 0.0 < done <= total:
            return
        self._next = now + AGAIN
        left = (now - self._start) * (total - done) / done
        self._say(f"reading {self._path.name}: {done / total:.0%}, {_duration(left)} left")


def silent(words: str) -> None:
    """Take the words of a `ReadProgress` that nobody reads."""
    del words


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
