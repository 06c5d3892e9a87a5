"""One pass over a file for all the streams in it: the tables they ask for, and how far it is.

A file that does not fit into the memory is read once, from its beginning to its end. Each stream
says beforehand which columns it will ask for; the pass appends their numbers, eight bytes each, to
one table a request, and keeps nothing else of the file.
"""

import time
from array import array
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
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


class Progress:
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
    """Take the words of a `Progress` that nobody reads."""
    del words


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
