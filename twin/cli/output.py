"""What verbs share: the options for a part of a log, JSON, a line of progress."""

import logging
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Any, TextIO, cast

import tyro

from twin.stop import check
from twin.units import span

if TYPE_CHECKING:
    from twin.recording import Recording


def print_json(document: object) -> None:
    """Print `document` on stdout; arrays become lists, and what is no finite number null."""
    from twin.shown import as_json

    global _printed
    _printed = True
    print(as_json(document))


_printed = False


def print_json_of_error(sentence: str, status: int) -> None:
    """Print a document that says why there is no other; nothing where one was printed."""
    if not _printed:
        print_json({"error": sentence, "status": status})


def begin_output() -> None:
    """A command line begins: nothing was printed yet."""
    global _printed
    _printed = False


_CONTROL = {
    code: f"\\x{code:02x}"
    for code in (*range(0x20), 0x7F, *range(0x80, 0xA0))
    if chr(code) not in "\n\t"
}


def printable(text: str) -> str:
    """Text without what moves a terminal's cursor, or writes into its clipboard.

    Titles, notes and names come from files that somebody may have shared.
    """
    return text.translate(_CONTROL)


class PlainStream:
    """A stream that passes only printable text on."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        """For what we draw with ourselves."""

    def write(self, text: str) -> int:
        """All of it; the number of its characters."""
        self.stream.write(printable(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def plain_streams() -> Generator[None]:
    """In this block stdout and stderr pass only printable text on."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (cast(TextIO, PlainStream(stream)) for stream in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def terminal(stream: TextIO) -> TextIO:
    """The stream itself, for one who draws on it and whose texts are printable."""
    return stream.stream if isinstance(stream, PlainStream) else stream


def tell(line: str) -> None:
    """Print a line of progress on stderr, above the one that `progress` keeps."""
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=terminal(sys.stderr))
    print(line, file=sys.stderr, flush=True)


def print_written(*paths: Path | None, json: bool) -> None:
    """Print the name of each file or folder that a verb wrote, on stderr beside JSON."""
    for path in filter(None, paths):
        print(f"wrote {path}", file=sys.stderr if json else sys.stdout)


@contextmanager
def progress() -> Generator[Callable[[str], None]]:
    """A function that says what is being done, on one line of a terminal's stderr; else silent.

    The line has what the package logs at level INFO too, such as the steps of a fit and the time
    left, and the time since the start. The function raises `Stopped` where a stop was requested.
    """
    if not sys.stderr.isatty():
        yield lambda doing: check()
        return
    line = _Line()
    logger = logging.getLogger("twin")
    level = logger.level
    logger.addHandler(line)
    logger.setLevel(min(logger.getEffectiveLevel(), logging.INFO))

    def say(doing: str) -> None:
        check()
        line.begin(doing)

    try:
        yield say
    finally:
        logger.removeHandler(line)
        logger.setLevel(level)
        print("\r\x1b[K", end="", file=terminal(sys.stderr), flush=True)


class _Line(logging.Handler):
    """One line of a terminal that is written over and over."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._began, self._doing = time.monotonic(), ""

    def begin(self, doing: str) -> None:
        """Something else is being done."""
        self._doing = doing
        self._write(doing)

    def emit(self, record: logging.LogRecord) -> None:
        """A record of the package; warnings are left to those who print them."""
        if record.levelno < logging.WARNING:
            self._write(": ".join(filter(None, (self._doing, record.getMessage()))))

    def _write(self, words: str) -> None:
        seconds = time.monotonic() - self._began
        since = f" ({span(seconds)} so far)" if seconds > AFTER else ""
        width = get_terminal_size().columns - len(since) - 5
        words = printable(words)
        cut = words if len(words) <= width else f"{words[: max(width - 1, 0)]}…"
        print(f"\r\x1b[K{cut} ...{since}", end="", file=terminal(sys.stderr), flush=True)


AFTER = 5.0
"""From which on a person is told how long it has taken [s]."""


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

TrustedFolders = Annotated[tuple[Path, ...], tyro.conf.arg(metavar="DIR ...")]
"""The type of a verb's --trust."""
