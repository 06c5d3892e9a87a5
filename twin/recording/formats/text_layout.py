"""How a text file lays out its table, its dates, and what a terminal program adds to each line.

How a text file lays out its table: separator, decimal mark, preamble, names, units, first row.
The layout is read from the beginning of the file. Programs write, in this order and each of it or
not: lines of free text, one or several rows of names (an object's above those of its columns), a
row of units, rows of numbers. So the first row of numbers is looked for, then what stands above it.

What a terminal program kept of a serial line, as the text of a table.
Terminals write a stamp before each line (`10:22:33.123 -> 0.1,0.2`, `[2026-02-03 10:22:33.123]
0.1,0.2`), and devices that print for a plotter write each value behind its name (`gx:0.1 gy:0.2`).
Each line of the file stays one line, so that an error names the right one.
"""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.recording.column_names import is_clock, is_counter
from twin.units import known_unit

Array = NDArray[np.float64]

_CLOCK = r"\d{1,2}:\d\d(?::\d\d(?:[.,:]\d+)?)?(?: ?[AaPp][Mm])?"
_DAY = r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})|(\d{1,2})([./-])(\d{1,2})[./-](\d{4})"
_DATE = re.compile(rf"(?:{_DAY})(?:(?:[T ]|, ?)({_CLOCK})(?:Z| ?UTC|([+-])(\d\d):?(\d\d))?)?$")
_OF_DAY = re.compile(r"\d{1,2}:\d\d:\d\d(?:[.,:]\d+)?(?: ?[AaPp][Mm])?$")


def is_date(text: str) -> bool:
    """Whether a text is a date with or without a time, or a time of day.

    The date is year-month-day (ISO 8601), day.month.year, or day/month/year in either order.
    """
    text = text.strip()
    return _DATE.match(text) is not None or _OF_DAY.match(text) is not None


def seconds_of(texts: Sequence[str | None]) -> Array:
    """Seconds (m,) since 1970 of dates, since midnight of times of day; NaN for the rest.

    A date without a zone is taken as UTC: only its differences count. Of 2/3/2026 the first number
    is the month, unless a date of the column denies it, or the column spans fewer days otherwise.
    """
    seconds = np.full(len(texts), np.nan)
    days: dict[tuple[str, ...], list[int]] = {}
    for i, text in enumerate(texts):
        if text is None:
            continue
        if (result := _DATE.match(text.strip())) is not None:
            *day, clock, sign, hours, minutes = result.groups(default="")
            days.setdefault(tuple(day), []).append(i)
            seconds[i] = _of_day(clock or "00:00")
            if sign:
                shift = 3600.0 * int(hours) + 60.0 * int(minutes)
                seconds[i] -= shift if sign == "+" else -shift
        elif _OF_DAY.match(text.strip()):
            seconds[i] = _of_day(text.strip())
    for rows, start in zip(days.values(), _starts(list(days)), strict=True):
        seconds[rows] += start
    return seconds


def _starts(days: Sequence[tuple[str, ...]]) -> list[float]:
    """Seconds of the beginnings of days, in the order of day and month that suits them all."""
    readings: list[list[float]] = []
    for month_first in (True, False):
        try:
            readings.append([_start(day, month_first=month_first) for day in days])
        except ValueError:  # there is no month 13
            continue
    if not readings:
        return [float("nan")] * len(days)
    return min(readings, key=lambda reading: max(reading, default=0.0) - min(reading, default=0.0))


def _start(day: tuple[str, ...], *, month_first: bool) -> float:
    year, month, number, first, mark, second, behind = day
    if not year:
        first_is_month = month_first and mark == "/"
        month, number = (first, second) if first_is_month else (second, first)
    days = date(int(year or behind), int(month), int(number)).toordinal()
    return 86400.0 * (days - date(1970, 1, 1).toordinal())


def _of_day(clock: str) -> float:
    half = clock[-2:].lower() if clock[-1:].lower() == "m" else ""
    if half:
        clock = clock[:-2].strip()
    hours, minutes, *rest = clock.replace(",", ".").split(":", 2)
    hour = int(hours) % 12 + 12 * (half == "pm") if half else int(hours)
    seconds = float(rest[0].replace(":", ".")) if rest else 0.0
    return 3600.0 * hour + 60.0 * int(minutes) + seconds


SEPARATORS = (",", ";", "\t", " ")
"""Of columns; a space stands for any number of spaces and tabs."""

BLANKS = (
    "",
    " ",
    "nan",
    "NaN",
    "NAN",
    "-nan",
    "NA",
    "N/A",
    "null",
    "NULL",
    "-nan(ind)",
    "nan(ind)",
)
"""How programs write that there is no number."""

COMMENTS = ("#", "%", "//")
"""Marks of a line of free text."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|[+-]?inf(inity)?$", re.IGNORECASE)
_WITH_UNIT = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)? +([^\s\d].*)$")
"""A number with its unit in one cell: `0.02 sec`, as MATLAB writes a duration."""
_NO_UNIT = ("na", "n/a", "none", "-", "--", "no_units", "unitless", "a.u.", "counts", "lsb")
"""What stands in a row of units where a column has none, in small letters."""
_NUMBERED_NAME = re.compile(
    r"\W*(?:col(?:umn)?|field)?\W*(\d+)\s*[:=.)-]\s*(\S.*?)\s*$", re.IGNORECASE
)
"""A line of comment that names one column by its number: `# column 2: gyro_x [deg/s]`."""
_END_OF_HEADER = "***"
"""Begins the line with which LabVIEW ends what it says of a file."""
_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?$")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?$")
_IDENTIFIER = re.compile(r"[0-9A-F:-]{8,}$", re.IGNORECASE)


@dataclass(frozen=True)
class TextLayout:
    """Where the table of a text file is, and how its rows are written."""

    separator: str
    """One of SEPARATORS."""
    names: tuple[str, ...]
    """Of the columns, each once; numbered from 1 where the file has none."""
    units: tuple[str, ...]
    """The text of a row of units; empty where there is none for a column."""
    empty: tuple[str, ...]
    """Columns without a name or a cell: their separators end the rows."""
    dates: tuple[str, ...]
    """Columns whose first cell is a date or a time of day."""
    named: bool
    """Whether the file has names."""
    names_line: int
    """Where they are (from 1); without names, the line of the first row."""
    first_line: int
    """Of the rows (from 1)."""
    preamble: tuple[str, ...]
    """Lines above all that, without blank ones."""
    repeated: tuple[str, ...]
    """Names that stand above several columns, which are numbered: `x.1`, `x.2`."""
    behind: tuple[str, ...]
    """Units that cells have behind their numbers."""


def layout_of(lines: Sequence[str], above: int = 0) -> TextLayout:
    """The layout of a table that begins with these lines.

    Args:
        lines: at least to the first rows; as many as are at hand make it surer.
        above: lines of the file that stand before.
    """
    separator = _separator(lines)
    rows = [split(line, separator) for line in lines]
    width, numeric = _width(rows, separator)
    first = next((i for i, row in enumerate(rows) if _is_row(row, width, numeric, separator)), None)
    if first is None:  # names at most
        first = next((i for i, row in enumerate(rows) if any(row)), 0) + 1
        width = len(rows[first - 1]) if rows else 0
    top = first
    while top > 0 and _is_heading(rows[top - 1], width):
        top -= 1
    heading = [_of_width(row, width) for row in rows[top:first]]
    if not heading and first > 0 and _could_name(rows[first - 1]):
        top, heading = first - 1, [rows[first - 1]]  # of another width: the rows will say so
    units = _row_of_units(heading)
    units = [_unit_in(cell) for cell in units]
    listed = _listed(lines[:top], width)
    names = _joined(heading) if heading else listed or tuple(str(i) for i in range(1, width + 1))
    units = units or _labelled(rows[:top], names)
    names, repeated = _numbered(names)
    cells = rows[first] if first < len(rows) else []
    behind = tuple(unit_behind(cell) for cell in cells)
    if any(behind):
        behind = (*behind, *[""] * len(names))[: len(names)]
        units = [one or other for one, other in zip(behind, units or behind, strict=True)]
    empty = [not any(row[i : i + 1] and row[i] for row in rows[top:]) for i in range(len(names))]
    return TextLayout(
        separator=separator,
        names=names,
        units=tuple(units) or ("",) * len(names),
        empty=tuple(name for name, none in zip(names, empty, strict=True) if none),
        dates=tuple(n for n, cell in zip(names, cells, strict=False) if is_date(cell)),
        named=bool(heading or listed),
        names_line=above + top + max(len(heading), 1),
        first_line=above + first + 1,
        preamble=tuple(line for line in lines[:top] if line.strip()),
        repeated=repeated,
        behind=tuple(sorted({unit for unit in behind if unit})),
    )


def split(line: str, separator: str) -> list[str]:
    """The cells of a line, without the spaces round them; empty of a blank line."""
    if not line.strip():
        return []
    if separator == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:
        return [line]


def is_finite(text: str) -> bool:
    """Whether a text is a finite number."""
    return _NUMBER.match(text) is not None and "inf" not in text.lower()


def is_number(text: str, separator: str = ",") -> bool:
    """Whether a cell is a number, or says that there is none; with a decimal comma where commas
    separate no columns."""
    text = text.strip()
    if text in BLANKS or _NUMBER.match(text) or unit_behind(text):
        return True
    return separator != "," and bool(_COMMA.match(text) or _THOUSANDS.match(text))


def unit_behind(cell: str) -> str:
    """The unit in a cell behind its number; empty where there is none that we know."""
    result = _WITH_UNIT.match(cell.strip())
    return result[1] if result and known_unit(result[1]) is not None else ""


def _separator(lines: Sequence[str]) -> str:
    """The one that splits most lines into most numbers."""

    def numbers(separator: str) -> tuple[int, int]:
        rows = [split(line, separator) for line in lines]
        widths = Counter(len(row) for row in rows if len(row) > 1)
        counts = Counter[int]()
        for row in rows:
            # a space within a date and its time separates no columns
            counts[len(row)] += sum(
                _is_value(cell, separator) + (" " in cell and is_date(cell)) for cell in row
            )
        return max((counts[width] for width in widths), default=0), 0

    best = max(SEPARATORS, key=numbers)
    if numbers(best)[0]:
        return best
    text = next((line for line in lines if line.strip()), "")
    most = max(SEPARATORS[:3], key=text.count)
    return most if text.count(most) else ","


def _is_value(cell: str, separator: str) -> bool:
    return cell not in BLANKS and (is_number(cell, separator) or is_date(cell))


def _width(rows: Sequence[Sequence[str]], separator: str) -> tuple[int, tuple[bool, ...]]:
    """Cells of a usual row, and which of them are numbers, as a rule."""
    widths = Counter[int]()
    for row in rows:
        if any(_is_value(cell, separator) for cell in row):
            widths[len(row)] += sum(_is_value(cell, separator) for cell in row)
    if not widths:
        return 0, ()
    width = max(widths, key=lambda item: widths[item])
    usual = [row for row in rows if len(row) == width]
    columns = list(zip(*usual, strict=True))
    counts = [sum(is_number(c, separator) or is_date(c) for c in cells) for cells in columns]
    # a column without a single value may hold words on some row
    valued = [any(_is_value(cell, separator) for cell in cells) for cells in columns]
    return width, tuple(
        2 * count > len(usual) and value for count, value in zip(counts, valued, strict=True)
    )


def _is_row(row: Sequence[str], width: int, numeric: Sequence[bool], separator: str) -> bool:
    if len(row) != width or not any(_is_value(cell, separator) for cell in row):
        return False
    kinds = [is_number(cell, separator) or is_date(cell) for cell in row]
    return all(kind for kind, usual in zip(kinds, numeric, strict=True) if usual)


def _is_heading(row: Sequence[str], width: int) -> bool:
    """Whether a line has a name, an object or a unit for each column."""
    if not any(row) or row[0].startswith(_END_OF_HEADER):
        return False
    if row[0] in COMMENTS:  # a mark before the names, as a cell of its own
        row = row[1:]
    short = len(row) == width - 1 and width > 2
    # a separator at the line's end, or a column of comments that no row has
    longer = len(row) == width + 1 and row[-1].lower() in ("", "comment", "comments")
    return len(row) == width or short or longer


def _could_name(row: Sequence[str]) -> bool:
    return len(row) > 1 and not row[0].startswith(COMMENTS) and not all(map(is_finite, row))


def _of_width(row: Sequence[str], width: int) -> list[str]:
    """With as many cells as the rows have: a separator at a line's end ends no column."""
    if row[0] in COMMENTS and len(row) > width:
        row = row[1:]
    return [*row, ""][:width] if len(row) < width else list(row[:width])


def _row_of_units(heading: list[list[str]]) -> list[str]:
    """Takes the row of units out of the heading: the last one, or one that calls itself so;
    empty without any."""
    if len(heading) > 1 and _are_units(heading[-1]):
        return heading.pop()
    for row in heading:
        if row[0].lower() in ("unit", "units") and _are_units(row[1:]):
            heading.remove(row)
            return ["", *row[1:]]
    return []


def _are_units(row: Sequence[str]) -> bool:
    texts = [text for cell in row if (text := _unit_in(cell))]
    return bool(texts) and all(map(known_unit, texts))


def _unit_in(cell: str) -> str:
    """The unit in a cell of a row of units; empty where the cell says that there is none."""
    text = cell.strip("[]() ")
    return "" if text.lower() in _NO_UNIT else text


def _joined(heading: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """One name a column: the last row's, after those of the objects above it."""
    *above, last = [list(row) for row in heading]
    last[0] = _without_mark(last[0])
    single = [is_clock(name) or is_counter(name) for name in last]
    levels: list[list[str]] = []
    for row in above:
        filled, current = list[str](), ""
        for cell, alone in zip(row, single, strict=True):
            current = "" if alone else cell or current
            filled.append(current)
        inside = {cell for cell in filled if cell}
        # what stands above all columns tells none from another, and nobody knows a serial number;
        # where each column has its own (a signal's path), its name says the rest
        each = len(inside) == len(filled) - single.count(True) and len(set(last)) == len(last)
        if len(inside) > 1 and not each and not all(map(_IDENTIFIER.match, inside)):
            levels.append(filled)
    parts = zip(*levels, last, strict=True)
    return tuple(".".join(cell for cell in column if cell) for column in parts)


def _listed(preamble: Sequence[str], width: int) -> tuple[str, ...]:
    """The names that lines of comment give to the columns, one a line; empty without them."""
    result = (_NUMBERED_NAME.match(line) for line in preamble if line.startswith(COMMENTS))
    named = {int(item[1]): item[2] for item in result if item}
    if sorted(named) != list(range(1, width + 1)):
        return ()
    return tuple(named[place] for place in sorted(named))


def _labelled(above: Sequence[Sequence[str]], names: Sequence[str]) -> list[str]:
    """The units of a row that LabVIEW writes far above the names, the first column's left out."""
    row = next((row for row in above if row and row[0] == "Y_Unit_Label"), None)
    return [] if row is None else ["", *row[1:], *[""] * len(names)][: len(names)]


def _without_mark(name: str) -> str:
    for mark in COMMENTS:
        if name.startswith(mark):
            return name[len(mark) :].strip()
    return name


def _numbered(names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Each name once, and those that were there several times."""
    counts = Counter(names)
    seen = Counter[str]()
    unique: list[str] = []
    for place, name in enumerate(names, 1):
        seen[name] += 1
        item = f"{name}.{seen[name]}" if counts[name] > 1 and name else name
        unique.append(item if name or counts[name] == 1 else f"column {place}")
    return tuple(unique), tuple(name for name, count in counts.items() if count > 1 and name)


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
_TERMINAL_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|nan"
_PAIR = re.compile(rf"([A-Za-z_][\w.]*)\s*[:=]\s*({_TERMINAL_NUMBER})")
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
            stamp = next((item for item in _STAMPS if _mostly_match(lines, item)), None)
            bodies = [_parted(line, stamp)[1] for line in lines]
            pairs = _mostly_match(bodies, _PAIRS) and len(_keys(bodies)) > 1
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


def _mostly_match(lines: Sequence[str], pattern: re.Pattern[str]) -> bool:
    filled = [line for line in lines if line.strip()]
    count = sum(pattern.match(line) is not None for line in filled)
    return count >= FEWEST and count >= MOSTLY * len(filled)


def _parted(line: str, stamp: re.Pattern[str] | None) -> tuple[str, str]:
    """The stamp of a line, and what the device sent."""
    result = None if stamp is None else stamp.match(line)
    if result is None:
        return "", line
    return result[1].strip().replace(" ", "T"), result[2]


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


def _of_rows(parted: Sequence[tuple[str, str]], layout: TextLayout) -> bytes:
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
