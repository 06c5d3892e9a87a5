"""The messages of a ROS 1 bag (`.bag`) or a ROS 2 bag (`.db3`), with rosbags."""

import struct
from collections.abc import Collection, Generator, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from twin.errors import LogError
from twin.recording.formats.extras import SMALL, UNPACKED, imported
from twin.recording.formats.one_pass import Progress, Say, silent
from twin.recording.formats.topic import CHECKED, Message, Messages, Topic
from twin.stop import Stopped, check

_MESSAGE = b"\x02"
"""Kind of a record of a ROS 1 bag."""
_WORD, _TIME = struct.Struct("<I"), struct.Struct("<II")


class BagMessages(Messages):
    """A bag."""

    def __init__(self, path: Path, say: Say = silent) -> None:
        """Read what the bag says of its topics.

        Raises:
            LogError: no bag, or rosbags is not installed.
        """
        super().__init__(path, say)
        with _opened(path) as reader:
            self._kinds: dict[str, set[str]] = {}
            for one in reader.connections:
                self._kinds.setdefault(one.topic, set()).add(one.msgtype)
            self._types_known, self._is2 = reader.typestore, reader.is2

    def types(self) -> Mapping[str, str]:
        return {topic: _plain(max(kinds)) for topic, kinds in self._kinds.items()}

    def topic(self, name: str | None) -> Topic:
        types = self.types()
        if not types:
            raise LogError(self.path, "holds no topic", "record it again")
        listed = ", ".join(f"{topic} ({types[topic]})" for topic in sorted(types))
        if name is None and len(types) == 1:
            (name,) = types
        if name is None or name not in types:
            problem = "holds several topics" if name is None else f"has no topic {name!r}"
            raise LogError(self.path, problem, f"name one of its topics in `topic`: {listed}")
        kinds = self._kinds[name]
        if len(kinds) > 1:
            raise LogError(
                self.path,
                f"has messages of several types on {name}: {', '.join(map(_plain, sorted(kinds)))}",
                "record them on topics of their own",
            )
        (kind,) = kinds
        known = self._types_known
        decode = known.deserialize_cdr if self._is2 else known.deserialize_ros1
        return Topic(
            path=self.path,
            name=name,
            encoding="cdr" if self._is2 else "ros1",
            type=_plain(kind),
            decode=lambda message: decode(message, kind),
        )

    def messages(
        self, topics: Collection[str] | None = None, say: Say = silent
    ) -> Generator[Message]:
        progress = Progress(say, self.path)
        with _opened(self.path) as reader:
            asked = [one for one in reader.connections if topics is None or one.topic in topics]
            if self._is2 and asked:
                count = sum(one.msgcount for one in asked)
                passed = enumerate(reader.messages(connections=asked))
                for number, (connection, time, message) in passed:
                    if number % CHECKED == 0:
                        check()
                        progress.at(number, count)
                    yield Message(connection.topic, bytes(message), time, time)
            elif asked:
                names = {one.id: one.topic for one in asked}
                (bag,) = reader.readers
                chunks = sorted(bag.chunk_infos, key=lambda one: (one.start_time, one.pos))
                for number, one in enumerate(chunks):
                    check()
                    progress.at(number, len(chunks))
                    yield from _in_chunk(self.path, bag, bag.chunks[one.pos], names)


def _in_chunk(path: Path, bag: Any, chunk: Any, names: Mapping[int, str]) -> Iterator[Message]:
    """The messages in a chunk of a ROS 1 bag, in the order of their times.

    Args:
        path: of the bag.
        bag: rosbags' reader of it.
        chunk: where the chunk is, and how it is compressed.
        names: topics by the numbers of the connections that are read.
    """
    bag.bio.seek(chunk.datapos)
    data = _unpacked(path, bag.bio.read(chunk.datasize), chunk.decompressor)
    found: list[tuple[int, int, int, int]] = []
    place = 0
    while place < len(data):
        (size,) = _WORD.unpack_from(data, place)
        fields = dict(_fields(data[place + _WORD.size : place + _WORD.size + size]))
        place += _WORD.size + size
        (size,) = _WORD.unpack_from(data, place)
        start = place + _WORD.size
        place = start + size
        if place > len(data):
            raise ValueError("a record is longer than its chunk")
        if fields[b"op"] != _MESSAGE:
            continue
        (connection,) = _WORD.unpack(fields[b"conn"])
        if connection in names:
            seconds, nanoseconds = _TIME.unpack(fields[b"time"])
            found.append((10**9 * seconds + nanoseconds, start, place, connection))
    for time, start, stop, connection in sorted(found):
        yield Message(names[connection], data[start:stop], time, time)


def _fields(header: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Names and values in the header of a record."""
    place = 0
    while place < len(header):
        (size,) = _WORD.unpack_from(header, place)
        place += _WORD.size
        name, _, value = header[place : place + size].partition(b"=")
        yield name, value
        place += size


def _unpacked(path: Path, data: bytes, decompressor: Any) -> bytes:
    """What a chunk holds, unless that would fill the memory."""
    known = imported("rosbags.rosbag1.reader", path).decompressors
    if decompressor is known["none"]:
        return data
    module = "bz2" if decompressor is known["bz2"] else "lz4.frame"
    unpacker = imported(module, path)
    make = unpacker.BZ2Decompressor if module == "bz2" else unpacker.LZ4FrameDecompressor
    most = max(SMALL, UNPACKED * len(data))
    unpacked = make().decompress(data, max_length=most + 1)
    if len(unpacked) > most:
        raise LogError(
            path,
            f"has a chunk of {len(data)} bytes that would unpack to more than {most >> 20} MiB",
            "copy it again from where it was recorded",
        )
    return unpacked


@contextmanager
def _opened(path: Path) -> Generator[Any]:
    highlevel = imported("rosbags.highlevel", path)
    typesys = imported("rosbags.typesys", path)
    # bags of ROS 2 did not carry their types before Iron
    usual = typesys.get_typestore(typesys.Stores.LATEST)
    try:
        reader = highlevel.AnyReader([path], default_typestore=usual)
        if path.suffix.lower() == ".bag":
            reader.readers = [_without_index(path)]
        with reader:
            yield reader
    except (LogError, Stopped, GeneratorExit):
        raise
    except Exception as problem:  # on damaged bytes the reader raises what its parts raise
        text = str(problem).split("\n", 1)[0] or type(problem).__name__
        remedy = "copy it again from where it was recorded"
        if path.suffix.lower() == ".bag":
            remedy += ", or repair it with `rosbag reindex`"
        raise LogError(path, f"cannot be read as a ROS bag ({text})", remedy) from None


def _without_index(path: Path) -> Any:
    """A reader of a ROS 1 bag that leaves out the places of its messages: rosbags would hold those
    of all of them, 300 bytes each, to read them one by one."""
    bag = imported("rosbags.rosbag1", path).Reader(path)
    bag.read_index_data = lambda pos, indexes: None  # pyright: ignore[reportUnknownLambdaType]
    return bag


def _plain(kind: str) -> str:
    return kind.replace("/msg/", "/")
