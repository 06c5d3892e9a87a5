"""A log folder with tables in it, and the sentence that reading it ends with."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from twin.errors import LogError
from twin.recording import read_log


@pytest.fixture
def folder_with() -> Callable[..., Path]:
    """Write a log.toml and CSV files, by name, into a folder."""

    def write(folder: Path, toml: str, **files: str | bytes) -> Path:
        (folder / "log.toml").write_text('platform = "sads"\n' + toml)
        for name, content in files.items():
            data = content if isinstance(content, bytes) else content.encode()
            (folder / f"{name}.csv").write_bytes(data)
        return folder

    return write


@pytest.fixture
def complaint() -> Callable[[Path], str]:
    """The error that a folder is refused with, its paths from the folder on."""

    def read(folder: Path) -> str:
        with pytest.raises(LogError) as error:
            read_log(folder)
        return str(error.value).replace(f"{folder}{os.sep}", "")

    return read
