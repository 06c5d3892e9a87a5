"""A CSV file of numbers, read fast; where it is wrong, a second, slow pass finds the line."""

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from twin.errors import LogError, UnknownName

Array = NDArray[np.float64]

LONGEST_LINE = 1 << 20
"""A line of more bytes is no row of a log [bytes]; reading stops there."""


@dataclass(frozen=True)
class CsvFile:
    """A CSV file in memory: its text, and the names in its first row."""

    path: Path
    content: bytes
    header: tuple[str, ...]

    def numbers(self, names: Sequence[str]) -> Array:
        """The named columns, shape (rows, len(names)).

        Raises:
            LogError: a name that is not in the first row, a ragged row, a text that is no finite
                number; with the line.
        """
        for name in names:
            if name not in self.header:
                hint = str(UnknownName("column", name, self.header))
                raise LogError(self.path, hint, "name a column of its first row", line=1)
        try:
            table = arrow_csv.read_csv(
                pa.BufferReader(self.content),
                read_options=arrow_csv.ReadOptions(column_names=self.header, skip_rows=1),
                convert_options=arrow_csv.ConvertOptions(
                    include_columns=list(names),
                    column_types=dict.fromkeys(names, pa.float64()),
                    null_values=[],
                ),
            )
        except pa.ArrowInvalid as problem:
            raise self._first_error(names) or LogError(
                self.path, f"is no table of numbers ({problem})", "save it as CSV again"
            ) from None
        columns = [np.asarray(table.column(name).to_numpy()) for name in names]
        values = np.stack(columns, axis=-1) if columns else np.empty((0, 0))
        if not np.isfinite(values).all():
            raise self._first_error(names) or LogError(
                self.path, "holds a value that is not finite", "remove it"
            )
        if len(values) == 0:
            raise LogError(self.path, "has column names but no rows", "check the export", line=1)
        return values

    def line_of(self, row: int) -> int:
        """The line (from 1) on which row `row` (from 0) stands; blank lines are no rows."""
        rows = (line for line, _ in self._rows())
        return next(line for index, line in enumerate(rows) if index == row)

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        reader = csv.reader(io.StringIO(self.content.decode("utf-8")))
        next(reader)
        for row in reader:
            if row:
                yield reader.line_num, row

    def _first_error(self, names: Sequence[str]) -> LogError | None:
        places = [(name, self.header.index(name)) for name in names]
        for line, row in self._rows():
            if len(row) != len(self.header):
                return LogError(
                    self.path,
                    f"is a row of {len(row)} under {len(self.header)} column names",
                    "complete the row or delete it",
                    line=line,
                )
            for name, place in places:
                text = row[place].strip()
                if not _is_finite(text):
                    return LogError(
                        self.path,
                        f"column {name!r} holds {_quoted(text)}, which is no finite number",
                        "write the number, or delete the row",
                        line=line,
                    )
        return None


def read_csv(path: Path) -> CsvFile:
    """Read a CSV file and the names in its first row; no number is looked at yet.

    Raises:
        LogError: missing, empty, not text, a line longer than a log's, or no column names.
    """
    content = _content(path)
    if not content.strip():
        raise LogError(path, "is empty", "check the export")
    try:
        content.decode("utf-8")
    except UnicodeDecodeError as problem:
        line = content.count(b"\n", 0, problem.start) + 1
        raise LogError(path, "is not UTF-8 text", "save it as CSV in UTF-8", line=line) from None
    if b"\0" in content:
        line = content.count(b"\n", 0, content.index(b"\0")) + 1
        raise LogError(path, "is not text but binary", "export it as CSV", line=line)
    content = content.removeprefix(b"\xef\xbb\xbf")
    first = next(csv.reader([content.split(b"\n", 1)[0].decode("utf-8").rstrip("\r")]), [])
    header = tuple(name.strip() for name in first)
    _check_header(path, header)
    return CsvFile(path, content, header)


def _content(path: Path) -> bytes:
    chunks: list[bytes] = []
    open_line, line = 0, 1
    try:
        with path.open("rb") as file:
            while chunk := file.read(LONGEST_LINE):
                ends = chunk.count(b"\n")
                pieces = chunk.split(b"\n") if ends else [chunk]
                lengths = [open_line + len(pieces[0]), *(len(piece) for piece in pieces[1:])]
                if max(lengths) >= LONGEST_LINE:
                    raise LogError(
                        path,
                        "holds a line of more than 1 MiB, so it is no table",
                        "export it as CSV with one row a line",
                        line=line + int(np.argmax(np.array(lengths) >= LONGEST_LINE)),
                    )
                open_line, line = lengths[-1], line + ends
                chunks.append(chunk)
    except FileNotFoundError:
        raise LogError(path, "there is no such file", "check `file` in log.toml") from None
    except (IsADirectoryError, PermissionError) as problem:
        raise LogError(path, f"cannot be read ({problem.strerror})", "check the path") from None
    return b"".join(chunks)


def _check_header(path: Path, header: tuple[str, ...]) -> None:
    if len(header) == 1:
        for mark, name in ((";", "semicolons"), ("\t", "tabs")):
            if mark in header[0]:
                raise LogError(
                    path, f"separates its columns by {name}", "save it with commas", line=1
                )
    if any(_is_finite(name) for name in header):
        raise LogError(
            path, "has a number in its first row", "write the column names there", line=1
        )
    for name in header:
        if header.count(name) > 1:
            raise LogError(path, f"names two columns {name!r}", "give each its own name", line=1)


def _is_finite(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text))) and "_" not in text
    except ValueError:
        return False


def _quoted(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "...") if text else "nothing"
