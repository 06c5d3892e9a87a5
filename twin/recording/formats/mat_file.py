"""A MATLAB file: numeric arrays and the numeric fields of structs, by dotted names.

`imu.gyr` is the field of a struct; of a matrix, each row is a sample and `imu.gyr.1` is the first
column. Names are looked up in the variable that log.toml names, then in the whole file, so that a
vector of times may stand beside the matrix that it belongs to.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError, UnknownName
from twin.recording.formats.number_file import NumberFile

Array = NDArray[np.float64]

Variables = tuple[dict[str, NDArray[Any]], dict[str, str]]
"""Numeric arrays by dotted name, and what the other variables are."""

WIDEST = 100
"""A matrix with more columns than this, and fewer rows, lies on its side."""


class MatFile(NumberFile):
    """One variable of a MAT file (format 4, 6 or 7), or all of them, as columns."""

    def __init__(self, path: Path, variables: Variables, variable: str | None) -> None:
        """Look for the variable among those of the file.

        Raises:
            LogError: there is none of that name, or it is not numeric; lists those that are.
        """
        arrays, others = variables
        name = next(iter(arrays)) if variable is None and len(arrays) == 1 else variable
        self._prefix = "" if name is None else f"{name}."
        self._columns = dict(_columns(arrays))
        inside = [column for column in self._columns if f"{column}.".startswith(self._prefix)]
        if not inside:
            raise LogError(path, *_refusal(name, arrays, others))
        super().__init__(path, [column.removeprefix(self._prefix) for column in inside])

    def numbers(self, names: Sequence[str]) -> Array:
        columns = [self._columns[self.find(name)] for name in names]
        for name, column in zip(names, columns, strict=True):
            if len(column) != len(columns[0]):
                raise self.fault(
                    f"has {len(columns[0])} samples in {names[0]!r} and {len(column)} in {name!r}",
                    "name `columns` of one length, or the right `time`",
                )
        return np.stack(columns, axis=-1)

    def fault(self, problem: str, remedy: str, row: int | None = None) -> LogError:
        where = "" if row is None else f" (row {row + 1})"
        return LogError(self.path, problem + where, remedy)

    def find(self, name: str) -> str:
        """A column's full name, looked up in the variable first, then in the file."""
        for full in (f"{self._prefix}{name}", name):
            if full in self._columns:
                return full
        problem = str(UnknownName("column", name, {*self.header, *self._columns}))
        raise self.fault(problem, "name one of its columns")


def read_variables(path: Path) -> Variables:
    """Read a file.

    Raises:
        LogError: it is no MAT file, is damaged, or of version 7.3.
    """
    from scipy.io import loadmat

    _check_kind(path)
    try:
        content: dict[str, Any] = loadmat(path)
    except Exception as problem:  # SciPy raises what its parts raise on damaged bytes
        raise LogError(
            path, f"cannot be read as a MAT file ({problem})", "save it again with -v7"
        ) from None
    arrays: dict[str, NDArray[Any]] = {}
    others: dict[str, str] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _sort(name, value, arrays, others)
    return arrays, others


def _check_kind(path: Path) -> None:
    try:
        with path.open("rb") as file:
            head = file.read(128)
    except OSError as problem:
        raise LogError(path, f"cannot be read ({problem.strerror})", "check the path") from None
    if head.startswith((b"\x89HDF", b"MATLAB 7.3")):
        raise LogError(
            path,
            "is a MAT file of version 7.3 (HDF5), which is not read",
            f"save it as -v7: s = load('{path.name}'); save('{path.name}', '-struct', 's', '-v7')",
        )
    if not head.startswith(b"MATLAB") and not _is_version_4(head):
        raise LogError(path, "is no MAT file", "save it in MATLAB with -v7")


def _is_version_4(head: bytes) -> bool:
    """Format 4 opens with the kind, size and length of name of its first variable."""
    if len(head) < 20:
        return False
    kind, rows, columns, imaginary, name = np.frombuffer(head[:20], "<i4").tolist()
    return 0 <= kind < 100 and rows >= 0 and columns >= 0 and imaginary in (0, 1) and name > 1


def _sort(name: str, value: Any, arrays: dict[str, NDArray[Any]], others: dict[str, str]) -> None:
    if not isinstance(value, np.ndarray):
        others[name] = "a sparse matrix" if hasattr(value, "nnz") else "an object"
    elif value.dtype.names is not None:
        if type(value).__name__ != "ndarray":
            others[name] = "an object"
        elif value.size != 1:
            others[name] = f"a struct array of {value.size}"
        else:
            for field in value.dtype.names:
                _sort(f"{name}.{field}", value.flat[0][field], arrays, others)
    elif value.dtype.kind in "biuf" and value.ndim == 2:
        if value.size:
            arrays[name] = value
        else:
            others[name] = "empty"
    else:
        kinds = {"O": "a cell array", "U": "text", "c": "a complex matrix"}
        others[name] = kinds.get(value.dtype.kind, f"an array of {value.ndim} dimensions")


def _columns(arrays: dict[str, NDArray[Any]]) -> Iterator[tuple[str, Array]]:
    for name, array in arrays.items():
        if 1 in array.shape:
            yield name, array.astype(np.float64).ravel()
        elif not _lies(array):
            for index, column in enumerate(array.astype(np.float64).T, 1):
                yield f"{name}.{index}", column


def _lies(array: NDArray[Any]) -> bool:
    rows, columns = array.shape
    return 1 < rows < columns and columns > WIDEST


def _refusal(
    name: str | None, arrays: dict[str, NDArray[Any]], others: dict[str, str]
) -> tuple[str, str]:
    """What is wrong with the variable, and what would do."""
    sizes = {key: f"{len(array)} x {array.shape[1]}" for key, array in arrays.items()}
    if name in arrays:
        return (
            f"variable {name!r} is {sizes[name]}, a sample a column",
            f"turn it in MATLAB: {name} = {name}.'",
        )
    remedy = "save numeric arrays in it"
    if arrays:
        listed = ", ".join(f"{key} ({size})" for key, size in sizes.items())
        remedy = f"name one of its numeric variables in `variable`: {listed}"
    if name is None:
        return "holds no numeric variable", remedy
    if name in others:
        return f"variable {name!r} is {others[name]}", remedy
    inside = [f"{key} is {kind}" for key, kind in others.items() if key.startswith(f"{name}.")]
    if inside:
        return f"variable {name!r} holds no numbers ({', '.join(inside)})", remedy
    return f"has no variable {name!r}", remedy
