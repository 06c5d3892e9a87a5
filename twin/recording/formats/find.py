"""The right reader for a file, each file read once for all the streams that are in it."""

from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from twin.library import Registry
from twin.recording.formats.array_file import NumberFile, Say, silent
from twin.recording.formats.dataflash_file import is_dataflash, read_dataflash

if TYPE_CHECKING:
    from twin.recording.formats.array_file import Variables
    from twin.recording.formats.topic import Messages

TEXTS = (".csv", ".tsv", ".txt", ".log", ".dat", ".asc", ".lvm")
"""Of files with a table in text."""
ARRAYS = (".mat", ".h5", ".hdf5", ".hdf", ".npy", ".npz", ".tdms", ".ulg", ".bin", ".xlsx")
"""Of files with arrays, topics or sheets by name, one of which `variable` picks."""
TOPICS = (".mcap", ".bag", ".db3")
"""Of files with messages."""
COLUMNS = (".parquet", ".feather", ".arrow", ".jsonl", ".ndjson")
"""Of files that PyArrow reads as columns."""
Reader = Callable[[Path], Mapping[str, ArrayLike]]
"""Arrays by name, (m,) or (m, k), of a file."""


def _callable(brought: Any) -> Reader | None:
    return cast(Reader, brought) if callable(brought) else None


READERS: Registry[Reader] = Registry("twin.readers", {}, _callable)
"""Of installed packages: an ending without its dot -> what gives the arrays of such a file."""
ENDINGS = (*TEXTS, *COLUMNS, *ARRAYS, *TOPICS, *(f".{ending}" for ending in READERS))
"""Of the files that can be read."""

_T = TypeVar("_T")


class OpenFiles:
    """The files of one log."""

    def __init__(self, say: Say = silent) -> None:
        """None is open yet; `say` takes a line of progress where reading takes long."""
        self._read: dict[Hashable, object] = {}
        self._say = say

    def open(
        self,
        path: Path,
        *,
        unit: str,
        variable: str | None = None,
        topic: str | None = None,
        decimal: str | None = None,
    ) -> NumberFile:
        """The columns in a file of one of the ENDINGS.

        Args:
            path: the file.
            unit: SI unit of the stream: of a ROS 2 message it takes the field in that unit.
            variable: of a file of arrays; a sheet; the title of one of several tables in a text.
            topic: of a file of messages.
            decimal: the decimal mark of a text file, where it leaves that open.

        Raises:
            LogError: it cannot be read.
        """
        match path.suffix.lower():
            case ending if ending in TEXTS and not is_dataflash(path):
                key = path, variable, decimal
                return self._once(key, lambda: _text(path, variable, decimal, self._say))
            case ending if ending in COLUMNS:
                from twin.recording.formats.parquet_file import ParquetFile

                return self._once(path, lambda: ParquetFile(path))
            case ".xlsx":
                from twin.recording.formats.excel_file import read_sheet
                from twin.recording.formats.text_file import TextFile

                return self._once(
                    (path, variable), lambda: TextFile(path, content=read_sheet(path, variable))
                )
            case ending if ending in (*ARRAYS, *TEXTS) or ending[1:] in READERS:
                from twin.recording.formats.array_file import ArrayFile

                variables = self._once(path, lambda: _variables(path))
                return ArrayFile(path, variables, variable)
            case ending if ending in TOPICS:
                from twin.recording.formats.message_file import MessageFile

                messages = self.messages(path)
                readers = self._once((path, MessageFile), list[MessageFile])
                return MessageFile(messages, messages.topic(topic), unit, readers)
            case ending:
                raise ValueError(f"no reader for {ending}")

    def messages(self, path: Path) -> "Messages":
        """The messages of a file of one of the TOPICS.

        Raises:
            LogError: it cannot be read.
        """
        if path.suffix.lower() == ".mcap":
            from twin.recording.formats.topic import McapMessages

            return self._once(path, lambda: McapMessages(path, self._say))
        from twin.recording.formats.topic import BagMessages

        return self._once(path, lambda: BagMessages(path, self._say))

    def _once(self, key: Hashable, read: Callable[[], _T]) -> _T:
        if key not in self._read:
            self._read[key] = read()
        return self._read[key]  # pyright: ignore[reportReturnType]


def _text(path: Path, variable: str | None, decimal: str | None, say: Say) -> NumberFile:
    from twin.recording.formats.text_file import TextFile
    from twin.recording.formats.text_layout import captured

    return TextFile(path, variable, decimal, content=captured(path), say=say)


def _variables(path: Path) -> "Variables":
    match path.suffix.lower():
        case ".npy" | ".npz":
            from twin.recording.formats.numpy_file import read_numpy

            return read_numpy(path)
        case ending if ending == ".bin" or ending in TEXTS:
            return read_dataflash(path)
        case ".mat":
            from twin.recording.formats.mat_file import read_variables

            return read_variables(path)
        case ".tdms":
            from twin.recording.formats.tdms_file import read_tdms

            return read_tdms(path)
        case ".ulg":
            from twin.recording.formats.ulog_file import read_ulog

            return read_ulog(path)
        case ending if ending[1:] in READERS:
            return _read_by_package(READERS[ending[1:]], path)
        case _:
            from twin.recording.formats.hdf5_file import read_hdf5

            return read_hdf5(path)


def _read_by_package(reader: Reader, path: Path) -> "Variables":
    """What an installed package's reader gives, as arrays of numbers."""
    from twin.recording.formats.array_file import Variables, library_errors

    with library_errors(path, f"a {path.suffix} file", "look at the package that reads such files"):
        arrays = {name: np.asarray(values) for name, values in reader(path).items()}
        wrong = [name for name, values in arrays.items() if values.dtype.kind not in "biuf"]
        wrong += [name for name, values in arrays.items() if values.ndim not in (1, 2)]
        if wrong:
            raise ValueError(f"its reader gives no column or matrix of numbers as {wrong[0]!r}")
    return Variables(arrays, {})
