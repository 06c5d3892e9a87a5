"""Libraries that read other programs' files: an extra, each imported where such a file is read."""

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
