"""A MATLAB file of format 4, 6 or 7: numeric arrays and the numeric fields of structs."""

import math
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.formats.array_file import Variables
from twin.recording.formats.extras import check_unpacked, library_errors
from twin.stop import check

_AS = "a MAT file", "save it again with -v7"
WORD = 8
"""Of a number [bytes]."""
HEAD = 128
"""Before the first variable of formats 5 to 7 [bytes]."""
CODES = frozenset((*range(1, 8), 9, *range(12, 19)))
"""Of types of data in such a file."""
MATRIX, COMPRESSED = 14, 15
DEEPEST = 100
"""Structs in one another."""


def read_variables(path: Path) -> Variables:
    """Read a file.

    Raises:
        LogError: it is no MAT file, or is damaged.
    """
    from scipy.io import loadmat, whosmat

    if _is_hdf5(path):
        from twin.recording.formats.hdf5_file import read_hdf5

        return read_hdf5(path)
    try:
        held = [math.prod(shape) for _, shape, _ in whosmat(path)]
    except Exception:  # said below
        held = []
    check_unpacked(path, WORD * sum(held))
    content: dict[str, Any] = {}
    with library_errors(path, *_AS):
        _check_codes(path)
        content = loadmat(path)
    arrays: dict[str, NDArray[Any]] = {}
    others: dict[str, str] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _sort(name, value, arrays, others)
    return Variables(arrays, others, save="turn it in MATLAB: NAME = NAME.'")


def _is_hdf5(path: Path) -> bool:
    """Whether it is of version 7.3.

    Raises:
        LogError: it is no MAT file at all.
    """
    try:
        with path.open("rb") as file:
            head = file.read(128)
    except OSError as problem:
        raise LogError(path, f"cannot be read ({problem.strerror})", "check the path") from None
    if head.startswith((b"\x89HDF", b"MATLAB 7.3")):
        return True
    if not head.startswith(b"MATLAB") and not _is_version_4(head):
        raise LogError(path, "is no MAT file", "save it in MATLAB with -v7")
    return False


def _is_version_4(head: bytes) -> bool:
    """Format 4 opens with the kind, size and length of name of its first variable."""
    if len(head) < 20:
        return False
    kind, rows, columns, imaginary, name = np.frombuffer(head[:20], "<i4").tolist()
    return 0 <= kind < 100 and rows >= 0 and columns >= 0 and imaginary in (0, 1) and name > 1


def _check_codes(path: Path) -> None:
    """Refuse a file of format 5 to 7 with a type of data that there is none of: SciPy looks such a
    code up behind the end of its table, which ends the process.

    Raises:
        ValueError: there is one.
    """
    with path.open("rb") as file:
        head = file.read(HEAD)
        if not head.startswith(b"MATLAB"):
            return
        order = "<" if head.endswith(b"IM") else ">"
        while len(tag := file.read(8)) == 8:
            check()
            code, size = struct.unpack(f"{order}II", tag)
            data = file.read(size)
            if code == COMPRESSED:
                _check_elements(zlib.decompressobj().decompress(data), order, 0)
            else:
                _check_elements(tag + data, order, 0)


def _check_elements(data: bytes | memoryview, order: str, depth: int) -> None:
    """The same of elements that follow one another."""
    view = memoryview(data)
    place = 0
    while place + 8 <= len(view):
        code, size = struct.unpack_from(f"{order}II", view, place)
        body = place + 8
        if code >> 16:  # size and code share a word, and four bytes of data the next
            code, size = code & 0xFFFF, 0
        if code not in CODES:
            raise ValueError(f"data of type {code}")
        if depth > DEEPEST:
            raise ValueError(f"more than {DEEPEST} structs in one another")
        if code == MATRIX:
            _check_elements(view[body : body + size], order, depth + 1)
        place = body + size + -size % 8


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
