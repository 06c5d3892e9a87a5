"""What verbs share: the options for a part of a log, JSON, a line of progress."""

import os
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.errors import UsageError
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


def check_writable(
    path: Path, ending: str, *, anew: bool = True, read: Sequence[Path] = ()
) -> None:
    """Whether a file can be written there, asked before the work and not after it.

    Args:
        path: of the file.
        ending: that its name must have, so that a word too many on a command line is no file.
        anew: whether one that exists may be written over; a session's log cannot be made again.
        read: what the work is about to read, which is not written over either.

    Raises:
        UsageError: it cannot.
    """
    if path.is_dir():
        raise UsageError(f"{path} is a folder; name a file in it, as in {path / f'out{ending}'}")
    if path.suffix.lower() != ending:
        raise UsageError(
            f"{path} does not end in {ending}, as what is written there does; "
            f"say {path.with_suffix(ending)}"
        )
    above = next(part for part in path.absolute().parents if part.exists())
    if not above.is_dir():
        raise UsageError(f"{path} cannot be written: {above} is a file")
    if path.exists():
        if not anew:
            raise UsageError(
                f"{path} exists, and may be a session that cannot be flown again; "
                "name another file, or move that one away"
            )
        if path.resolve() in [item.resolve() for item in read]:
            raise UsageError(f"{path} is the log that is read; name another file")
        if not os.access(path, os.W_OK):
            raise UsageError(f"{path} exists, and you may not write to it; name another file")
    elif not os.access(above, os.W_OK | os.X_OK):
        raise UsageError(
            f"{path} cannot be written: you may not write into {above}; name another place"
        )


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
    """Leave out what was before, in the log's own time as `twin show` prints it."""
    stop: Annotated[float | None, tyro.conf.arg(metavar="S")] = None
    """Leave out what was after."""
    rate: Annotated[float | None, tyro.conf.arg(metavar="HZ")] = None
    """Of measured streams that are faster take every second, third ... row only."""

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
            recording = open_log(path, say)
        return restricted(recording, start=self.start, stop=self.stop, rate=self.rate)


Restricted = Annotated[LogPart, tyro.conf.arg(name="")]
"""The type of a verb's field whose arguments these are."""
