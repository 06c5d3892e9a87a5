"""An HDF5 file, or a MAT file of version 7.3, with h5py: data sets by the path of their groups."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.formats.array_file import (
    Numbers,
    Variables,
    check_unpacked,
    imported,
    library_errors,
)

MOST_NAMES = 10_000
"""Data sets and groups that are looked at."""
DEEPEST = 32
"""Levels of groups: a link to a group above would go on for ever."""

_AS = "HDF5", "save it again"


@dataclass(frozen=True)
class _DataSet:
    """A data set, or a field of its rows, read when it is asked for."""

    path: Path
    name: str
    shape: tuple[int, ...]
    turned: bool
    """Whether MATLAB wrote it: its rows are HDF5's columns."""
    field: str | None = None
    column: int | None = None
    """Of a block of columns that a table is kept in."""

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[np.generic]:
        h5py = imported("h5py", self.path)
        with library_errors(self.path, *_AS), h5py.File(self.path, "r") as file:
            values = file[self.name][()]
        if self.field is not None:
            values = values[self.field]
        if self.column is not None:
            values = values[:, self.column]
        values = values.T if self.turned else values
        return np.asarray(values, dtype=dtype)


def read_hdf5(path: Path) -> Variables:
    """The data sets of a file; no number is read yet.

    Raises:
        LogError: it is no HDF5 file, is damaged, or h5py is not installed.
    """
    h5py = imported("h5py", path)
    arrays: dict[str, Numbers] = {}
    others: dict[str, str] = {}
    units: dict[str, str] = {}
    with library_errors(path, *_AS), h5py.File(path, "r") as file:
        _walk(h5py, path, file, (arrays, others, units), 0)
    return Variables(arrays, others, units=units, save="turn it before it is saved, a sample a row")


def _walk(
    h5py: Any,
    path: Path,
    group: Any,
    into: tuple[dict[str, Numbers], dict[str, str], dict[str, str]],
    depth: int,
) -> None:
    arrays, others, _ = into
    for key in group:
        name = f"{group.name}/{key}".replace("//", "/")
        dotted = name.strip("/").replace("/", ".")
        if len(arrays) + len(others) > MOST_NAMES:
            raise LogError(path, f"holds more than {MOST_NAMES} data sets", "save those of the log")
        if not isinstance(group.get(key, getlink=True), h5py.HardLink):
            others[dotted] = "a link"  # which may lead out of the file
        elif isinstance(item := group[key], h5py.Group):
            if item.attrs.get("pandas_type") in (b"frame", "frame") and "block0_items" in item:
                _frame(path, item, arrays)
            # MATLAB's own groups, `#refs#`, keep what cells refer to
            elif not key.startswith("#") and depth < DEEPEST:
                _walk(h5py, path, item, into, depth + 1)
        elif isinstance(item, h5py.Dataset):
            _sort(path, name, dotted, item, into)


def _frame(path: Path, group: Any, arrays: dict[str, Numbers]) -> None:
    """A table that pandas wrote with `to_hdf`: its index, and its columns of numbers by name."""
    prefix = group.name.strip("/").replace("/", ".")
    index = group["axis1"]
    if index.dtype.kind in "iuf":
        name = _decoded(index.attrs.get("name", b"")) or "index"
        arrays[f"{prefix}.{name}"] = _DataSet(path, index.name, index.shape, turned=False)
    for key in group:
        if key.endswith("_values") and key.replace("_values", "_items") in group:
            block = group[key]
            names = [_decoded(item) for item in group[key.replace("_values", "_items")][()]]
            if block.dtype.kind not in "biuf" or block.shape != (index.shape[0], len(names)):
                continue
            check_unpacked(path, block.nbytes)
            for place, name in enumerate(names):
                arrays[f"{prefix}.{name}"] = _DataSet(
                    path, block.name, index.shape, turned=False, column=place
                )


def _decoded(text: Any) -> str:
    return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)


def _sort(
    path: Path,
    name: str,
    dotted: str,
    item: Any,
    into: tuple[dict[str, Numbers], dict[str, str], dict[str, str]],
) -> None:
    arrays, others, units = into
    kind = item.attrs.get("MATLAB_class", b"")
    matlab = kind.decode() if isinstance(kind, bytes) else str(kind)
    check_unpacked(path, item.nbytes)
    if item.external or item.is_virtual:
        others[dotted] = "kept in another file"
    elif item.dtype.names is not None and item.ndim == 1:
        for part in item.dtype.names:
            if item.dtype[part].kind in "biuf":
                arrays[f"{dotted}.{part}"] = _DataSet(path, name, item.shape, False, part)
    elif matlab in ("char", "cell") or item.dtype.kind not in "biuf":
        others[dotted] = {"char": "text", "cell": "a cell array"}.get(matlab, f"{item.dtype}")
    elif item.ndim not in (1, 2) or not item.size or item.attrs.get("MATLAB_empty"):
        others[dotted] = f"an array of {item.ndim} dimensions" if item.size else "empty"
    else:
        shape = item.shape[::-1] if matlab else item.shape
        arrays[dotted] = _DataSet(path, name, shape, bool(matlab))
        unit = next(
            (item.attrs[key] for key in ("units", "unit", "Units") if key in item.attrs), ""
        )
        text = unit.decode() if isinstance(unit, bytes) else str(unit)
        units |= {dotted: text} if text else {}
