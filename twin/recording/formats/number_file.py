"""What every format gives: named columns of numbers, and an error that knows the row."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError, UnknownName

Array = NDArray[np.float64]


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

    @abstractmethod
    def numbers(self, names: Sequence[str]) -> Array:
        """The named columns, shape (rows, len(names)); NaN where the file has nothing.

        An array that the caller may write into, or a read-only one.

        Raises:
            LogError: a name that is no column, or what is there are no numbers.
        """

    @abstractmethod
    def fault(self, problem: str, remedy: str, row: int | None = None) -> LogError:
        """The error about a row (from 0), or about the file."""

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
