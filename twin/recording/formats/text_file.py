"""A text file with a table of numbers, read fast; where it is wrong, a slow pass finds the line."""

import codecs
import csv
import io
import re
import sys
from array import array
from collections.abc import Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from twin.errors import LogError, UnknownName
from twin.recording.formats.array_file import (
    Names,
    NumberFile,
    ReadProgress,
    Say,
    Tables,
    filled_in,
    silent,
)
from twin.recording.formats.text_layout import (
    BLANKS,
    is_date,
    is_finite,
    is_number,
    layout_of,
    seconds_of,
    split,
    unit_behind,
)
from twin.stop import check

Array = NDArray[np.float64]

LONGEST_LINE = 1 << 20
"""A line of more bytes is no row of a log [bytes]; reading stops there."""
BLOCK = 1 << 20
"""Read at once [bytes]."""
CHUNK = 4 << 20
"""Made numbers at once, by as many threads as there are cores [bytes]."""
HEAD = 1 << 18
"""Of a file, from which its layout is read [bytes]."""
HEAD_LINES = 400
MOST_COLUMNS = 10_000
LONGEST_NAME = 1000
"""Of a column, with the objects above it [characters]."""

_LIST = re.compile(rb'"\[([^\]"\r\n]*)\]"')
"""A cell that holds a list, as programs write an array into one column."""
_DECIMAL = re.compile(rb"(0?,\d+|\d{4,},\d+|\d+,(\d{1,2}|\d{4,})?)$")
"""One whose comma can only be a decimal one: not three digits behind it, or none to be grouped."""
_GROUPED = re.compile(rb"\d{1,3}(,\d{3})+\.\d*$|\d{1,3}(,\d{3}){2,}$")
"""One whose commas can only be those of thousands."""


class TextFile(NumberFile):
    """A table in a text file. Only what is asked for is held in memory.

    A column whose cells hold lists of numbers in quotes, "[1, 0, 1]", is as many columns, `NAME[0]`
    and so on.
    """

    def __init__(
        self,
        path: Path,
        variable: str | None = None,
        decimal: str | None = None,
        content: bytes | None = None,
        say: Say = silent,
    ) -> None:
        """Read the layout and look through the text; no number is looked at yet.

        Args:
            path: of the file.
            variable: the title of one of several tables in it, a line of its own.
            decimal: "," or ".", where the file leaves open what its commas are.
            content: of the file, where it is no text itself.
            say: takes a line of progress.

        Raises:
            LogError: empty, not text, a line longer than a log's, commas that may mean two things.
        """
        self._text = _Text(path, content)
        self._variable, self._decimal, self._say = variable, decimal, say
        self._tables = Tables()
        self._filled: dict[Names, bytearray | None] = {}
        self._last = sys.maxsize
        lines, above = self._text.head(variable)
        lines, self._lists = _without_lists(lines)
        if not any(line.strip() for line in lines):
            raise LogError(path, "is empty", "check the export")
        self._layout = layout = layout_of(lines, above)
        long = next((name for name in layout.names if len(name) > LONGEST_NAME), None)
        if long is not None:
            raise LogError(
                path,
                f"has no column names, but {_quoted(long)} of {len(long)} characters",
                "add them",
                line=layout.names_line,
            )
        if len(layout.names) > MOST_COLUMNS:
            raise LogError(
                path,
                f"has {len(layout.names)} columns",
                "export those of the log only, a sample a row",
                line=layout.names_line,
            )
        super().__init__(path, layout.names, layout.dates)
        self.repeated = layout.repeated
        self.numbered = not layout.named
        self.units = dict(zip(layout.names, layout.units, strict=True))
        self._below = layout.first_line - 1
        above_row = next(self._text.lines(layout.names_line - 1, layout.names_line), "")
        self._names = above_row.encode() if layout.named else b""
        self._behind = _units_behind(layout.behind)
        self._again = 0
        self._end = None if variable is None else self._text.end_of_table(self._below)
        self._cut = 0
        last = self._cells(self._text.last_line()) if self._end is None else []
        if 0 < len(last) < len(layout.names):
            self._cut = self._text.cut()  # the recorder stopped while it wrote that row
        self._point, self._grouped = self._commas(decimal)
        self.repairs = tuple(self._remarks())

    def expect(self, names: Sequence[str]) -> None:
        self._tables.expect(names)

    def filled(self, names: Sequence[str]) -> NDArray[np.uint8]:
        names = tuple(names)
        self._filled.setdefault(names, None)
        if self._filled[names] is None:
            self._read(self._tables.missing())
        marks = self._filled[names]
        assert marks is not None
        return np.frombuffer(bytes(marks), np.uint8)

    def expect_filled(self, names: Sequence[str]) -> None:
        self._filled.setdefault(tuple(names), None)

    def only(self, first: int, last: int) -> None:
        self.offset, self._last = first, last

    def numbers(self, names: Sequence[str]) -> Array:
        names = tuple(names)
        if names not in self._tables:
            self._read(list(dict.fromkeys([names, *self._tables.missing()])))
        return self._tables.take(names)

    def _read(self, wanted: Sequence[Names]) -> None:
        """Fill these tables in one pass."""
        marks = {names: bytearray() for names, known in self._filled.items() if known is None}
        names = list(dict.fromkeys(name for table in (*wanted, *marks) for name in table))
        for name in names:
            if name not in self.header:
                problem = str(UnknownName("column", name, self.header))
                raise LogError(
                    self.path,
                    problem,
                    "name a column of its first row",
                    line=self._layout.names_line,
                )
        types = {name: pa.string() if name in self.clocks else pa.float64() for name in names}
        # its own handler of Ctrl-C would raise in the middle of the work (twin/stop.py)
        pa.enable_signal_handlers(False)
        tables = {table: array("d") for table in wanted}
        try:
            convert = arrow_csv.ConvertOptions(
                include_columns=names,
                column_types=types,
                null_values=list(BLANKS),
                decimal_point=self._point,
            )
            row = 0
            for batch in self._batches(convert):
                check()
                first, last = self.offset - row, min(self._last - row, batch.num_rows)
                row += batch.num_rows
                if last <= 0:
                    break
                kept = slice(max(first, 0), last)
                columns = {name: self._column(batch.column(name), name)[kept] for name in names}
                for table, rows in tables.items():
                    rows.frombytes(np.stack([columns[name] for name in table], axis=-1).tobytes())
                for table, rows in marks.items():
                    rows += filled_in(
                        np.stack([columns[name] for name in table], axis=-1)
                    ).tobytes()
        except pa.ArrowInvalid as problem:
            if "Empty CSV" not in str(problem):
                raise self._first_error(names) or LogError(
                    self.path, f"is no table of numbers ({problem})", "save it as CSV again"
                ) from None
        if self._again:
            self.repairs = tuple(self._remarks())
        if not any(tables.values()) and not any(marks.values()):
            raise LogError(
                self.path,
                "has column names but no rows",
                "check the export",
                line=self._layout.names_line,
            )
        self._tables.fill(tables)
        self._filled |= marks

    def _batches(self, convert: arrow_csv.ConvertOptions) -> Iterator[pa.Table]:
        """The table, some lines at a time.

        Arrow's threads let go of what they read from a moment after they are done. Of memory that
        belongs to Python that takes Python's lock, and a program that ends meanwhile is aborted: so
        the text lies in Arrow's own.
        """
        rest = b""
        for block in chain(_joined(self._blocks(), CHUNK), [None]):
            text = rest if block is None else rest + block
            end = len(text) if block is None else text.rfind(b"\n") + 1
            rest = text[end:]
            if not text[:end].strip():
                continue
            owned = pa.allocate_buffer(end)
            np.frombuffer(owned, dtype=np.uint8)[:] = np.frombuffer(text, np.uint8, end)
            yield arrow_csv.read_csv(
                pa.BufferReader(owned),
                read_options=arrow_csv.ReadOptions(column_names=self.header, block_size=BLOCK),
                parse_options=arrow_csv.ParseOptions(delimiter=self._delimiter),
                convert_options=convert,
            )

    @property
    def preamble(self) -> tuple[str, ...]:
        """Lines above the table that are not blank."""
        return self._layout.preamble

    def titles(self) -> list[str]:
        """Of the tables in the file, where it begins with one; programs for motion capture write
        several tables, each under its title and after a blank line."""
        first = next((line for line in self._text.lines(0, None) if line.strip()), "")
        if not _is_title(first):
            return []
        titles, above = list[str](), ""
        for line in self._text.lines(0, None):
            if not above.strip(" ,;\t") and _is_title(line):
                titles.append(line.strip(" ,;\t"))
            above = line
        return titles

    def beginning(self) -> "TextFile":
        """Of its first lines."""
        block = next(self._text.blocks(0, None), b"")
        if self._variable is not None or block.count(b"\n") < HEAD_LINES:
            return self
        return TextFile(self.path, None, self._decimal, content=block)

    def fault(self, problem: str, remedy: str, row: int | None = None) -> LogError:
        """A row stands on a line; blank lines are no rows."""
        line = None if row is None else self._row(row)[0]
        return LogError(self.path, problem, remedy, line=line)

    def not_finite(self, row: int, name: str, value: float) -> LogError:
        del value
        return self._not_finite(row, name, self._row(row)[1][self.header.index(name)].strip())

    @property
    def values(self) -> tuple[str, ...]:
        return tuple(name for name in super().values if name not in self._layout.empty)

    @property
    def _delimiter(self) -> str:
        return "\t" if self._layout.separator == " " else self._layout.separator

    def _column(self, column: pa.ChunkedArray, name: str) -> Array:
        if name not in self.clocks:
            return np.asarray(column.to_numpy(zero_copy_only=False))
        return seconds_of(column.to_pylist())

    def _blocks(self) -> Iterator[bytes]:
        """The rows, as the fast reader takes them."""
        self._again = 0
        progress = ReadProgress(self._say, self.path)
        for block in self._text.blocks(self._below, self._end, progress):
            if self._names and self._names in block:  # written again by a recorder that restarted
                block, count = _without_lines(block, self._names)
                self._again += count
            if self._lists:
                block = _opened(block, self._lists)
            if self._layout.separator == " ":
                block = re.sub(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)", b"", block)
                block = re.sub(rb"[ \t]+", b"\t", block)
            if self._behind is not None:
                block = self._behind.sub(b"", block)
            if self._grouped:
                block = re.sub(rb"(?<=\d),(?=\d{3})", b"", block)
            yield block

    def _commas(self, decimal: str | None) -> tuple[str, bool]:
        """The decimal mark, and whether commas group digits."""
        if self._layout.separator == ",":
            return ".", False
        if decimal is not None:
            return decimal, decimal == "."
        cell = _with_comma(self._layout.separator)
        unsure = b""
        for block in self._text.blocks(self._below, self._end):
            if b"," not in block:
                continue
            for number in cell.findall(block):
                if _DECIMAL.match(number):
                    return ",", False
                if _GROUPED.match(number):
                    return ".", True
                unsure = unsure or number
        if unsure:
            raise self.fault(
                f"holds {unsure.decode()!r}, with a decimal comma or with one of thousands",
                'write `decimal = ","` for the one, `decimal = "."` for the other',
                self._row_with(unsure.decode()),
            )
        return ".", False

    def _row_with(self, text: str) -> int:
        return next((i for i, (_, row) in enumerate(self._rows()) if text in row), 0)

    def _remarks(self) -> Iterator[str]:
        layout, name = self._layout, self.path.name
        if self._text.encoding != "utf-8":
            yield f"{name}: read as {self._text.encoding}"
        if layout.preamble:
            lines = f"{len(layout.preamble)} line{'s' * (len(layout.preamble) > 1)}"
            yield f"{name}: {lines} above the table ({_quoted(layout.preamble[0])}) left out"
        if not layout.named:
            yield f"{name}: no column names: numbered 1 to {len(layout.names)}"
        if self._grouped:
            yield f"{name}: commas of thousands left out"
        if self._again:
            lines = "line" if self._again == 1 else "lines"
            yield f"{name}: {self._again} {lines} of names between the rows left out"
        if self._cut:
            yield f"{name}:{self._cut}: a last row that was cut short left out"

    def _not_finite(self, row: int, name: str, text: str) -> LogError:
        if self._point == "," and is_finite(text):
            return self.fault(
                f"column {name!r} holds {_quoted(text)}, and other numbers have decimal commas",
                "write all alike, with points or with commas",
                row,
            )
        if is_date(text):
            return self.fault(
                f"column {name!r} holds {_quoted(text)}, a date",
                "name it as `time`, if it is the clock, or other `columns`",
                row,
            )
        return self.fault(
            f"column {name!r} holds {_quoted(text)}, which is no finite number",
            "write the number, or delete the row",
            row,
        )

    def _row(self, index: int) -> tuple[int, list[str]]:
        return next(islice(self._rows(), index, None))

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line (from 1) and cells of each row."""
        names = self._names.decode()
        if self._layout.separator == " ":
            for number, line in enumerate(
                self._text.lines(self._below, self._end), self._below + 1
            ):
                if line.strip() and line != names:
                    yield number, line.split()
            return
        lines = (
            "" if line == names else self._opened(line)
            for line in self._text.lines(self._below, self._end)
        )
        reader = csv.reader(lines, delimiter=self._layout.separator)
        try:
            for row in reader:
                if row:
                    yield self._below + reader.line_num, row
        except csv.Error as problem:
            raise LogError(
                self.path,
                f"is no row ({problem})",
                "save it as CSV again",
                line=self._below + reader.line_num,
            ) from None

    def _cells(self, line: str) -> list[str]:
        return split(self._opened(line), self._layout.separator)

    def _opened(self, line: str) -> str:
        """A line with the entries of its lists as cells of their own."""
        if not self._lists:
            return line
        return _opened(line.encode(), self._lists).decode()

    def _first_error(self, names: Sequence[str]) -> LogError | None:
        places = [(name, self.header.index(name)) for name in names]
        for index, (line, row) in enumerate(self._rows()):
            if len(row) != len(self.header):
                return LogError(
                    self.path,
                    f"is a row of {len(row)} under {len(self.header)} column names",
                    self._remedy(line, row),
                    line=line,
                )
            if index == 0 and self._layout.separator == "," and all(map(_has_comma, row)):
                return LogError(
                    self.path,
                    f"holds decimal commas, {_quoted(row[0])}",
                    "write decimal points, or separate the columns by semicolons",
                    line=line,
                )
            for name, place in places:
                if name not in self.clocks and not self._is_number(row[place]):
                    return self._not_finite(index, name, row[place].strip())
        return None

    def _remedy(self, line: int, row: Sequence[str]) -> str:
        """What would do about a row that is longer or shorter than the others."""
        if len(row) == 2 * len(self.header) and self._layout.separator == ",":
            return "write decimal points, or separate the columns by semicolons"
        if len(row) == len(self.header) + 1 and not row[-1].strip():
            return f"its last {self._layout.separator!r} ends no column: end all rows alike"
        before = next(islice(self._text.lines(line - 2, line - 1), 0, None), "")
        if not before.strip() and len(row) == 1:
            title = row[0].strip()
            return (
                f"a table of its own begins there: name it as `variable = {title!r}`, or delete it"
            )
        return "complete the row or delete it"

    def _is_number(self, text: str) -> bool:
        """Or none at all, as programs write it and the reader takes it."""
        if self._grouped:
            text = text.replace(",", "")
        if self._point == ",":
            text = text.replace(".", "?").replace(",", ".")
        return is_number(text) and unit_behind(text) in ("", *self._layout.behind)


class _Text:
    """The bytes of a text file, checked while they are read: no binary, no endless line, UTF-8."""

    def __init__(self, path: Path, content: bytes | None) -> None:
        self._path = path
        self._content = content
        self._mark, self.encoding = self._start()
        self.stop: int | None = None
        """Where the last row was cut short [bytes]; None where it is whole."""

    def head(self, variable: str | None) -> tuple[list[str], int]:
        """The first lines of the file, or of the table under a title; and the lines above them."""
        lines = self.lines(0, None)
        if variable is None:
            return list(islice(lines, HEAD_LINES)), 0
        titles = list[str]()
        for number, line in enumerate(lines, 1):
            title = line.strip(" ,;\t")
            if title == variable:
                table = list(islice(lines, HEAD_LINES))
                stop = next((i for i, item in enumerate(table) if not item.strip(" ,;\t")), None)
                return table[:stop], number
            if title and not re.search(r"[,;\t\d]", title):
                titles.append(title)
        listed = ", ".join(map(repr, titles[:20])) or "none"
        raise LogError(
            self._path, f"has no table {variable!r}", f"name one of its titles: {listed}"
        )

    def end_of_table(self, below: int) -> int:
        """The line (from 1) of the last row before a blank line; the file's last without one."""
        number = below
        for number, line in enumerate(self.lines(below, None), below + 1):
            if not line.strip(" ,;\t"):
                return number - 1
        return number

    def last_line(self) -> str:
        """What stands behind the last line break; empty where nothing does."""
        if self.encoding != "utf-8":
            return ""
        with self._open() as file:
            start = max(file.seek(0, io.SEEK_END) - LONGEST_LINE, 0)
            file.seek(start)
            tail = file.read()
        self._after = start + tail.rfind(b"\n") + 1
        return tail[self._after - start :].decode("utf-8", "replace") if b"\n" in tail else ""

    def cut(self) -> int:
        """Leave the last line out; its number."""
        self.stop = self._after
        return sum(block.count(b"\n") for block in self.blocks(0, None)) + 1

    def lines(self, skip: int, last: int | None) -> Iterator[str]:
        """Without their ends: from line skip + 1 to line last."""
        for block in self.blocks(skip, last):
            for line in block.decode().split("\n")[: None if not block.endswith(b"\n") else -1]:
                yield line.rstrip("\r")

    def blocks(
        self, skip: int, last: int | None, progress: ReadProgress | None = None
    ) -> Iterator[bytes]:
        """The same as pieces of UTF-8 that end with a line."""
        number = 0
        for block in self._whole_lines(progress):
            count = block.count(b"\n")
            self._check_text(block, number)
            start = _line_start(block, skip - number) if skip > number else 0
            stop = (
                None
                if last is None or last >= number + count
                else _line_start(block, last - number)
            )
            number += count
            if start < len(block) and (part := block[start:stop]):
                yield part
            if stop is not None:
                return

    def _whole_lines(self, progress: ReadProgress | None) -> Iterator[bytes]:
        carried = list[bytes]()
        for block in self._checked(progress):
            end = block.rfind(b"\n") + 1
            if end:
                yield b"".join([*carried, block[:end]])
                carried = []
            carried.append(block[end:])
        if rest := b"".join(carried):
            yield rest

    def _checked(self, progress: ReadProgress | None) -> Iterator[bytes]:
        """Blocks of the file; a binary one and an endless line are refused before the next."""
        line, length, binary = 1, 0, False
        for block in self._decoded(progress):
            first, ended, others = block.partition(b"\n")
            length, binary = length + len(first), binary or b"\0" in first
            if length >= LONGEST_LINE:
                raise LogError(
                    self._path,
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
        raise LogError(self._path, "is not text but binary", "export it as CSV", line=line)

    def _decoded(self, progress: ReadProgress | None) -> Iterator[bytes]:
        """In UTF-8, whatever the file is in."""
        decoder = codecs.getincrementaldecoder(self.encoding)("strict")
        with self._open() as file:
            size = file.seek(0, io.SEEK_END)
            file.seek(self._mark)
            left = None if self.stop is None else self.stop - self._mark
            while block := self._read(file, BLOCK if left is None else min(BLOCK, left)):
                left = None if left is None else left - len(block)
                if progress is not None:
                    progress.at(file.tell(), size)
                if self.encoding == "utf-8":
                    yield block
                    continue
                try:
                    text = decoder.decode(block)
                except UnicodeDecodeError:
                    raise LogError(
                        self._path, f"is not {self.encoding} text", "save it as CSV in UTF-8"
                    ) from None
                yield text.encode()

    def _check_text(self, block: bytes, above: int) -> None:
        try:
            block.decode()
        except UnicodeDecodeError as problem:
            line = above + block.count(b"\n", 0, problem.start) + 1
            raise LogError(
                self._path, "is not UTF-8 text", "save it as CSV in UTF-8", line=line
            ) from None

    def _start(self) -> tuple[int, str]:
        """Bytes of a mark before the text, and its encoding."""
        with self._open() as file:
            head = self._read(file, HEAD)
        for mark, encoding in _MARKS.items():
            if head.startswith(mark):
                return len(mark), encoding
        try:
            head.decode()
        except UnicodeDecodeError as problem:
            other = {byte for byte in head if byte > 0x7F}
            if problem.end < len(head) and other <= _WINDOWS:
                return 0, "cp1252"
        return 0, "utf-8"

    def _open(self) -> BinaryIO:
        if self._content is not None:
            return io.BytesIO(self._content)
        try:
            return self._path.open("rb")
        except OSError as problem:
            raise self._unreadable(problem) from None

    def _read(self, file: BinaryIO, size: int) -> bytes:
        try:
            return file.read(size)
        except OSError as problem:
            raise self._unreadable(problem) from None

    def _unreadable(self, problem: OSError) -> LogError:
        return LogError(self._path, f"cannot be read ({problem.strerror})", "check the path")


_MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}
_WINDOWS = set("°µ²³·±×äöüÄÖÜßéèàçñ".encode("cp1252"))
"""Letters of units and names as Windows programs write them."""


def _units_behind(units: Sequence[str]) -> re.Pattern[bytes] | None:
    """What cells have behind their numbers; None where they have nothing."""
    if not units:
        return None
    listed = "|".join(map(re.escape, units))
    return re.compile(rf"(?m)(?<=[\d.]) +(?:{listed})(?=[ \t]*(?:[\",;\t\r]|$))".encode())


def _without_lists(lines: list[str]) -> tuple[list[str], bytes]:
    """The first lines of a file, lists in their cells opened and named; and the separator of cells,
    empty where there is no list."""
    first = next((i for i, line in enumerate(lines) if _LIST.search(line.encode())), 0)
    beside = (
        re.search(r'(?:^|([,;\t]))"\[[^\]"]*\]"(?:$|([,;\t]))', lines[first]) if first else None
    )
    if beside is None:
        return lines, b""
    near = beside[1] or beside[2] or ","
    names, cells = (
        next(csv.reader([line], delimiter=near)) for line in lines[first - 1 : first + 1]
    )
    if len(names) != len(cells):
        return lines, b""
    opened: list[str] = []
    for name, cell in zip(names, cells, strict=True):
        count = len(cell[1:-1].split(",")) if cell[:1] == "[" and cell[-1:] == "]" else 0
        opened += [f"{name}[{i}]" for i in range(count)] or [name]
    heading = io.StringIO()
    csv.writer(heading, delimiter=near, lineterminator="").writerow(opened)
    lines = [
        *lines[: first - 1],
        heading.getvalue(),
        *(_opened(line.encode(), near.encode()).decode() for line in lines[first:]),
    ]
    return lines, near.encode()


def _opened(text: bytes, separator: bytes) -> bytes:
    """A text with the entries of its lists as cells of their own."""
    return _LIST.sub(lambda match: separator.join(map(bytes.strip, match[1].split(b","))), text)


def _without_lines(block: bytes, line: bytes) -> tuple[bytes, int]:
    """A block of whole lines without those that are one line again, and how many were."""
    lines = block.splitlines(keepends=True)
    kept = [item for item in lines if item.rstrip(b"\r\n") != line]
    return b"".join(kept), len(lines) - len(kept)


def _line_start(block: bytes, lines: int) -> int:
    """Where a line begins in a block, that many line ends from its start."""
    place = 0
    for _ in range(lines):
        place = block.find(b"\n", place) + 1
        if not place:
            return len(block)
    return place


def _joined(blocks: Iterator[bytes], size: int) -> Iterator[bytes]:
    """Blocks joined to at least a size, but for the last."""
    parts, total = list[bytes](), 0
    for block in blocks:
        parts.append(block)
        total += len(block)
        if total >= size:
            yield b"".join(parts)
            parts, total = [], 0
    if parts:
        yield b"".join(parts)


def _with_comma(separator: str) -> re.Pattern[bytes]:
    """Cells that are numbers with a comma, without their signs and exponents."""
    ends = rb" \t" if separator == " " else re.escape(separator).encode()
    spaces = b"" if separator == " " else b" *"
    start, stop = rb"(?:^|[" + ends + rb"\n])" + spaces, spaces + rb"(?=[" + ends + rb"\r\n]|$)"
    return re.compile(start + rb'"?[+-]?(\d[\d,]*,\d*\.?\d*|,\d+)(?:[eE][+-]?\d+)?"?' + stop)


def _is_title(line: str) -> bool:
    """Whether a line is a word or two, and no row of a table."""
    text = line.strip(" ,;\t")
    return bool(text) and not re.search(r"[,;\t\d]", text) and len(text) < 40


def _has_comma(text: str) -> bool:
    return "," in text and is_number(text.replace(",", "."))


def _quoted(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:40] + "...") if text else "nothing"
