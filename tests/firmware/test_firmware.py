"""The C99 far end of docs/firmware does, byte for byte, what the emulated one does."""

import importlib.util
import re
import shutil
import struct
import subprocess
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tests.processes import PATIENCE
from twin.plant.devices.link import (
    LONGEST_PAYLOAD,
    ArmRequest,
    Channel,
    Frame,
    Hello,
    MessageType,
    Parser,
    Schema,
    SetPoint,
    TimeSync,
    checksum,
    packed,
)
from twin.plant.devices.link.far_end import FarEnd
from twin.plant.devices.link.frame import stuff, unstuff
from twin.plant.devices.link.schema import c_header

FIRMWARE = Path(__file__).parents[2] / "docs" / "firmware"
CC = shutil.which("cc")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion")
SANITIZE = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")

needs_compiler = pytest.mark.skipif(CC is None, reason="no C compiler `cc` on this machine")


def _generate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", FIRMWARE / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


GENERATE = _generate()
SCHEMA: Schema = GENERATE.SCHEMA
COMMANDED = [n for n, channel in enumerate(SCHEMA.channels) if channel.commanded]


def compiled(out: Path, *sources: Path) -> Path:
    """A program, with sanitizers where the compiler has them."""
    words = [str(CC), *STRICT, "-I", str(FIRMWARE), "-o", str(out), *map(str, sources)]
    with_them = subprocess.run([*words, *SANITIZE], capture_output=True, timeout=PATIENCE)
    if with_them.returncode != 0:
        subprocess.run(words, check=True, timeout=PATIENCE)
    return out


@pytest.fixture(scope="module")
def harness(tmp_path_factory: pytest.TempPathFactory) -> Path:
    here = Path(__file__).parent
    folder = tmp_path_factory.mktemp("firmware")
    return compiled(folder / "far_end", here / "far_end.c", FIRMWARE / "link.c")


@dataclass(frozen=True)
class Seen:
    """What an operation led to."""

    said: bytes
    state: int
    flags: int
    setpoints: tuple[tuple[bool, bytes], ...]
    """A pair a command channel: in force, and its words."""
    counters: tuple[int, ...]


Operation = tuple[str, int, bytes]


def in_c(harness: Path, operations: list[Operation]) -> Iterator[Seen]:
    """What link.c makes of it, in one process."""
    stdin = b"".join(
        op.encode() + struct.pack("<IH", now % 2**32, len(data)) + data
        for op, now, data in operations
    )
    done = subprocess.run([harness], input=stdin, capture_output=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr.decode()
    out, place = done.stdout, 0
    for _ in operations:
        count = int.from_bytes(out[place : place + 2], "little")
        said = out[place + 2 : place + 2 + count]
        place += 2 + count
        state, flags = out[place : place + 2]
        place += 2
        setpoints: list[tuple[bool, bytes]] = []
        for number in COMMANDED:
            size = SCHEMA.channels[number].size
            setpoints.append((bool(out[place]), out[place + 1 : place + 1 + size]))
            place += 1 + size
        yield Seen(said, state, flags, tuple(setpoints), struct.unpack_from("<8I", out, place))
        place += 32
    assert place == len(out)


def in_python(operations: list[Operation]) -> Iterator[Seen]:
    """What the emulated far end makes of it."""
    far_end = FarEnd(SCHEMA, GENERATE.NAME, GENERATE.LONGEST_VALID_MS, 0)
    for op, now, data in operations:
        if op == "I":
            far_end = FarEnd(SCHEMA, GENERATE.NAME, GENERATE.LONGEST_VALID_MS, now)
        elif op == "R":
            far_end.receive(data, now)
        elif op == "A":
            far_end.advance(now)
        elif op == "F":
            far_end.fault("LIMIT", 3.0, now)
        else:
            channel = SCHEMA.channels[data[0]]
            far_end.sample(data[0], now - 7, channel.unpacked(data[1:]), now)
        setpoints = tuple(
            (number in far_end.setpoint, _words(far_end, number)) for number in COMMANDED
        )
        yield Seen(
            far_end.take(),
            far_end.state,
            far_end.flags,
            setpoints,
            astuple(far_end.parser.counters),
        )


def _words(far_end: FarEnd, number: int) -> bytes:
    value = far_end.setpoint.get(number)
    return b"" if value is None else SCHEMA.channels[number].packed(value)


def differing(c: Seen, python: Seen) -> list[str]:
    """What is not the same; words count where they are in force."""
    names = [
        name
        for name in ("said", "state", "flags", "counters")
        if getattr(c, name) != getattr(python, name)
    ]
    for (live, words), (emulated_live, emulated), number in zip(
        c.setpoints, python.setpoints, COMMANDED, strict=True
    ):
        if live != emulated_live or (live and words != emulated):
            names.append(SCHEMA.channels[number].stream)
        if not live and SCHEMA.channels[number].safe == "zero" and any(words):
            names.append(f"{SCHEMA.channels[number].stream} is not zero")
    return names


def random_frame(rng: np.random.Generator, number: int) -> bytes:
    """Mostly what a host says, with values at the edges; sometimes what it would not."""
    value = rng.choice(
        [0.0, 1.0, -3e-3, 1e9, np.nan, np.inf], 3, p=[0.3, 0.3, 0.3, 0.04, 0.03, 0.03]
    )
    valid_for = int(
        rng.choice([0, 1, 20, 100, 500, 501, 65535], p=[0.02, 0.1, 0.3, 0.3, 0.2, 0.04, 0.04])
    )
    channel = int(rng.choice(COMMANDED))
    known = SCHEMA.hash if rng.random() < 0.95 else 1
    payload = {
        MessageType.hello: Hello(known, 0, "twin").packed(),
        MessageType.timesync: TimeSync(int(rng.integers(0, 2**62))).packed(),
        MessageType.setpoint: SetPoint(channel, valid_for, value).packed(SCHEMA),
        MessageType.arm: ArmRequest(known, valid_for).packed(),
        MessageType.disarm: b"",
        MessageType.safe_stop: b"",
        77: rng.integers(0, 256, int(rng.integers(0, LONGEST_PAYLOAD)), dtype=np.uint8).tobytes(),
    }
    kind = list(payload)[rng.choice(7, p=[0.05, 0.1, 0.5, 0.2, 0.06, 0.06, 0.03])]
    body = payload[kind] if rng.random() < 0.97 else payload[kind][:-1] + b"\0\1"
    frame = packed(Frame(kind, body, number & 0xFFFF, number, 0, 0, 0))
    return of_another_version(frame) if rng.random() < 0.02 else frame


def of_another_version(frame: bytes) -> bytes:
    """The same with a version that nobody speaks, and a check that is right."""
    body = unstuff(frame[:-1])
    assert body is not None
    body = b"\x02" + body[1:-2]
    return stuff(body + checksum(body).to_bytes(2, "little")) + b"\0"


def random_operations(count: int, seed: int) -> list[Operation]:
    """A host that talks, over a line that damages some of it, while time goes by and wraps."""
    rng = np.random.default_rng(seed)
    now, number = 2**32 - 3_000_000, 0
    operations: list[Operation] = [("I", now, b"")]
    for _ in range(count):
        now += int(rng.choice([0, 300, 15_000, 90_000, 700_000], p=[0.3, 0.4, 0.2, 0.09, 0.01]))
        what = rng.random()
        if what < 0.8:
            line = bytearray()
            for _ in range(int(rng.integers(1, 4))):
                number += int(rng.choice([0, 1, 3], p=[0.02, 0.95, 0.03]))
                line += random_frame(rng, number)
            if rng.random() < 0.2:
                line[rng.integers(0, len(line))] = rng.integers(0, 256)
            cut = int(rng.integers(0, len(line))) if rng.random() < 0.2 else len(line)
            operations += [("R", now, bytes(line[:cut])), ("R", now + 50, bytes(line[cut:]))]
        elif what < 0.86:
            noise = rng.integers(0, rng.choice([3, 20, 256]), int(rng.integers(1, 700)))
            operations.append(("R", now, noise.astype(np.uint8).tobytes()))
        elif what < 0.93:
            operations.append(("A", now, b""))
        elif what < 0.99:
            channel = int(rng.integers(0, 4))
            words = rng.integers(0, 2**31, 3, dtype=np.int32)
            if SCHEMA.channels[channel].number == "float32":
                words = rng.normal(size=3).astype(np.float32).view(np.int32)
            operations.append(("S", now, bytes((channel,)) + words.astype("<i4").tobytes()))
        else:
            operations.append(("F" if rng.random() < 0.7 else "I", now, b""))
            number = number if operations[-1][0] == "F" else 0
    return operations


def test_the_header_and_the_vectors_are_those_that_the_script_writes():
    header = c_header(SCHEMA, GENERATE.NAME, GENERATE.LONGEST_VALID_MS)
    assert (FIRMWARE / "schema.h").read_text(encoding="utf-8") == header
    assert (FIRMWARE / "vectors.txt").read_text(encoding="utf-8") == GENERATE.vectors()


def test_every_frame_of_the_vectors_is_read_and_written_alike_by_the_codec():
    said = {"host": b"", "far end": b""}
    for line in (FIRMWARE / "vectors.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            _, host, far_end = line.split()
            said["host"] += bytes.fromhex(host.strip("-"))
            said["far end"] += bytes.fromhex(far_end.strip("-"))
    for sender, least in (("host", 25), ("far end", 25)):
        frames = Parser(SCHEMA, sender).feed(said[sender])
        assert len(frames) > least
        assert all(packed(frame) in said[sender] for frame in frames)


@needs_compiler
def test_the_firmware_answers_the_vectors_as_they_say(tmp_path: Path):
    program = compiled(tmp_path / "check", FIRMWARE / "check_vectors.c", FIRMWARE / "link.c")
    with (FIRMWARE / "vectors.txt").open() as vectors:
        done = subprocess.run(
            [program], stdin=vectors, capture_output=True, text=True, timeout=PATIENCE
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.fullmatch(r"\d+ steps agree\n", done.stdout)


@needs_compiler
@pytest.mark.parametrize("seed", range(4))
def test_firmware_and_emulation_agree_whatever_comes(harness: Path, seed: int):
    operations = random_operations(3000, seed)
    pairs = zip(in_c(harness, operations), in_python(operations), strict=True)
    states = set[int]()
    for number, (c, python) in enumerate(pairs):
        assert not differing(c, python), (seed, number, operations[number])
        states.add(c.state)
    assert states == {0, 1, 2}, "it was never armed or never at fault: this shows little"


@needs_compiler
def test_ten_million_random_bytes_neither_stop_nor_arm_the_firmware(harness: Path):
    hello = Frame(MessageType.hello, Hello(SCHEMA.hash, 0, "twin").packed(), 5)
    many = 10_000_000 // 1024
    # M takes its count in units of 1024 and no bytes
    noise = b"M" + struct.pack("<IH", 12345, many)
    start = b"I" + struct.pack("<IH", 0, 0)
    frame = packed(hello)
    end = b"R" + struct.pack("<IH", 20000, 1 + len(frame)) + b"\0" + frame
    done = subprocess.run(
        [harness], input=start + noise + end, capture_output=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr.decode()
    size = sum(1 + SCHEMA.channels[number].size for number in COMMANDED)
    counters = struct.unpack("<8I", done.stdout[-32:])
    state, flags = done.stdout[-34 - size : -32 - size]
    assert (state, flags) == (0, 1), "after the noise it hears a greeting, and was never armed"
    assert counters[1] > 10_000, "malformed packets"


@needs_compiler
def test_a_schema_too_large_for_the_firmware_cannot_be_armed(tmp_path: Path):
    wide = Schema(
        (Channel("gyro", "rad/s", 17), Channel("command_dipole", "A m^2", 3, safe="zero"))
    )
    (tmp_path / "schema.h").write_text(c_header(wide, "wide", 500))
    (tmp_path / "main.c").write_text(
        '#include "link.h"\n#include "schema.h"\n'
        "int main(void)\n{\n    static struct link link;\n"
        "    return link_init(&link, &schema, 0) == 0 && link.state == LINK_FAULT ? 0 : 1;\n}\n"
    )
    words = [str(CC), *STRICT, "-I", str(tmp_path), "-I", str(FIRMWARE), "-o", str(tmp_path / "a")]
    words += [str(tmp_path / "main.c"), str(FIRMWARE / "link.c")]
    subprocess.run(words, check=True, timeout=PATIENCE)
    assert subprocess.run([tmp_path / "a"], timeout=PATIENCE).returncode == 0


@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler `c++` on this machine")
def test_a_sketch_in_cpp_may_include_the_headers(tmp_path: Path):
    (tmp_path / "sketch.cpp").write_text(
        "#include <unistd.h>\n"
        '#include "link.h"\n#include "schema.h"\nstatic struct link far_end;\n'
        "void loop() { link_init(&far_end, &schema, 0); }\n"
    )
    words = ["c++", "-Wall", "-Werror", "-fsyntax-only", "-I", str(FIRMWARE), "sketch.cpp"]
    subprocess.run(words, cwd=tmp_path, check=True, timeout=PATIENCE)


def test_the_firmware_needs_no_library_but_copies_of_memory():
    text = (FIRMWARE / "link.c").read_text() + (FIRMWARE / "link.h").read_text()
    assert set(re.findall(r"#include [<\"](\S+)[>\"]", text)) == {"link.h", "stdint.h", "string.h"}
    for word in ("malloc", "free(", "printf", "double"):
        assert word not in text
