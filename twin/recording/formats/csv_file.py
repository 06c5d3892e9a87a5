"""A CSV file of numbers, read fast; where it is wrong, a second, slow pass finds the line."""

import csv
import io
import re
from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from twin.errors import LogError, UnknownName
from twin.recording.formats.number_file import NumberFile

Array = NDArray[np.float64]

LONGEST_LINE = 1 << 20
"""A line of more bytes is no row of a log [bytes]; reading stops there."""

BLOCK = 1 << 16
"""Read at once [bytes]."""

SEPARATORS = (",", ";", "\t")
"""Of columns: that of which the first row has most."""

_COMMA = re.compile(rb'[;\t\n]\s*"?[+-]?(\d+,\d*|,\d+)([eE][+-]?\d+)?"?\s*(?=[;\t\r\n]|$)')
"""A cell that is a number with a decimal comma, and nothing else."""

BLANKS = ["", " ", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "null", "NULL"]
"""How programs write that there is no number."""


class CsvFile(NumberFile):
    """A CSV file in memory: its text, and the names in its first row."""

    def __init__(self, path: Path) -> None:
        """Read the text and the first row; no number is looked at yet.

        Raises:
            LogError: empty, not text, a line longer than a log's, or no column names.
        """
        self._content = _content(path).removeprefix(b"\xef\xbb\xbf")
        if not self._content.strip():
            raise LogError(path, "is empty", "check the export")
        try:
            self._content.decode("utf-8")
        except UnicodeDecodeError as problem:
            line = self._content.count(b"\n", 0, problem.start) + 1
            raise LogError(
                path, "is not UTF-8 text", "save it as CSV in UTF-8", line=line
            ) from None
        text = self._content.split(b"\n", 1)[0].decode("utf-8").rstrip("\r")
        self._separator = max(SEPARATORS, key=text.count)
        # where commas separate no columns, a number may have one
        commas = self._separator != "," and _COMMA.search(self._content, len(text.encode()))
        self._point = "," if commas else "."
        try:
            header = next(csv.reader([text], delimiter=self._separator), [])
        except csv.Error as problem:
            raise LogError(path, f"has no column names ({problem})", "add them", line=1) from None
        super().__init__(path, [name.strip() for name in header])
        _check_header(path, self.header, text, self._cells(_second_line(self._content)))
        self._leave_out_what_was_cut()

    def numbers(self, names: Sequence[str]) -> Array:
        for name in names:
            if name not in self.header:
                problem = str(UnknownName("column", name, self.header))
                raise LogError(self.path, problem, "name a column of its first row", line=1)
        # its own handler of Ctrl-C would raise in the middle of the work (twin/stop.py)
        pa.enable_signal_handlers(False)
        try:
            table = arrow_csv.read_csv(
                pa.BufferReader(self._content),
                read_options=arrow_csv.ReadOptions(column_names=self.header, skip_rows=1),
                parse_options=arrow_csv.ParseOptions(delimiter=self._separator),
                convert_options=arrow_csv.ConvertOptions(
                    include_columns=list(names),
                    column_types=dict.fromkeys(names, pa.float64()),
                    null_values=BLANKS,
                    decimal_point=self._point,
                ),
            )
        except pa.ArrowInvalid as problem:
            raise self._first_error(names) or LogError(
                self.path, f"is no table of numbers ({problem})", "save it as CSV again"
            ) from None
        if table.num_rows == 0:
            raise LogError(self.path, "has column names but no rows", "check the export", line=1)
        columns = [np.asarray(table.column(name).to_numpy()) for name in names]
        return np.stack(columns, axis=-1)

    def fault(self, problem: str, remedy: str, row: int | None = None) -> LogError:
        """A row stands on a line; blank lines are no rows."""
        line = None
        if row is not None:
            line = next(line for index, (line, _) in enumerate(self._rows()) if index == row)
        return LogError(self.path, problem, remedy, line=line)

    def not_finite(self, row: int, name: str, value: float) -> LogError:
        del value
        text = next(cells for index, (_, cells) in enumerate(self._rows()) if index == row)
        return self._not_finite(row, name, text[self.header.index(name)].strip())

    def _not_finite(self, row: int, name: str, text: str) -> LogError:
        if self._point == "," and _is_finite(text):
            return self.fault(
                f"column {name!r} holds {_quoted(text)}, and other numbers have decimal commas",
                "write all alike, with points or with commas",
                row,
            )
        if _is_date(text):
            return self.fault(
                f"column {name!r} holds {_quoted(text)}, a date",
                "export seconds (since 1970, say), or the table as .parquet with a timestamp",
                row,
            )
        return self.fault(
            f"column {name!r} holds {_quoted(text)}, which is no finite number",
            "write the number, or delete the row",
            row,
        )

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        text = io.StringIO(self._content.decode("utf-8"))
        reader = csv.reader(text, delimiter=self._separator)
        try:
            next(reader)
            for row in reader:
                if row:
                    yield reader.line_num, row
        except csv.Error as problem:
            raise LogError(
                self.path, f"is no row ({problem})", "save it as CSV again", line=reader.line_num
            ) from None

    def _cells(self, line: str) -> list[str]:
        return line.split(self._separator) if line.strip() else []

    def _first_error(self, names: Sequence[str]) -> LogError | None:
        places = [(name, self.header.index(name)) for name in names]
        for index, (line, row) in enumerate(self._rows()):
            if len(row) != len(self.header):
                return LogError(
                    self.path,
                    f"is a row of {len(row)} under {len(self.header)} column names",
                    self._remedy(row),
                    line=line,
                )
            if index == 0 and self._separator == "," and all(map(_has_comma, row)):
                return LogError(
                    self.path,
                    f"holds decimal commas, {_quoted(row[0])}",
                    "write decimal points, or separate the columns by semicolons",
                    line=line,
                )
            if index == 0 and not any(self._is_number(cell) for cell in row):
                return LogError(
                    self.path,
                    f"holds no number, but {_quoted(self._separator.join(row))}",
                    "delete it; units go into log.toml, one a stream",
                    line=line,
                )
            for name, place in places:
                if not self._is_number(row[place]):
                    return self._not_finite(index, name, row[place].strip())
        return None

    def _remedy(self, row: Sequence[str]) -> str:
        """What would do about a row that is longer or shorter than the first."""
        if len(row) == 2 * len(self.header) and self._separator == ",":
            return "write decimal points, or separate the columns by semicolons"
        if len(row) == len(self.header) + 1 and not row[-1].strip():
            return f"its last {self._separator!r} ends no column: end all rows alike"
        return "complete the row or delete it"

    def _is_number(self, text: str) -> bool:
        """Or none at all, as programs write it and the reader takes it."""
        if self._point == ",":
            text = text.replace(".", "?").replace(",", ".")
        return _is_number(text)

    def _leave_out_what_was_cut(self) -> None:
        """A last row that lacks columns and its end was being written when the recorder stopped."""
        start = self._content.rfind(b"\n") + 1
        last = self._content[start:].decode("utf-8")
        if start and 0 < len(self._cells(last)) < len(self.header):
            line = self._content.count(b"\n") + 1
            self._content = self._content[:start]
            self.repairs = (f"{self.path.name}:{line}: a last row that was cut short left out",)


def _content(path: Path) -> bytes:
    """All bytes of the file; a binary one and an endless line are refused while reading."""
    try:
        with path.open("rb") as file:
            return b"".join(_blocks(path, file))
    except OSError as problem:
        raise LogError(path, f"cannot be read ({problem.strerror})", "check the path") from None


def _blocks(path: Path, file: BinaryIO) -> Iterator[bytes]:
    line, length, binary = 1, 0, False
    while block := file.read(BLOCK):
        first, ended, others = block.partition(b"\n")
        length, binary = length + len(first), binary or b"\0" in first
        if length >= LONGEST_LINE:
            raise LogError(
                path,
                "holds a line of more than 1 MiB, so it is no table",
                "export it as CSV with one row a line",
                line=line,
            )
        if ended:
            whole, _, rest = others.rpartition(b"\n")
            if binary or b"\0" in whole:
                line += 0 if binary else 1 + whole.count(b"\n", 0, whole.index(b"\0"))
                break
            line, length, binary = line + 1 + others.count(b"\n"), len(rest), b"\0" in rest
        yield block
    else:
        if not binary:
            return
    raise LogError(path, "is not text but binary", "export it as CSV", line=line)


def _second_line(content: bytes) -> str:
    start = content.find(b"\n") + 1
    stop = content.find(b"\n", start) if start else 0
    return content[start : None if stop < 0 else stop].decode("utf-8").rstrip("\r")


def _check_header(path: Path, header: tuple[str, ...], text: str, below: Sequence[str]) -> None:
    """
    Args:
        path: of the file.
        header: the names in its first row.
        text: that row.
        below: the cells of the next.
    """
    spaced = below[0].split() if len(below) == 1 else []
    numbers = len(below) == len(header) and all(map(_is_number, below))
    # numpy.savetxt puts the mark before the names themselves
    if header and header[0].startswith("#") and not numbers:
        raise LogError(
            path,
            f"begins with {_quoted(text)}, which looks like a comment",
            "delete what stands above the column names",
            line=1,
        )
    alone = len(header) == 1 and " " in header[0]
    if alone and len(spaced) > 1 and all(map(_is_number, spaced)):
        raise LogError(
            path,
            f"separates its columns by spaces, {_quoted(text)}",
            "save it with commas",
            line=1,
        )
    if any(_is_finite(name) for name in header):
        raise LogError(
            path,
            f"has a number in its first row, {_quoted(text)}",
            "write the column names there",
            line=1,
        )
    for name in header:
        if header.count(name) > 1:
            raise LogError(path, f"names two columns {name!r}", "give each its own name", line=1)


def _is_finite(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text))) and "_" not in text
    except ValueError:
        return False


def _is_number(text: str) -> bool:
    return text.strip() in BLANKS or _is_finite(text)


def _has_comma(text: str) -> bool:
    return "," in text and _is_number(text.replace(",", "."))


def _is_date(text: str) -> bool:
    if re.match(r"\d+[.:/]\d+[.:/]\d+", text):  # a day, or a time of day, as people write them
        return True
    try:
        datetime.fromisoformat(text)
    except ValueError:
        return False
    return "-" in text or ":" in text


def _quoted(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "...") if text else "nothing"
