"""Files of messages, ROS bags and MCAP: topics, and passes over the messages on some of them."""

import contextlib
import io
import json
import struct
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import InvalidMagic
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Schema
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader

from twin.errors import LogError
from twin.recording.formats.array_file import SMALL, UNPACKED, ReadProgress, Say, imported, silent
from twin.stop import Stopped, check

FIRST = 2000
"""Messages that a look at a topic needs."""
FIRST_BYTES = 4 << 20
"""And their size at most, beyond the first message [bytes]."""
CHECKED = 1000
"""Messages between two looks whether to stop."""


class TopicMessage(NamedTuple):
    """As recorded."""

    topic: str
    data: bytes
    log_time: int
    """[ns]"""
    publish_time: int
    """[ns]"""


@dataclass(frozen=True)
class Topic:
    """What the messages on a topic are."""

    path: Path
    name: str
    encoding: str
    """"cdr" (ROS 2), "ros1", "json" or "protobuf"."""
    type: str
    """Name of the messages' type, ROS's without `msg/`; empty without one."""
    decode: Callable[[bytes], Any]
    """A message -> an object with attributes (ROS, protobuf), or what JSON gives."""

    @property
    def ros(self) -> bool:
        """Whether these are messages of ROS, whose numbers have names and types."""
        return self.encoding in ("cdr", "ros1")

    def decoded(self, message: TopicMessage, number: int) -> Any:
        """A message, the one of that number (from 1).

        Raises:
            LogError: it cannot be decoded; says which.
        """
        try:
            return self.decode(message.data)
        except Exception as problem:  # decoders raise what their parts raise
            raise LogError(
                self.path,
                f"message {number} on {self.name} cannot be decoded ({_short(problem)})",
                "record it again",
            ) from None


class Messages(ABC):
    """All messages of a file. None is kept: each pass reads the file from its beginning."""

    def __init__(self, path: Path, say: Say = silent) -> None:
        self.path = path
        self.whole = True
        """False when a pass found that the file ends in the middle, or is damaged there."""
        self._say = say
        self._ahead: Generator[TopicMessage] | None = None
        self._first: dict[str, TopicMessage] = {}
        self._beginnings: dict[str, list[TopicMessage]] = {}

    @abstractmethod
    def types(self) -> Mapping[str, str]:
        """Topics and the names of their types.

        Raises:
            LogError: the file cannot be read.
        """

    @abstractmethod
    def topic(self, name: str | None) -> Topic:
        """A topic; without a name, the only one.

        Raises:
            LogError: no such topic, or one that is not read; with the topics.
        """

    @abstractmethod
    def messages(
        self, topics: Collection[str] | None = None, say: Say = silent
    ) -> Generator[TopicMessage]:
        """One pass over the messages on these topics; on all of them without any."""

    def read(self, topics: Collection[str]) -> Iterator[TopicMessage]:
        """The pass that is told to who waits for it."""
        if self._ahead is not None:
            self._ahead.close()
            self._ahead = None
        return self.messages(topics, self._say)

    def first(self, topic: str) -> TopicMessage | None:
        """The first message on a topic; None where there is none.

        It is looked for once for all topics, from the beginning on and no further than needed.
        """
        if self._ahead is None and topic not in self._first:
            self._ahead = self.messages()
        while topic not in self._first:
            message = next(self._ahead, None) if self._ahead is not None else None
            if message is None:
                return None
            self._first.setdefault(message.topic, message)
        return self._first[topic]

    def look(self, topics: Collection[str]) -> None:
        """Read the beginnings of these topics in one pass, which ends when each has enough."""
        result: dict[str, list[TopicMessage]] = {name: [] for name in topics}
        room = dict.fromkeys(topics, FIRST_BYTES)
        waiting = set(topics)
        for message in self.messages(topics) if topics else ():
            name = message.topic
            if name not in waiting:
                continue
            result[name].append(message)
            room[name] -= len(message.data)
            if len(result[name]) == FIRST or room[name] < 0:
                waiting.remove(name)
            if not waiting:
                break
        self._beginnings |= result
        self._first |= {name: messages[0] for name, messages in result.items() if messages}

    def beginning(self, topic: Topic) -> "Messages":
        """The first messages on a topic."""
        if topic.name not in self._beginnings:
            self.look([topic.name])
        return _Beginning(topic, self._beginnings[topic.name])


class _Beginning(Messages):
    """The first messages on one topic, in memory."""

    def __init__(self, topic: Topic, messages: Sequence[TopicMessage]) -> None:
        super().__init__(topic.path)
        self._topic, self._messages = topic, messages

    def types(self) -> Mapping[str, str]:
        return {self._topic.name: self._topic.type}

    def topic(self, name: str | None) -> Topic:
        return self._topic

    def messages(
        self, topics: Collection[str] | None = None, say: Say = silent
    ) -> Generator[TopicMessage]:
        yield from self._messages


def _short(problem: Exception) -> str:
    """An error's first line."""
    return str(problem).split("\n", 1)[0] or type(problem).__name__


_BAG_MESSAGE = b"\x02"
"""Kind of a record of a ROS 1 bag."""
_ZSTD = b"\x28\xb5\x2f\xfd"
"""Begins what Zstandard has compressed."""
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
            for connection in reader.connections:
                self._kinds.setdefault(connection.topic, set()).add(connection.msgtype)
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
    ) -> Generator[TopicMessage]:
        progress = ReadProgress(say, self.path)
        with _opened(self.path) as reader:
            asked = [item for item in reader.connections if topics is None or item.topic in topics]
            if self._is2 and asked:
                count = sum(item.msgcount for item in asked)
                passed = enumerate(reader.messages(connections=asked))
                for number, (connection, time, message) in passed:
                    if number % CHECKED == 0:
                        check()
                        progress.at(number, count)
                    data = _unpacked_message(self.path, bytes(message))
                    yield TopicMessage(connection.topic, data, time, time)
            elif asked:
                names = {item.id: item.topic for item in asked}
                (bag,) = reader.readers
                chunks = sorted(bag.chunk_infos, key=lambda info: (info.start_time, info.pos))
                for number, chunk in enumerate(chunks):
                    check()
                    progress.at(number, len(chunks))
                    yield from _in_chunk(self.path, bag, bag.chunks[chunk.pos], names)


def _unpacked_message(path: Path, data: bytes) -> bytes:
    """A message of a bag of ROS 2, which may be compressed by itself; CDR begins otherwise."""
    if not data.startswith(_ZSTD):
        return data
    library = imported("zstandard", path)
    most = max(SMALL, UNPACKED * len(data))
    with library.ZstdDecompressor().stream_reader(data) as reader:
        unpacked = reader.read(most + 1)
    if len(unpacked) > most:
        raise LogError(
            path,
            f"has a message of {len(data)} bytes that would unpack to more than {most >> 20} MiB",
            "copy it again from where it was recorded",
        )
    return unpacked


def _in_chunk(path: Path, bag: Any, chunk: Any, names: Mapping[int, str]) -> Iterator[TopicMessage]:
    """The messages in a chunk of a ROS 1 bag, in the order of their times.

    Args:
        path: of the bag.
        bag: rosbags' reader of it.
        chunk: where the chunk is, and how it is compressed.
        names: topics by the numbers of the connections that are read.
    """
    bag.bio.seek(chunk.datapos)
    data = _bag_chunk(path, bag.bio.read(chunk.datasize), chunk.decompressor)
    result: list[tuple[int, int, int, int]] = []
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
        if fields[b"op"] != _BAG_MESSAGE:
            continue
        (connection,) = _WORD.unpack(fields[b"conn"])
        if connection in names:
            seconds, nanoseconds = _TIME.unpack(fields[b"time"])
            result.append((10**9 * seconds + nanoseconds, start, place, connection))
    for time, start, stop, connection in sorted(result):
        yield TopicMessage(names[connection], data[start:stop], time, time)


def _fields(header: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Names and values in the header of a record."""
    place = 0
    while place < len(header):
        (size,) = _WORD.unpack_from(header, place)
        place += _WORD.size
        name, _, value = header[place : place + size].partition(b"=")
        yield name, value
        place += size


def _bag_chunk(path: Path, data: bytes, decompressor: Any) -> bytes:
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


LARGEST_RECORD = 1 << 30
"""A longer record is damage, not data [bytes]."""

_AGAIN = "copy it again from where it was recorded"
_HEAD, _MCAP_MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
"""Of a record: its kind and length. Of a message: channel, number, and when it was logged and
published."""

_Channels = dict[int, tuple[Channel, Schema | None]]


class McapMessages(Messages):
    """An MCAP file. Its channels are those that its summary lists, else those of a whole pass."""

    def __init__(self, path: Path, say: Say = silent) -> None:
        """Read the summary, where there is one.

        Raises:
            LogError: no MCAP file.
        """
        super().__init__(path, say)
        self._channels: _Channels = {}
        self._scanned = False
        try:
            with path.open("rb") as file:
                summary = SeekingReader(file, record_size_limit=_largest(path)).get_summary()
        except OSError as problem:
            raise _unreadable(path, problem) from None
        except Exception:  # damaged, or cut short: the pass says what is whole
            summary = None
        if summary is not None:
            schemas = summary.schemas
            self._channels = {
                key: (channel, schemas.get(channel.schema_id))
                for key, channel in summary.channels.items()
            }

    def types(self) -> Mapping[str, str]:
        if not self._channels:
            self._scan()
        return {channel.topic: _name(schema) for channel, schema in self._channels.values()}

    def topic(self, name: str | None) -> Topic:
        known = {channel.topic for channel, _ in self._channels.values()}
        if not known or (name is not None and name not in known):
            self._scan()
        if not self._channels:
            problem = "holds no topic" if self.whole else "is cut short before its first message"
            raise LogError(self.path, problem, _AGAIN)
        types = {channel.topic: (channel, schema) for channel, schema in self._channels.values()}
        listed = ", ".join(f"{topic} ({_type(*types[topic])})" for topic in sorted(types))
        choice = f"name one of its topics in `topic`: {listed}"
        if name is None and len(types) == 1:
            (name,) = types
        if name is None or name not in types:
            problem = "holds several topics" if name is None else f"has no topic {name!r}"
            raise LogError(self.path, problem, choice)
        channel, schema = types[name]
        try:
            with contextlib.redirect_stderr(io.StringIO()):  # what a parser prints is said below
                decode = _decoder(channel, schema)
        except Exception as problem:  # a damaged schema: the parsers raise what their parts raise
            raise LogError(
                self.path, f"has a damaged schema for {name} ({problem})", _AGAIN
            ) from None
        if decode is None:
            kind = _type(channel, schema)
            raise LogError(self.path, f"topic {name} is of type {kind}, which is not read", choice)
        return Topic(self.path, name, channel.message_encoding, _name(schema), decode)

    def messages(
        self, topics: Collection[str] | None = None, say: Say = silent
    ) -> Generator[TopicMessage]:
        schemas: dict[int, Schema] = {}
        channels: _Channels = {}
        progress = ReadProgress(say, self.path)
        size = self.path.stat().st_size
        try:
            with self.path.open("rb") as file:
                for record in _records(self.path, file, progress, size):
                    if isinstance(record, Schema):
                        schemas.setdefault(record.id, record)
                    elif isinstance(record, Channel):
                        item = record, schemas.get(record.schema_id)
                        channels.setdefault(record.id, item)
                        self._channels.setdefault(record.id, item)
                    elif isinstance(record, Record):
                        topic = channels[record.channel_id][0].topic
                        if topics is None or topic in topics:
                            yield TopicMessage(
                                topic, record.data, record.log_time, record.publish_time
                            )
        except InvalidMagic:
            raise LogError(self.path, "is no MCAP file", "record or export it as MCAP") from None
        except OSError as problem:
            raise _unreadable(self.path, problem) from None
        except (LogError, Stopped, GeneratorExit):
            raise
        except Exception:  # on damaged bytes the reader raises what its parts raise
            self.whole = False

    def _scan(self) -> None:
        """Look for channels in the whole file, once."""
        if not self._scanned:
            self._scanned = True
            for _ in self.messages(()):
                pass


def _records(path: Path, file: BinaryIO, progress: ReadProgress, size: int) -> Iterator[McapRecord]:
    """All records, those in chunks too; a chunk is looked at before it is unpacked."""
    reader = StreamReader(
        file, record_size_limit=_largest(path), emit_chunks=True, validate_crcs=True
    )
    for record in reader.records:
        check()
        progress.at(file.tell(), size)
        if isinstance(record, Chunk):
            yield from _inside(path, record)
        else:
            yield record


def _inside(path: Path, chunk: Chunk) -> Iterator[McapRecord]:
    """The records of a chunk, one after the other."""
    packed, size = len(chunk.data), chunk.uncompressed_size
    if size > max(SMALL, UNPACKED * packed):
        raise LogError(
            path,
            f"has a chunk of {packed} bytes that would unpack to {size >> 20} MiB",
            "copy it again from where it was recorded",
        )
    data = _mcap_chunk(chunk)
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk does not fit its checksum")
    place = 0
    while place < len(data):
        kind, length = _HEAD.unpack_from(data, place)
        place += _HEAD.size
        stop = place + length
        if stop > len(data):
            raise ValueError("a record is longer than its chunk")
        if kind == Opcode.MESSAGE and length >= _MCAP_MESSAGE.size:
            channel, sequence, logged, published = _MCAP_MESSAGE.unpack_from(data, place)
            content = data[place + _MCAP_MESSAGE.size : stop]
            yield Record(channel, logged, content, published, sequence)
        elif kind in (Opcode.CHANNEL, Opcode.SCHEMA):
            stream = ReadDataStream(io.BytesIO(data[place:stop]))
            yield Channel.read(stream) if kind == Opcode.CHANNEL else Schema.read(stream)
        elif kind == Opcode.MESSAGE:
            raise ValueError("a message is shorter than its head")
        place = stop


def _mcap_chunk(chunk: Chunk) -> bytes:
    """The records of a chunk as bytes, never more than it says that they are."""
    if not chunk.compression:
        return chunk.data
    if chunk.compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream:
            data = stream.read(chunk.uncompressed_size) if chunk.uncompressed_size else b""
    elif chunk.compression == "lz4":
        import lz4.frame

        unpacker = lz4.frame.LZ4FrameDecompressor()
        data = unpacker.decompress(chunk.data, max_length=chunk.uncompressed_size)
    else:
        raise ValueError(f"no such compression: {chunk.compression}")
    if len(data) != chunk.uncompressed_size:
        raise ValueError("a chunk is shorter than it says")
    return data


def _largest(path: Path) -> int:
    """No record is longer than its file [bytes]."""
    return min(LARGEST_RECORD, path.stat().st_size)


def _unreadable(path: Path, problem: OSError) -> LogError:
    return LogError(path, f"cannot be read ({problem.strerror})", "check the path")


def _decoder(channel: Channel, schema: Schema | None) -> Callable[[bytes], Any] | None:
    encoding = channel.message_encoding
    if encoding == "json":
        return json.loads
    if encoding == "protobuf":
        from mcap_protobuf.decoder import DecoderFactory

        return DecoderFactory().decoder_for(encoding, schema)
    if encoding == "cdr":
        from mcap_ros2.decoder import DecoderFactory as Ros2DecoderFactory

        return Ros2DecoderFactory().decoder_for(encoding, schema)
    return None


def _name(schema: Schema | None) -> str:
    return schema.name.replace("/msg/", "/") if schema is not None else ""


def _type(channel: Channel, schema: Schema | None) -> str:
    known = {"cdr": "", "json": "JSON", "protobuf": "Protobuf"}
    encoding = known.get(channel.message_encoding, channel.message_encoding)
    return " ".join(filter(None, [encoding, _name(schema)])) or "unknown"
