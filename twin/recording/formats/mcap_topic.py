"""The messages of one topic of an MCAP file; a file cut short gives what is whole."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from mcap.exceptions import InvalidMagic
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from twin.errors import LogError
from twin.recording.formats.extras import SMALL, UNPACKED
from twin.recording.formats.topic import Topic
from twin.stop import Stopped, check

LARGEST_RECORD = 1 << 30
"""A longer record is damage, not data [bytes]."""

_AGAIN = "copy it again from where it was recorded"


def read_topic(path: Path, name: str | None) -> Topic:
    """Read a topic; without a name, the only one.

    Raises:
        LogError: no MCAP file, no such topic, or messages that cannot be read; with the topics.
    """
    channels, messages, whole = _scan(path, name)
    if not channels:
        problem = "holds no topic" if whole else "is cut short before its first message"
        raise LogError(path, problem, _AGAIN)
    types = {channel.topic: (channel, schema) for channel, schema in channels.values()}
    listed = ", ".join(f"{topic} ({_type(*types[topic])})" for topic in sorted(types))
    choice = f"name one of its topics in `topic`: {listed}"
    if name is None and len(types) == 1:
        (name,) = types
    if name is None or name not in types:
        problem = "holds several topics" if name is None else f"has no topic {name!r}"
        raise LogError(path, problem, choice)
    try:
        decode = _decoder(*types[name])
    except Exception as problem:  # a damaged schema: the parsers raise what their parts raise
        raise LogError(path, f"has a damaged schema for {name} ({problem})", _AGAIN) from None
    if decode is None:
        kind = _type(*types[name])
        raise LogError(path, f"topic {name} is of type {kind}, which is not read", choice)
    if not messages:
        raise LogError(path, f"has no whole message on {name}", "record it again")
    return Topic(
        path,
        name,
        types[name][0].message_encoding,
        _name(types[name][1]),
        [message.data for message in messages],
        decode,
        [message.log_time for message in messages],
        [message.publish_time for message in messages],
        whole,
    )


def types_in(path: Path) -> dict[str, str]:
    """Topics and the names of their types.

    Raises:
        LogError: no MCAP file.
    """
    channels, _, _ = _scan(path, "")
    return {channel.topic: _name(schema) for channel, schema in channels.values()}


def _scan(
    path: Path, name: str | None
) -> tuple[Mapping[int, tuple[Channel, Schema | None]], list[Message], bool]:
    """All channels with their schemas, the messages of one topic, and whether that was all."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[Channel, Schema | None]] = {}
    messages: list[Message] = []
    try:
        with path.open("rb") as file:
            for record in _records(path, file):
                if isinstance(record, Schema):
                    schemas.setdefault(record.id, record)
                elif isinstance(record, Channel):
                    channels.setdefault(record.id, (record, schemas.get(record.schema_id)))
                elif isinstance(record, Message):
                    topic = channels[record.channel_id][0].topic
                    if name is None or topic == name:
                        messages.append(record)
    except InvalidMagic:
        raise LogError(path, "is no MCAP file", "record or export it as MCAP") from None
    except OSError as problem:
        raise LogError(path, f"cannot be read ({problem.strerror})", "check the path") from None
    except (LogError, Stopped):
        raise
    except Exception:  # on damaged bytes the reader raises what its parts raise
        return channels, messages, False
    return channels, messages, True


def _records(path: Path, file: BinaryIO) -> Iterator[McapRecord]:
    """All records, those in chunks too; a chunk is looked at before it is unpacked."""
    reader = StreamReader(
        file, record_size_limit=LARGEST_RECORD, emit_chunks=True, validate_crcs=True
    )
    for record in reader.records:
        check()
        if not isinstance(record, Chunk):
            yield record
            continue
        packed = len(record.data)
        if record.uncompressed_size > max(SMALL, UNPACKED * packed):
            size = record.uncompressed_size
            raise LogError(
                path,
                f"has a chunk of {packed} bytes that would unpack to {size >> 20} MiB",
                "copy it again from where it was recorded",
            )
        yield from breakup_chunk(record, validate_crc=True)


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
