"""A file that is there whole or not at all, whenever its writer is killed or the power goes."""

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def whole(path: Path) -> Generator[BinaryIO]:
    """A file to write; it takes its name, and any older one's place, when the block ends well.

    Until then it is a hidden one beside it, with this process's number in its name.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with part.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def write_whole(path: Path, text: str) -> None:
    """Write text as UTF-8."""
    with whole(path) as file:
        file.write(text.encode("utf-8"))
