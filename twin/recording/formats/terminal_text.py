"""What a terminal program kept of a serial line, as the text of a table.

Terminals write a stamp before each line (`10:22:33.123 -> 0.1,0.2`, `[2026-02-03 10:22:33.123]
0.1,0.2`), and devices that print for a plotter write each value behind its name (`gx:0.1 gy:0.2`).
Each line of the file stays one line, so that an error names the right one.
"""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from twin.recording.formats.dates import is_date
from twin.recording.formats.text_layout import Layout, layout_of, split

HEAD = 1 << 16
"""Of a file, from which it is known whether a terminal wrote it [bytes]."""
MOSTLY = 0.8
"""Share of the lines that look so."""
FEWEST = 3
"""Lines, at least."""

_STAMPS = (
    re.compile(r"(\d{1,2}:\d\d:\d\d[.,]\d+) -> ?(.*)$"),
    re.compile(r"\[([^\[\]]*\d\d:\d\d:\d\d[^\[\]]*)\][ \t]?(.*)$"),
)
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan"
_PAIR = re.compile(rf"([A-Za-z_][\w.]*)\s*[:=]\s*({_NUMBER})")
_PAIRS = re.compile(rf"\s*(?:{_PAIR.pattern}[\s,;]*)+$")


def captured(path: Path) -> bytes | None:
    """The table in a capture of a serial line; None where the file is no such text.

    Args:
        path: of a text file.
    """
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
            lines = _decoded(head).splitlines()[: None if len(head) < HEAD else -1]
            stamp = next((one for one in _STAMPS if _most(lines, one)), None)
            bodies = [_parted(line, stamp)[1] for line in lines]
            pairs = _most(bodies, _PAIRS) and len(_keys(bodies)) > 1
            if stamp is None and not pairs:
                return None
            whole = _decoded(head + file.read()).splitlines()
    except OSError:  # the reader of the text says what is wrong
        return None
    parted = [_parted(line, stamp) for line in whole]
    if pairs:
        return _of_pairs(parted, _keys(bodies), stamped=stamp is not None)
    return _of_rows(parted, layout_of(bodies))


def _decoded(content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


def _most(lines: Sequence[str], pattern: re.Pattern[str]) -> bool:
    filled = [line for line in lines if line.strip()]
    count = sum(pattern.match(line) is not None for line in filled)
    return count >= FEWEST and count >= MOSTLY * len(filled)


def _parted(line: str, stamp: re.Pattern[str] | None) -> tuple[str, str]:
    """The stamp of a line, and what the device sent."""
    found = None if stamp is None else stamp.match(line)
    if found is None:
        return "", line
    return found[1].strip().replace(" ", "T"), found[2]


def _keys(bodies: Sequence[str]) -> tuple[str, ...]:
    """The names that most lines have, in their order."""
    named = Counter(tuple(key for key, _ in _PAIR.findall(body)) for body in bodies)
    return max(named, key=lambda keys: (named[keys] * bool(keys), len(keys)), default=())


def _of_pairs(parted: Sequence[tuple[str, str]], keys: tuple[str, ...], *, stamped: bool) -> bytes:
    """A table with a column a name, its names on a line of their own before the first row; lines
    of other names are left out."""
    names = ",".join((*(("time",) if stamped else ()), *keys))
    lines: list[str] = []
    for stamp, body in parted:
        pairs = _PAIR.findall(body) if _PAIRS.match(body) else []
        whole = tuple(key for key, _ in pairs) == keys and bool(stamp) == stamped
        cells = (*((stamp,) if stamped else ()), *(value for _, value in pairs))
        lines.append(",".join(cells) if whole else "")
    return "\n".join([names, *lines, ""]).encode()


def _of_rows(parted: Sequence[tuple[str, str]], layout: Layout) -> bytes:
    """The rows behind their stamps, and the names behind `time`."""
    separator = layout.separator
    width = len(layout.names)
    names = None if not layout.named else split(parted[layout.names_line - 1][1], separator)
    lines: list[str] = []
    for stamp, body in parted:
        cells = split(body, separator)
        if names is not None and cells == names:
            lines.append(f"time{separator}{body.strip()}")
        elif len(cells) == width and is_date(stamp):
            lines.append(f"{stamp}{separator}{body.strip()}")
        else:
            lines.append("")
    return "\n".join([*lines, ""]).encode()
