"""Files that are written whole or not at all, and Python files that somebody brings.

A Python file that somebody brings: a control law, an effect.
It becomes a module of a private name that tells its path, so that other processes, to which
objects of its classes are sent, import the same file.
"""

import importlib
import logging
import os
import shutil
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import BinaryIO

from twin.errors import UsageError
from twin.stop import at_last


@contextmanager
def whole(path: Path) -> Generator[BinaryIO]:
    """A file to write; it takes its name, and any older one's place, when the block ends well.

    Until then it is a hidden one beside it, with this process's number in its name.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")

    def remove() -> None:
        part.unlink(missing_ok=True)

    with at_last(remove):
        try:
            with part.open("wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.replace(part, path)
        finally:
            remove()


@contextmanager
def whole_folder(folder: Path) -> Generator[Path]:
    """A folder to fill; it takes its name, where nothing or an empty folder is, when the block ends
    well. Until then it is a hidden one beside it, with this process's number in its name."""
    folder = folder.absolute()
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = folder.with_name(f".{folder.name}.{os.getpid()}")

    def remove() -> None:
        shutil.rmtree(part, ignore_errors=True)

    with at_last(remove):
        try:
            part.mkdir()
            yield part
            if folder.is_dir():
                folder.rmdir()
            part.rename(folder)
        finally:
            remove()


def write_whole(path: Path, text: str) -> None:
    """Write text as UTF-8."""
    with whole(path) as file:
        file.write(text.encode("utf-8"))


def check_writable(
    path: Path, ending: str, *, anew: bool = True, read: Sequence[Path] = ()
) -> None:
    """Check that a file can be written, before the work of which it is the result.

    Args:
        path: of the file.
        ending: which its name must have.
        anew: whether one that exists may be written over; a session cannot be flown again.
        read: files that the work reads, which are not written over either.

    Raises:
        UsageError: it cannot be written; the text says why.
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
    if not path.parent.exists():
        # it may be a slip of the keyboard
        said = "the folder %s does not exist: it is made for %s"
        logging.getLogger(__name__).warning(said, path.parent, path.name)


def check_folder(path: Path) -> None:
    """Whether files can be written into a folder, which is made if need be.

    Raises:
        UsageError: they cannot.
    """
    above = next(part for part in (path, *path.absolute().parents) if part.exists())
    if not above.is_dir():
        raise UsageError(f"{above} is a file; name a folder for the figures")
    if not os.access(above, os.W_OK | os.X_OK):
        raise UsageError(f"you may not write into {above}; name another folder for the figures")


_trusted: set[Path] = set()
"""Folders whose Python files may be run though only another file names them."""


def trust_folders(*folders: Path) -> None:
    """Let files that campaigns name be run from here on where they lie in these folders.

    Raises:
        UsageError: no such folder.
    """
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(f"--trust {folder}: there is no such folder; check the path")
        _trusted.add(folder.resolve())


def trusted_folders() -> tuple[Path, ...]:
    """Those folders."""
    return tuple(sorted(_trusted))


def is_trusted(path: Path) -> bool:
    """Whether a Python file may be run though nobody has named it on the command line."""
    return any(path.resolve().is_relative_to(folder) for folder in _trusted)


__path__: list[str] = []
"""Modules stand below this one; whoever asks for one of them imports this first."""
_ran: dict[str, bytes] = {}
"""What stood in the file of each module when it was run."""


class _ByPath(MetaPathFinder):
    """Finds the file of which a module's name tells."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        file = file_of(fullname)
        return None if file is None else spec_from_file_location(fullname, file)


sys.meta_path.append(_ByPath())


def file_of(module: str) -> Path | None:
    """The file that was run as the module of that name; None of a module of any other kind."""
    package, _, told = module.rpartition(".")
    return Path(os.fsdecode(bytes.fromhex(told))) if package == __name__ else None


def import_alone(path: Path) -> ModuleType:
    """Run a file that ends in .py as a module of a private name, so that it clashes with nobody's.

    It is run again only when it has changed: classes are hardly ever forgotten, and a campaign asks
    for its law with every shard. What the file raises passes through, and its module is forgotten
    then.
    """
    name = f"{__name__}.{os.fsencode(path.absolute()).hex()}"
    content = path.read_bytes()
    if name in sys.modules and _ran.get(name) == content:
        return sys.modules[name]
    sys.modules.pop(name, None)
    module = importlib.import_module(name)
    _ran[name] = content
    return module
