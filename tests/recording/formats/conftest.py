"""A log folder round one file, and the sentence that reading it ends with."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from twin.errors import LogError
from twin.recording import Recording, read_log


@pytest.fixture
def log_of(tmp_path: Path) -> Callable[[str], Recording]:
    """Read the folder with these streams in its log.toml."""

    def read(streams: str) -> Recording:
        (tmp_path / "log.toml").write_text('platform = "sads"\n' + streams)
        return read_log(tmp_path)

    return read


@pytest.fixture
def complaint(log_of, tmp_path: Path) -> Callable[[str], str]:
    """The error's text, with paths from the folder on."""

    def read(streams: str) -> str:
        with pytest.raises(LogError) as error:
            log_of(streams)
        return str(error.value).replace(f"{tmp_path}{os.sep}", "")

    return read
