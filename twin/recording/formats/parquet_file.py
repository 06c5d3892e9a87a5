"""A Parquet or Feather file, or JSON a line; the fields of a struct are columns by dotted names."""

import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.formats.array_file import NumberFile, check_unpacked, library_errors

Array = NDArray[np.float64]

_KINDS = {".parquet": "Parquet", ".feather": "Feather", ".arrow": "Arrow"}
_REMEDY = "write it again"
WORD = 8
"""Of a number [bytes]."""
MOST_COLUMNS = 10_000
_ARROW = b"ARROW1"
_KEY = re.compile(rb'"((?:[^"\\]|\\.){0,200})"\s*:')
_TICKS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Ticks a second of Arrow's time units."""


class ParquetFile(NumberFile):
    """Such a file in memory. Columns of timestamps and durations are in seconds."""

    def __init__(self, path: Path) -> None:
        """Read it.

        Raises:
            LogError: it is no such file, is damaged, or has no rows.
        """
        self._kind = _KINDS.get(path.suffix.lower(), "JSON with a row a line")
        with library_errors(path, self._kind, _REMEDY):
            table = _table_in(path)
            while any(pa.types.is_struct(column.type) for column in table.columns):
                table = table.flatten()
        if table.num_rows == 0 or table.num_columns == 0:
            raise LogError(path, "has no rows", "check the export")
        for name in table.column_names:
            if table.column_names.count(name) > 1:
                raise LogError(path, f"names two columns {name!r}", "give each its own name")
        self._table = table
        clocks = [name for name, kind in _kinds(table) if _is_time(kind)]
        super().__init__(path, table.column_names, clocks)

    @property
    def time(self) -> str:
        """The first column, or the only one that is a time by its type: an index comes last."""
        only = len(self.clocks) == 1
        return self.clocks[0] if only else super().time

    @property
    def values(self) -> tuple[str, ...]:
        return self.header

    def numbers(self, names: Sequence[str]) -> Array:
        with library_errors(self.path, self._kind, _REMEDY):
            return np.stack([self._numbers(self.find(name)) for name in names], axis=-1)

    def _numbers(self, name: str) -> Array:
        column = self._table.column(name)
        kind = column.type
        if pa.types.is_dictionary(kind):
            kind = kind.value_type
        if _is_time(kind):
            ticks = pc.cast(column, pa.int64()).to_numpy()
            return np.asarray(ticks, dtype=np.float64) / _TICKS[kind.unit]
        if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or _is_exact(kind)):
            raise self.fault(
                f"column {name!r} holds {kind}, no numbers", "name others in `columns`"
            )
        return np.asarray(pc.cast(column, pa.float64(), safe=False).to_numpy())


def _table_in(path: Path) -> pa.Table:
    match path.suffix.lower():
        case ".parquet":
            from pyarrow import parquet

            with parquet.ParquetFile(path) as file:
                check_unpacked(path, _decoded_size(file.metadata))
                texts = [item.path for item in file.schema if item.physical_type == "BYTE_ARRAY"]
            # one text that stands in each row is one text in the memory, too
            with parquet.ParquetFile(path, read_dictionary=texts) as file:
                return file.read()
        case ".feather" | ".arrow":
            from pyarrow import feather

            check_unpacked(path, _unpacked_size(path))
            return feather.read_table(path)
        case _:
            from pyarrow import json

            _check_keys(path)
            return json.read_json(path)


def _decoded_size(metadata: Any) -> int:
    """Of a Parquet file's columns: entries of lists are values, and a repeated one is stored once
    [bytes]."""
    chunks = [
        metadata.row_group(group).column(column)
        for group in range(metadata.num_row_groups)
        for column in range(metadata.num_columns)
    ]
    return sum(max(chunk.total_uncompressed_size, WORD * chunk.num_values) for chunk in chunks)


def _unpacked_size(path: Path) -> int:
    """Of the compressed buffers of an Arrow file, each of which begins with its size [bytes]."""
    total = 0
    with pa.memory_map(str(path)) as file:
        if not file.read(len(_ARROW)).startswith(_ARROW):
            return 0  # Feather's first version, which compresses nothing, or no such file
        file.seek(8)
        for message in pa.ipc.MessageReader.open_stream(file):
            body = message.body
            if body is None or message.type not in ("record batch", "dictionary"):
                continue
            places = _compressed(memoryview(message.metadata), message.type == "dictionary")
            for place, size in places:
                if size >= WORD:
                    total += max(
                        int.from_bytes(body[place : place + WORD], "little", signed=True), 0
                    )
    return total


def _compressed(metadata: memoryview, dictionary: bool) -> list[tuple[int, int]]:
    """Places and sizes of the compressed buffers in the body of an Arrow message [bytes], by its
    header (github.com/apache/arrow, format/Message.fbs); none of one that is not compressed."""

    def number(kind: str, place: int) -> int:
        return int(struct.unpack_from(f"<{kind}", metadata, place)[0])

    def field(table: int, index: int) -> int:
        """The place of a field of a flatbuffer's table; 0 where it is not there."""
        names = table - number("i", table)
        offset = number("H", names + 4 + 2 * index) if 4 + 2 * index < number("H", names) else 0
        return table + offset if offset else 0

    def behind(place: int) -> int:
        return place + number("I", place)

    batch = behind(field(behind(0), 2))
    if dictionary:
        batch = behind(field(batch, 1))
    if not field(batch, 3):
        return []
    buffers = behind(field(batch, 2))
    return [
        (number("q", buffers + 4 + 16 * i), number("q", buffers + 12 + 16 * i))
        for i in range(number("I", buffers))
    ]


def _check_keys(path: Path) -> None:
    """Refuse JSON whose table would fill the memory: each key is a column of as many rows."""
    keys, rows = set[bytes](), 0
    with path.open("rb") as file:
        for line in file:
            rows += 1
            keys.update(_KEY.findall(line))
            if len(keys) > MOST_COLUMNS:
                raise LogError(
                    path, f"has more than {MOST_COLUMNS} keys", "write those of the log only"
                )
    check_unpacked(path, WORD * rows * len(keys))


def _kinds(table: pa.Table) -> list[tuple[str, pa.DataType]]:
    return [(field.name, field.type) for field in table.schema]


def _is_time(kind: pa.DataType) -> bool:
    return pa.types.is_timestamp(kind) or pa.types.is_duration(kind)


def _is_exact(kind: pa.DataType) -> bool:
    return pa.types.is_boolean(kind) or pa.types.is_decimal(kind)
