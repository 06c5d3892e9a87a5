"""A DataFlash log of ArduPilot, binary (`.bin`) or as text (`.log`): fields by kind of message.

Messages of the type FMT say how the others are built. A kind with an instance (`I`: the second
IMU, say) comes as one for each: `IMU.0.GyrX`.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from twin.errors import LogError
from twin.recording.formats.array_file import Numbers, Variables

MARK = b"\xa3\x95"
"""Begins every binary message, before the number of its kind."""
FMT = 128
LABELS = 89
"""Length of a message FMT [bytes]."""
_TEXT = re.compile(rb"\s*FMT, ?128, ?89, ?FMT,")

_TYPES: dict[str, tuple[str, float]] = {
    **{code: (code, 1.0) for code in "bBhHiIqQfd"},
    "M": ("B", 1.0),
    **{code: (kind, 0.01) for code, kind in zip("cCeE", "hHiI", strict=True)},
    "L": ("i", 1e-7),
    **{code: (f"{size}s", 1.0) for code, size in (("n", 4), ("N", 16), ("Z", 64), ("a", 64))},
}
"""Code of a field -> its format in `struct`, and what it is multiplied by."""
_UNITS = (
    (r"(^|\.)TimeUS$", "us"),
    (r"^(IMU|GYR)\b.*\.Gyr[XYZ]$", "rad/s"),
    (r"^(IMU|ACC)\b.*\.Acc[XYZ]$", "m/s^2"),
    (r"^(ATT|AHR2|NKF1|XKF1)\b.*\.(Roll|Pitch|Yaw)$", "deg"),
    (r"^MAG\b.*\.Mag[XYZ]$", "mG"),
)
"""Fields whose units ArduPilot's list of messages states."""


def is_dataflash(path: Path) -> bool:
    """Whether a file begins as a DataFlash log does, in bytes or in text."""
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except OSError:
        return False
    return head.startswith(MARK + bytes([FMT])) or _TEXT.match(head) is not None


def read_dataflash(path: Path) -> Variables:
    """The kinds of messages that hold numbers.

    Raises:
        LogError: it is no DataFlash log, or holds nothing.
    """
    try:
        content = path.read_bytes()
    except OSError as problem:
        raise LogError(path, f"cannot be read ({problem.strerror})", "check the path") from None
    if not is_dataflash(path):
        raise LogError(path, "is no DataFlash log of ArduPilot", "download it again")
    rows = _of_text(content) if _TEXT.match(content) else _of_bytes(content)
    tables: dict[str, tuple[Sequence[str], list[Sequence[float]]]] = {}
    for name, columns, values in rows:
        kind = f"{name}.{values[columns.index('I')]:.0f}" if "I" in columns else name
        tables.setdefault(kind, (columns, []))[1].append(values)
    arrays: dict[str, Numbers] = {}
    units: dict[str, str] = {}
    for kind, (columns, table) in tables.items():
        for column, values in zip(columns, np.array(table).T, strict=True):
            field = f"{kind}.{column}"
            if np.isfinite(values).any():
                arrays[field] = values
                if stated := [text for pattern, text in _UNITS if re.search(pattern, field)]:
                    units[field] = stated[0]
    if not arrays:
        raise LogError(path, "holds no messages with numbers", "download it again")
    return Variables(arrays, {}, units=units)


def _of_text(content: bytes) -> Iterator[tuple[str, Sequence[str], Sequence[float]]]:
    """Kind, names and numbers of each message; NaN for a text."""
    columns: dict[str, Sequence[str]] = {}
    for line in content.decode("utf-8", "replace").splitlines():
        name, *cells = (cell.strip() for cell in line.split(","))
        if name == "FMT" and len(cells) > 4:
            columns[cells[2]] = cells[4:]
        elif name in columns and len(cells) == len(columns[name]):
            yield name, columns[name], [_number(cell) for cell in cells]


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _of_bytes(content: bytes) -> Iterator[tuple[str, Sequence[str], Sequence[float]]]:
    """The same of a binary log; damaged parts are skipped up to the next mark."""
    kinds: dict[int, tuple[str, Sequence[str], struct.Struct, Sequence[float]]] = {}
    place = content.find(MARK)
    while 0 <= place < len(content) - 3:
        number = content[place + 2]
        start = place + 3
        if number == FMT and start + LABELS - 3 <= len(content):
            _learn(content[start : start + LABELS - 3], kinds)
            place += LABELS
        elif number in kinds and start + kinds[number][2].size <= len(content):
            name, columns, layout, factors = kinds[number]
            values = layout.unpack_from(content, start)
            yield (
                name,
                columns,
                [
                    float("nan") if isinstance(value, bytes) else value * factor
                    for value, factor in zip(values, factors, strict=True)
                ],
            )
            place = start + layout.size
        else:
            place += 2
        if content[place : place + 2] != MARK:
            place = content.find(MARK, place)


def _learn(
    body: bytes, kinds: dict[int, tuple[str, Sequence[str], struct.Struct, Sequence[float]]]
) -> None:
    """Take in what a message FMT says of a kind."""
    number, length, *texts = struct.unpack("<BB4s16s64s", body)
    name, codes, labels = (text.split(b"\0")[0].decode("ascii", "replace") for text in texts)
    if not all(code in _TYPES for code in codes):
        return  # arrays, which hold no stream
    layout = struct.Struct("<" + "".join(_TYPES[code][0] for code in codes))
    columns = labels.split(",")
    if layout.size == length - 3 and len(columns) == len(codes):
        kinds[number] = name, columns, layout, [_TYPES[code][1] for code in codes]
