"""Arrays by dotted names as columns: what MATLAB, HDF5, LabVIEW and PX4 write.

`imu.gyr` is the field of a struct or the data set of a group; of a matrix, each row is a sample and
`imu.gyr.1` is the first column. Names are looked up in the variable that log.toml names, then in
the whole file, so that a vector of times may stand beside the matrix that it belongs to.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError, UnknownName
from twin.recording.formats.number_file import NumberFile

Array = NDArray[np.float64]

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

    def fault(self, problem: str, remedy: str, row: int | None = None) -> LogError:
        where = "" if row is None else f" (row {row + 1})"
        return LogError(self.path, problem + where, remedy)

    def find(self, name: str) -> str:
        """A column's full name, looked up in the variable first, then in the file."""
        for full in (f"{self._prefix}{name}", name):
            if full in self._columns:
                return full
        problem = str(UnknownName("column", name, {*self.header, *self._columns}))
        raise self.fault(problem, "name one of its columns")


def _columns(arrays: Mapping[str, Numbers]) -> Iterator[tuple[str, tuple[str, int | None]]]:
    """Name of a column -> its array, and which of that it is."""
    for name, array in arrays.items():
        if len(array.shape) == 1 or 1 in array.shape:
            yield name, (name, None)
        elif not _lies(array):
            for index in range(array.shape[1]):
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
            one = objects[0]
            remedy = (
                f"save its parts in MATLAB: s.time = {one}.Time (of a timetable seconds of it), "
                f"s.data = {one}.Data (of a timetable {one}.Variables), "
                "save('log.mat', '-struct', 's')"
            )
        return f"holds no numeric variable{f' ({listed})' if listed else ''}", remedy
    if name in others:
        return f"variable {name!r} is {others[name]}", remedy
    inside = [f"{key} is {kind}" for key, kind in others.items() if key.startswith(f"{name}.")]
    if inside:
        return f"variable {name!r} holds no numbers ({', '.join(inside)})", remedy
    return f"has no variable {name!r}", remedy
