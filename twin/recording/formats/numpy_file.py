"""A NumPy file: one array (`.npy`), or several by name (`.npz`); records by their fields."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.recording.formats.array_file import Numbers, Variables, check_unpacked, library_errors


def read_numpy(path: Path) -> Variables:
    """The arrays of a file; objects, which would run code when they are read, are not.

    Raises:
        LogError: it is no NumPy file, or is damaged.
    """
    arrays: dict[str, Numbers] = {}
    others: dict[str, str] = {}
    clocks: list[str] = []
    with library_errors(path, "a NumPy file", "save it again with numpy.savez"):
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as parts:
                check_unpacked(path, sum(part.file_size for part in parts.infolist()))
        with path.open("rb") as file:  # of one that is damaged NumPy would leave its own open
            loaded = np.load(file, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                _sort("", loaded, arrays, others, clocks)
            else:
                for name in loaded.files:
                    _read(name, loaded, arrays, others, clocks)
    return Variables(arrays, others, clocks, save="turn it: NAME = NAME.T")


def _read(
    name: str,
    loaded: Any,
    arrays: dict[str, Numbers],
    others: dict[str, str],
    clocks: list[str],
) -> None:
    try:
        value = loaded[name]
    except ValueError:  # pickled
        others[name] = "an object"
        return
    _sort(name, value, arrays, others, clocks)


def _sort(
    name: str,
    value: NDArray[Any],
    arrays: dict[str, Numbers],
    others: dict[str, str],
    clocks: list[str],
) -> None:
    if value.dtype.names is not None:
        for part in value.dtype.names:
            _sort(f"{name}.{part}".strip("."), value[part], arrays, others, clocks)
        return
    name = name or "values"
    if value.dtype.kind in "mM" and value.ndim == 1:
        arrays[name] = value.astype(f"{value.dtype.kind}8[ns]").astype(np.int64) * 1e-9
        clocks.append(name)
    elif value.dtype.kind not in "biuf":
        others[name] = "text" if value.dtype.kind in "US" else f"an array of {value.dtype}"
    elif value.ndim not in (1, 2) or not value.size:
        others[name] = f"an array of {value.ndim} dimensions" if value.size else "empty"
    else:
        arrays[name] = value
