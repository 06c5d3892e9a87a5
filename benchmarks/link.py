"""Our own link: bytes a second through its parser, beside the fastest common serial line."""

import numpy as np

from benchmarks.measure import seconds, spread, table
from twin.plant.devices.link import (
    Channel,
    Frame,
    MessageType,
    Parser,
    SampleRows,
    Schema,
    packed,
    rows_in_a_frame,
)

ROUNDS = 15
LINE = 115_200 / 10
"""Bytes a second at 115,200 baud, start and stop bit included."""

TARGET = 50 * LINE
SCHEMA = Schema((Channel("gyro", "rad/s", 3), Channel("stage_position", "m", 3, "int32", 2e-6)))


def stream(rows: int, count: int) -> bytes:
    """Frames of gyro samples as they come over the wire."""
    rng = np.random.default_rng(0)
    line = bytearray()
    for number in range(count):
        times = tuple(range(number * 1000, number * 1000 + rows))
        samples = SampleRows(0, times, rng.normal(size=(rows, 3)))
        frame = Frame(MessageType.samples, samples.packed(SCHEMA), number & 0xFFFF, number)
        line += packed(frame)
    return bytes(line)


def parse(line: bytes, *, decode: bool) -> None:
    """Feed a line in pieces as a port gives them; with `decode`, down to the values."""
    parser = Parser(SCHEMA, "far end")
    for start in range(0, len(line), 512):
        for frame in parser.feed(line[start : start + 512]):
            if decode:
                SampleRows.unpacked(frame.payload, SCHEMA)


def run() -> None:
    """Print the table: one sample a frame (the worst case), a full frame, and damage."""
    rng = np.random.default_rng(1)
    single = stream(1, 20_000)
    full = stream(rows_in_a_frame(SCHEMA.channels[0]), 3_000)
    noise = rng.integers(0, 256, 600_000, dtype=np.uint8).tobytes()
    zeros = bytes(600_000)
    rows: list[tuple[str, str, str]] = []
    for name, line, decode in (
        ("one sample a frame, checked", single, False),
        ("one sample a frame, to values", single, True),
        ("full frames, to values", full, True),
        ("random bytes", noise, False),
        ("zeros", zeros, False),
    ):
        speeds = [len(line) / seconds(lambda: parse(line, decode=decode)) for _ in range(ROUNDS)]  # noqa: B023
        rows.append((name, spread([s / 1e3 for s in speeds], ".0f"), f">= {TARGET / 1e3:.0f}"))
    table(("bytes", f"kB/s, median of {ROUNDS} (lowest to highest)", "target"), rows)
