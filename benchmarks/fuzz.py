"""Ten million random and mutated bytes into each parser, which may raise nothing, keep little and
must hear the next good message; and how fast that goes, beside 115,200 baud.

`python -m benchmarks fuzz`. Half of the bytes are random, half are good messages in which bits
flip, bytes vanish, come twice or are put in, and pieces are cut out. They come in pieces of any
length. What passes all checks and was never sent is counted beside what the check lets pass.
"""

# how much a parser keeps is nobody else's affair
# pyright: reportPrivateUsage=false

import binascii
import random
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator

import numpy as np

from benchmarks.link import SCHEMA
from benchmarks.measure import table
from twin.plant.devices.bno08x import RvcParser
from twin.plant.devices.counters import Counters
from twin.plant.devices.link import Frame, MessageType, Parser, SampleRows, packed
from twin.plant.devices.mdrive_line import Answer, ExchangeState, checksum
from twin.plant.devices.solar2 import LineParser, decode_text
from twin.plant.devices.vn100 import MOTION, BinaryParser
from twin.plant.devices.xbus import FrameParser, XbusMessage, decode_data, encode

BYTES = 10_000_000
BLOCK = 20_000
"""After so many bytes a good message must be heard."""

PIECE = 512
"""Longest piece that a port gives at once."""

LINE = 115_200 / 10
"""Bytes a second at 115,200 baud, start and stop bit included."""

TARGET = 50.0
"""Times that rate."""


class Fuzzed(ABC):
    """One parser under bytes of any kind."""

    name: str
    check: str
    """Of what share of damaged messages its protocol lets pass."""

    def __init__(self) -> None:
        self.most = 0
        """Bytes that it has kept at once."""
        self.passed = 0
        """Messages that passed and were never sent."""
        self.refused = 0
        """Messages that a check refused."""

    @abstractmethod
    def good(self, number: int) -> bytes:
        """A good message, no other of which is the same."""

    @abstractmethod
    def feed(self, data: bytes) -> None:
        """A piece of the line; counts what passes."""

    def quiet(self) -> None:  # noqa: B027  (most parsers need not know)
        """The line falls silent for a while."""

    @abstractmethod
    def hears(self, number: int) -> bool:
        """Whether a good message after what has come is heard."""


class OurLink(Fuzzed):
    """Frames of our own link, down to values."""

    name, check = "our link", "1 in 65,536"

    def __init__(self) -> None:
        super().__init__()
        self.parser = Parser(SCHEMA, "far end")
        self.rng = np.random.default_rng(0)

    def frame(self, number: int) -> Frame:
        """A sample that bears its number twice."""
        value = np.array([[number % 9973, number % 9967, 1.0]], np.float32).astype(float)
        rows = SampleRows(0, (number % 2**32,), value)
        return Frame(MessageType.samples, rows.packed(SCHEMA), number & 0xFFFF, number % 2**32)

    def good(self, number: int) -> bytes:
        return packed(self.frame(number))

    def feed(self, data: bytes) -> None:
        for frame in self.parser.feed(data):
            if frame.type == MessageType.samples:
                rows = SampleRows.unpacked(frame.payload, SCHEMA)
                sent = self.frame(rows.time_us[0]) if rows.time_us else None
                self.passed += sent is None or sent.payload != frame.payload
            else:
                self.passed += 1
        self.most = max(self.most, len(self.parser._rest))
        self.refused = self.parser.counters.bad_checksum

    def hears(self, number: int) -> bool:
        return any(f == self.frame(number) for f in self.parser.feed(b"\0" + self.good(number)))


class Xbus(Fuzzed):
    """Packets of an MTi, down to values."""

    name, check = "Xbus", "1 in 256"

    def __init__(self) -> None:
        super().__init__()
        self.counters = Counters()
        self.parser = FrameParser(self.counters)

    def data(self, number: int) -> bytes:
        """A packet that bears its number twice."""
        values = number % 9973, number % 9967, 1.0
        return (
            struct.pack(">HBI", 0x1060, 4, number)
            + struct.pack(">HB3f", 0x8020, 12, *values)
            + struct.pack(">HB3f", 0x4020, 12, *values)
        )

    def good(self, number: int) -> bytes:
        return encode(XbusMessage(0x36, self.data(number)))

    def feed(self, data: bytes) -> None:
        for message in self.parser.feed(data):
            decode_data(message.data)
            number = int.from_bytes(message.data[3:7], "big")
            self.passed += message.identifier != 0x36 or message.data != self.data(number)
        self.most = max(self.most, len(self.parser._buffer))
        self.refused = self.counters.bad_checksums

    def quiet(self) -> None:
        self.parser.idle()

    def hears(self, number: int) -> bool:
        # a false length waits for its bytes until the line is quiet, as it is between packets
        result = [*self.parser.feed(self.good(number)), *self.parser.idle()]
        return XbusMessage(0x36, self.data(number)) in result


class MDriveReplies(Fuzzed):
    """Answers of an MDrive, each to a question with its own tag."""

    name, check = "MCode replies", "1 in 128, and its tag"

    def __init__(self) -> None:
        super().__init__()
        self.answer = Answer("1a", checked=True)

    def good(self, number: int) -> bytes:
        value = b"1%c%d_%d_1" % (97 + number % 26, number, -number)
        return value + bytes([checksum(value)]) + b"\r\n"

    def feed(self, data: bytes) -> None:
        state = self.answer.feed(data)
        self.most = max(self.most, len(self.answer._buffer))
        if state is ExchangeState.waiting:
            return
        values = self.answer.values
        if state is ExchangeState.done:
            self.passed += len(values) != 3 or values[1] != -values[0] or values[2] != 1
        self.refused += state is ExchangeState.corrupt
        self.answer = Answer(self.answer._tag.decode(), checked=True)

    def hears(self, number: int) -> bool:
        # a question of its own, as after each answer that did not come
        self.answer = Answer(f"1{97 + number % 26:c}", checked=True)
        return self.answer.feed(self.good(number)) is ExchangeState.done


class Solar2Text(Fuzzed):
    """Lines of a SOLAR-2, down to values."""

    name, check = "SOLAR-2 text", "no check but the form"

    def __init__(self) -> None:
        super().__init__()
        self.parser = LineParser()

    def good(self, number: int) -> bytes:
        angle = number % 30_000 / 1000.0
        return f"{angle:+08.3f},{-angle:+08.3f}\r".encode()

    def feed(self, data: bytes) -> None:
        for line in self.parser.feed(data):
            angles = decode_text(line)
            self.refused += angles is None
            self.passed += angles is not None and angles[0] != -angles[1]
        self.most = max(self.most, len(self.parser._buffer))

    def hears(self, number: int) -> bool:
        return any(decode_text(line) for line in self.parser.feed(b"\r" + self.good(number)))


class Rvc(Fuzzed):
    """Packets of a BNO08x."""

    name, check = "BNO08x UART-RVC", "1 in 256"

    def __init__(self) -> None:
        super().__init__()
        self.counters = Counters()
        self.parser = RvcParser(self.counters)

    def counts(self, number: int) -> tuple[int, ...]:
        """Index, angles and accelerations that bear its number twice."""
        return (number % 256, number % 9001, -(number % 9001), 7, number % 997, number % 997, 1000)

    def good(self, number: int) -> bytes:
        body = struct.pack("<B6h3x", *self.counts(number))
        return b"\xaa\xaa" + body + bytes([sum(body) % 256])

    def feed(self, data: bytes) -> None:
        for _, yaw, pitch, roll, x, y, _ in self.parser.feed(data):
            self.passed += yaw != -pitch or x != y or roll != 7
        self.most = max(self.most, len(self.parser._buffer))
        self.refused = self.counters.bad_checksums

    def hears(self, number: int) -> bool:
        # a header in what came before may take the first with it
        heard = self.parser.feed(self.good(number) + self.good(number + 1))
        return self.counts(number + 1) in heard


class VectorNav(Fuzzed):
    """Binary messages of a VN-100."""

    name, check = "VN-100", "1 in 65,536"

    def __init__(self) -> None:
        super().__init__()
        self.counters = Counters()
        self.parser = BinaryParser(self.counters, MOTION)

    def payload(self, number: int) -> bytes:
        """Fields that bear its number twice."""
        return struct.pack("<Q10f", number, *range(9), number % 9973)

    def good(self, number: int) -> bytes:
        body = struct.pack("<BH", 1, MOTION) + self.payload(number)
        return b"\xfa" + body + struct.pack(">H", binascii.crc_hqx(body, 0))

    def feed(self, data: bytes) -> None:
        for payload in self.parser.feed(data):
            (number,) = struct.unpack_from("<Q", payload)
            self.passed += payload != self.payload(number)
        self.most = max(self.most, len(self.parser._buffer))
        self.refused = self.counters.bad_checksums

    def hears(self, number: int) -> bool:
        heard = self.parser.feed(self.good(number) + self.good(number + 1))
        return self.payload(number + 1) in heard


def mutated(subject: Fuzzed, chance: random.Random, first: int, size: int) -> bytes:
    """Good messages, most of them damaged somewhere."""
    out = bytearray()
    number = first
    while len(out) < size:
        message = bytearray(subject.good(number))
        number += 1
        for _ in range(chance.randrange(4)):
            if not message:
                break
            place = chance.randrange(len(message))
            match chance.randrange(5):
                case 0:
                    message[place] ^= 1 << chance.randrange(8)
                case 1:
                    del message[place]
                case 2:
                    message.insert(place, message[place])
                case 3:
                    message.insert(place, chance.randrange(256))
                case _:
                    del message[place : place + chance.randrange(1, 9)]
        out += message
    return bytes(out[:size])


def pieces(line: bytes, chance: random.Random) -> Iterator[bytes]:
    """The line as a port gives it."""
    start = 0
    while start < len(line):
        size = chance.randrange(1, PIECE + 1)
        yield line[start : start + size]
        start += size


def fuzz(subject: Fuzzed, count: int, seed: int) -> tuple[float, int]:
    """Seconds in the parser, and the good messages that were not heard."""
    chance = random.Random(seed)
    spent, deaf = 0.0, 0
    for block in range(count // BLOCK):
        random_block = block % 2 == 0
        line = (
            chance.randbytes(BLOCK)
            if random_block
            else mutated(subject, chance, 1000 * block, BLOCK)
        )
        cut = list(pieces(line, chance))
        start = time.perf_counter()
        for piece in cut:
            subject.feed(piece)
        spent += time.perf_counter() - start
        deaf += not subject.hears(7 + block)
    return spent, deaf


def run() -> None:
    """Print the table."""
    rows: list[tuple[str, ...]] = []
    for kind in (OurLink, Xbus, MDriveReplies, Solar2Text, Rvc, VectorNav):
        subject = kind()
        spent, deaf = fuzz(subject, BYTES, seed=1)
        rows.append(
            (
                subject.name,
                f"{BYTES:,}",
                f"{BYTES / spent / LINE:.0f}",
                f"{subject.most}",
                f"{deaf} of {BYTES // BLOCK}",
                f"{subject.refused:,}",
                f"{subject.passed}",
                subject.check,
            )
        )
    table(
        (
            "parser",
            "bytes",
            f"times 115,200 baud (>= {TARGET:.0f})",
            "bytes kept at most",
            "good messages not heard",
            "refused by its check",
            "passed and never sent",
            "the check lets pass",
        ),
        rows,
    )
