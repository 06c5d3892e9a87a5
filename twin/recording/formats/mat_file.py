"""A MATLAB file of format 4, 6 or 7: numeric arrays and the numeric fields of structs."""

import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.formats.array_file import Variables, check_unpacked, library_errors
from twin.stop import check

_AS = "a MAT file", "save it again with -v7"
WORD = 8
"""Of a number [bytes]."""
HEAD = 128
"""Before the first variable of formats 5 to 7 [bytes]."""
CODES = frozenset((*range(1, 8), 9, *range(12, 19)))
"""Of types of data in such a file."""
MATRIX, COMPRESSED = 14, 15
WIDTHS = {3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
"""Of a number of a type of data [bytes]; of others it is 1."""
DEEPEST = 100
"""Structs in one another."""
PART = 1 << 20
"""Unpacked at a time [bytes]."""


def read_variables(path: Path) -> Variables:
    """Read a file.

    Raises:
        LogError: it is no MAT file, or is damaged.
    """
    from scipy.io import loadmat

    if _is_hdf5(path):
        from twin.recording.formats.hdf5_file import read_hdf5

        return read_hdf5(path)
    content: dict[str, Any] = {}
    with library_errors(path, *_AS):
        _check_elements_of(path)
        content = loadmat(path)
    result = _Content()
    for name, value in content.items():
        if not name.startswith("__"):
            _sort(name, value, result)
    turn = "turn it in MATLAB: NAME = NAME.'"
    return Variables(result.arrays, result.others, units=result.units, save=turn)


@dataclass
class _Content:
    """What a file holds, by dotted name."""

    arrays: dict[str, NDArray[Any]] = field(default_factory=dict[str, NDArray[Any]])
    others: dict[str, str] = field(default_factory=dict[str, str])
    units: dict[str, str] = field(default_factory=dict[str, str])


_TITLES = ("label", "Name", "name", "SignalName", "blockName")
"""Fields in which a struct names itself: of Simulink's signals, of dSPACE's variables."""
_SAMPLES = ("values", "Data", "data", "Values")
"""Fields of such a struct that hold its samples."""
MOST_ELEMENTS = 1000


def _sort_elements(name: str, value: Any, result: _Content) -> None:
    """The fields of a struct, or of the elements of an array of structs, by their own titles."""
    titles = _titles(value)
    for index, element in enumerate(value.flat):
        if titles is None:
            for key in value.dtype.names:
                _sort(f"{name}.{key}", element[key], result)
            continue
        inside = f"{name}.{titles[index]}"
        for key in value.dtype.names:
            _sort(inside if key in _SAMPLES else f"{inside}.{key}", element[key], result)
        if "Unit" in value.dtype.names and (unit := _text_of(element["Unit"], path=False)):
            result.units[inside] = unit


def _titles(value: Any) -> list[str] | None:
    """What the elements of an array of structs with samples call themselves; None where they do
    not, or two alike."""
    fields = value.dtype.names
    if value.size > MOST_ELEMENTS or not any(key in _SAMPLES for key in fields):
        return None
    for key in (key for key in _TITLES if key in fields):
        texts = [_text_of(element[key]) for element in value.flat]
        if all(texts) and len(set(texts)) == len(texts):
            return texts
    return None


def _text_of(value: Any, *, path: bool = True) -> str:
    """A text; of a path in quotes (`"Model Root"/"gyro_x"`) the last part, without dots."""
    if not isinstance(value, np.ndarray) or value.dtype.kind != "U" or not value.size:
        return ""
    text = str(value.flat[0]).strip()
    if not path:
        return text
    return text.replace('"', "").rstrip("/").rpartition("/")[2].strip().replace(".", "_")


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


def _check_elements_of(path: Path) -> None:
    """Refuse a file of format 5 to 7 whose variables would fill the memory, or with a type of data
    that there is none of: SciPy looks such a code up behind the end of its table, which ends the
    process.

    Raises:
        LogError: it unpacks to far more than its size.
        ValueError: there is such a type.
    """
    unpacked = numbers = 0
    with path.open("rb") as file:
        head = file.read(HEAD)
        if not head.startswith(b"MATLAB"):
            return
        order = "<" if head.endswith(b"IM") else ">"
        while len(tag := file.read(8)) == 8:
            code, size = struct.unpack(f"{order}II", tag)
            data = file.read(size)
            if code == COMPRESSED:
                unpacked += _unpacked_size(path, data, unpacked)
                data = zlib.decompressobj().decompress(data)
            else:
                data = tag + data
            numbers += _count_numbers(data, order, 0)
            check_unpacked(path, WORD * numbers)


def _unpacked_size(path: Path, data: bytes, before: int) -> int:
    """What a compressed variable unpacks to [bytes]; nothing of it is kept.

    Raises:
        LogError: with the `before` bytes of those before it, far more than the file's size.
    """
    unpacker, size = zlib.decompressobj(), 0
    while part := unpacker.decompress(data, PART):
        check()
        size, data = size + len(part), unpacker.unconsumed_tail
        check_unpacked(path, before + size)
    return size


def _count_numbers(data: bytes | memoryview, order: str, depth: int) -> int:
    """Of the elements that follow one another, and of those within.

    Raises:
        ValueError: an element is of no known type, or too deep.
    """
    view = memoryview(data)
    place = count = 0
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
            count += _count_numbers(view[body : body + size], order, depth + 1)
        else:
            count += size // WIDTHS.get(code, 1)
        place = body + size + -size % 8
    return count


def _sort(name: str, value: Any, result: _Content) -> None:
    arrays, others = result.arrays, result.others
    if type(value).__name__ == "MatlabOpaque":
        own_name, kind = _opaque_kind(value)
        others[own_name or name] = f"a {kind} of MATLAB" if kind else "an object"
    elif not isinstance(value, np.ndarray):
        others[name] = "a sparse matrix" if hasattr(value, "nnz") else "an object"
    elif value.dtype.names is not None:
        if type(value).__name__ != "ndarray":
            others[name] = "an object"
        elif value.size != 1 and _titles(value) is None:
            others[name] = f"a struct array of {value.size}"
        else:
            _sort_elements(name, value, result)
    elif value.dtype.kind in "biuf" and value.ndim == 2:
        if value.size:
            arrays[name] = value
        else:
            others[name] = "empty"
    else:
        kinds = {"O": "a cell array", "U": "text", "c": "a complex matrix"}
        others[name] = kinds.get(value.dtype.kind, f"an array of {value.ndim} dimensions")


def _opaque_kind(value: Any) -> tuple[str, str]:
    """Name and class of an object that only MATLAB can take apart; empty where not known."""
    parts = (value[key].flat[0] for key in ("s0", "s2") if key in value.dtype.names)
    texts = [part.decode() if isinstance(part, bytes) else str(part) for part in parts]
    return (texts[0], texts[1]) if len(texts) == 2 else ("", "")
