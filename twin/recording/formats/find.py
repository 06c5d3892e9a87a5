"""The right reader for a file, each file read once for all the streams that are in it."""

from collections.abc import Callable, Hashable
from pathlib import Path
from typing import TypeVar

from twin.recording.formats.number_file import NumberFile

ENDINGS = (".csv", ".parquet", ".mat", ".mcap")
"""Of the files that can be read."""

_T = TypeVar("_T")


class OpenFiles:
    """The files of one log."""

    def __init__(self) -> None:
        self._read: dict[Hashable, object] = {}

    def open(
        self, path: Path, *, unit: str, variable: str | None = None, topic: str | None = None
    ) -> NumberFile:
        """The columns in a file of one of the ENDINGS.

        Args:
            path: the file.
            unit: SI unit of the stream: of a ROS 2 message it takes the field in that unit.
            variable: of a MAT file.
            topic: of an MCAP file.

        Raises:
            LogError: it cannot be read.
        """
        match path.suffix.lower():
            case ".csv":
                from twin.recording.formats.csv_file import CsvFile

                return self._once(path, lambda: CsvFile(path))
            case ".parquet":
                from twin.recording.formats.parquet_file import ParquetFile

                return self._once(path, lambda: ParquetFile(path))
            case ".mat":
                from twin.recording.formats.mat_file import MatFile, read_variables

                return MatFile(path, self._once(path, lambda: read_variables(path)), variable)
            case ".mcap":
                from twin.recording.formats.mcap_file import McapFile
                from twin.recording.formats.mcap_topic import read_topic

                return McapFile(self._once((path, topic), lambda: read_topic(path, topic)), unit)
            case ending:
                raise ValueError(f"no reader for {ending}")

    def _once(self, key: Hashable, read: Callable[[], _T]) -> _T:
        if key not in self._read:
            self._read[key] = read()
        return self._read[key]  # pyright: ignore[reportReturnType]
