"""What verbs share: the options for a part of a log, JSON, a line of progress."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.stop import check

if TYPE_CHECKING:
    from twin.recording import Recording


def print_json(document: object) -> None:
    """Print `document` on stdout; arrays become lists, and what is no finite number null."""
    from twin.shown import as_json

    print(as_json(document))


def tell(line: str) -> None:
    """Print a line of progress on stderr."""
    print(line, file=sys.stderr, flush=True)


@contextmanager
def progress() -> Generator[Callable[[str], None]]:
    """A function that says what is being done, on one line of a terminal's stderr; else silent.

    It raises `Stopped` where a stop was requested.
    """
    waits = sys.stderr.isatty()

    def say(doing: str) -> None:
        check()
        if waits:
            print(f"\r\x1b[K{doing} ...", end="", file=sys.stderr, flush=True)

    try:
        yield say
    finally:
        if waits:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


@dataclass(frozen=True)
class LogPart:
    """Which rows of each log are read."""

    start: Annotated[float | None, tyro.conf.arg(metavar="S")] = None
    """Leave out earlier rows; in the time of the log as `twin show` prints it."""
    stop: Annotated[float | None, tyro.conf.arg(metavar="S")] = None
    """Leave out later rows."""
    rate: Annotated[float | None, tyro.conf.arg(metavar="HZ")] = None
    """Of faster measured streams take every second, third ... row only."""

    def open(self, path: Path) -> "Recording":
        """A log, or the part of it; a person who waits for it sees how far it is read."""
        from twin.errors import UsageError
        from twin.recording import open_log, restricted

        for name, value in (("start", self.start), ("stop", self.stop), ("rate", self.rate)):
            if value is not None and not abs(value) < float("inf"):
                raise UsageError(f"--{name} is {value:g}; give a finite number")
        if self.rate is not None and self.rate <= 0.0:
            raise UsageError(f"--rate is {self.rate:g} Hz; it must be above 0")
        with progress() as say:
            recording = open_log(path, say, start=self.start, stop=self.stop)
        return restricted(recording, start=None, stop=None, rate=self.rate)


Restricted = Annotated[LogPart, tyro.conf.arg(name="")]
"""The type of a verb's field whose arguments these are."""
