"""A sheet of an Excel file with openpyxl, as the text that it would be exported as."""

from collections.abc import Iterator
from contextlib import closing
from datetime import datetime, time
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

from twin.errors import LogError
from twin.recording.formats.array_file import check_unpacked, imported, library_errors


def read_sheet(path: Path, name: str | None) -> bytes:
    """The rows of a sheet, cells separated by tabs; without a name, of the first one.

    Raises:
        LogError: it is no Excel file, has no such sheet, or openpyxl is not installed.
    """
    openpyxl = imported("openpyxl", path)
    try:
        with path.open("rb") as file, ZipFile(file) as parts:
            size = sum(part.file_size for part in parts.infolist())
    except (BadZipFile, NotImplementedError, OSError):  # said below
        size = 0
    check_unpacked(path, size)
    with (
        library_errors(path, "Excel", "export it as CSV"),
        path.open("rb") as file,
        closing(openpyxl.load_workbook(file, read_only=True, data_only=True)) as book,
    ):
        if name is not None and name not in book.sheetnames:
            listed = ", ".join(map(repr, book.sheetnames))
            raise LogError(path, f"has no sheet {name!r}", f"name one of {listed} in `variable`")
        return b"".join(_lines(book[name] if name is not None else book.worksheets[0]))


def _lines(sheet: Any) -> Iterator[bytes]:
    for row in sheet.iter_rows(values_only=True):
        yield ("\t".join(map(_text, row)) + "\n").encode()


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, datetime | time):
        return cell.isoformat(sep=" ") if isinstance(cell, datetime) else cell.isoformat()
    if isinstance(cell, bool):
        return str(int(cell))
    return repr(cell) if isinstance(cell, float) else " ".join(str(cell).split())
