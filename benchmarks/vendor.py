"""Vendor protocols: bytes a second through each parser, down to values, beside 115,200 baud."""

import random
import struct
from collections.abc import Callable

from benchmarks.measure import seconds, spread, table
from twin.plant.devices.device import Counters
from twin.plant.devices.mdrive_line import Answer, ExchangeState, checksum
from twin.plant.devices.solar2 import LineParser, decode_binary, decode_text
from twin.plant.devices.xbus import FrameParser, XbusMessage, decode_data, encode

ROUNDS = 9
TARGET = 50 * 115_200 / 10
"""Bytes a second: fifty times 115,200 baud, start and stop bit included."""
PIECE = 512
"""Bytes that a port gives at once."""


def xbus_stream() -> bytes:
    """Packets of attitude, rate, acceleration and field."""
    out = bytearray()
    for number in range(8000):
        data = struct.pack(">HBH", 0x1020, 2, number & 0xFFFF)
        data += struct.pack(">HBI", 0x1060, 4, 100 * number)
        for kind, count in ((0x2010, 4), (0x8020, 3), (0x4020, 3), (0xC020, 3)):
            data += struct.pack(f">HB{count}f", kind, 4 * count, *[0.1] * count)
        out += encode(XbusMessage(0x36, data))
    return bytes(out)


def xbus(line: bytes) -> int:
    """Values of all packets."""
    parser, result = FrameParser(Counters(), 254), 0
    for start in range(0, len(line), PIECE):
        for message in parser.feed(line[start : start + PIECE]):
            result += len(decode_data(message.data) or ())
    return result + len(parser.idle())


def mdrive(line: bytes) -> int:
    """Answers, each to a question of its own, in the pieces in which they come."""
    result = 0
    for reply in line.split(b"\n"):
        answer = Answer("1a", checked=True)
        answer.feed(reply[: len(reply) // 2])
        result += answer.feed(reply[len(reply) // 2 :] + b"\n") is ExchangeState.done
    return result


def mdrive_noise(line: bytes) -> int:
    """Garbage while an answer is waited for."""
    answer = Answer("1a", checked=True)
    for start in range(0, len(line), PIECE):
        answer.feed(line[start : start + PIECE].replace(b"\x15", b"."))
    return len(answer.values)


def solar2_text(line: bytes) -> int:
    """Angles of a stream."""
    parser, result = LineParser(), 0
    for start in range(0, len(line), PIECE):
        for each in parser.feed(line[start : start + PIECE]):
            result += decode_text(each) is not None
    return result


def solar2_binary(line: bytes) -> int:
    """Angles of replies, one after the other."""
    return sum(decode_binary(line[k : k + 8]) is not None for k in range(0, len(line), 8))


def run() -> None:
    """Print the table."""
    noise = random.Random(0).randbytes(600_000)
    value = b"1a-20157_1_0_31002"
    answer = value + bytes([checksum(value)]) + b"\r\n"
    # the worst for the Xbus parser: every four bytes announce the longest frame
    announced = b"\xfa\xff\x36\xfe" * 100_000
    subjects: list[tuple[str, bytes, Callable[[bytes], int]]] = [
        ("Xbus, packets to values", xbus_stream(), xbus),
        ("Xbus, random bytes", noise, xbus),
        ("Xbus, nothing but false lengths", announced, xbus),
        ("MDrive, answers to values", answer * 25_000, mdrive),
        ("MDrive, random bytes", noise, mdrive_noise),
        ("SOLAR-2, text to values", b"+001.500,-002.250\r" * 30_000, solar2_text),
        ("SOLAR-2, random bytes as text", noise, solar2_text),
        ("SOLAR-2, binary to values", bytes(600_000), solar2_binary),
    ]
    rows: list[tuple[str, str, str]] = []
    for name, line, parse in subjects:
        speeds = [len(line) / seconds(lambda: parse(line)) / 1e3 for _ in range(ROUNDS)]  # noqa: B023
        rows.append((name, spread(speeds, ".0f"), f">= {TARGET / 1e3:.0f}"))
    table(("bytes", f"kB/s, median of {ROUNDS} (lowest to highest)", "target"), rows)
