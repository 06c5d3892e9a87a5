"""The messages of an MCAP file; one that is cut short gives what is whole."""

import contextlib
import io
import json
import struct
import zlib
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import InvalidMagic
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, McapRecord, Schema
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader

from twin.errors import LogError
from twin.recording.formats.extras import SMALL, UNPACKED
from twin.recording.formats.one_pass import Progress, Say, silent
from twin.recording.formats.topic import Message, Messages, Topic
from twin.stop import Stopped, check

LARGEST_RECORD = 1 << 30
"""A longer record is damage, not data [bytes]."""

_AGAIN = "copy it again from where it was recorded"
_HEAD, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<HIQQ")
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
    ) -> Generator[Message]:
        schemas: dict[int, Schema] = {}
        channels: _Channels = {}
        progress = Progress(say, self.path)
        size = self.path.stat().st_size
        try:
            with self.path.open("rb") as file:
                for record in _records(self.path, file, progress, size):
                    if isinstance(record, Schema):
                        schemas.setdefault(record.id, record)
                    elif isinstance(record, Channel):
                        one = record, schemas.get(record.schema_id)
                        channels.setdefault(record.id, one)
                        self._channels.setdefault(record.id, one)
                    elif isinstance(record, Record):
                        topic = channels[record.channel_id][0].topic
                        if topics is None or topic in topics:
                            yield Message(topic, record.data, record.log_time, record.publish_time)
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


def _records(path: Path, file: BinaryIO, progress: Progress, size: int) -> Iterator[McapRecord]:
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
    data = _unpacked(chunk)
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk does not fit its checksum")
    place = 0
    while place < len(data):
        kind, length = _HEAD.unpack_from(data, place)
        place += _HEAD.size
        stop = place + length
        if stop > len(data):
            raise ValueError("a record is longer than its chunk")
        if kind == Opcode.MESSAGE and length >= _MESSAGE.size:
            channel, sequence, logged, published = _MESSAGE.unpack_from(data, place)
            content = data[place + _MESSAGE.size : stop]
            yield Record(channel, logged, content, published, sequence)
        elif kind in (Opcode.CHANNEL, Opcode.SCHEMA):
            stream = ReadDataStream(io.BytesIO(data[place:stop]))
            yield Channel.read(stream) if kind == Opcode.CHANNEL else Schema.read(stream)
        elif kind == Opcode.MESSAGE:
            raise ValueError("a message is shorter than its head")
        place = stop


def _unpacked(chunk: Chunk) -> bytes:
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
