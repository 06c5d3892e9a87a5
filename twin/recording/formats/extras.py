"""What reading other programs' files needs: their libraries, an extra, each imported where such a
file is read; what they raise, as our error; and a limit on what a small file may unpack to."""

from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from twin.errors import LogError


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
