"""A file or folder that is there whole or not at all, whenever its writer is stopped or killed."""

import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

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
