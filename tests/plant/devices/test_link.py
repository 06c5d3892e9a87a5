"""The link's frames: what goes in comes out, what is damaged does not, whatever the bytes."""

import re
from pathlib import Path

import numpy as np
import pytest

from twin.plant.devices.link import (
    EVENTS,
    LONGEST_PAYLOAD,
    MESSAGES,
    ArmRequest,
    Channel,
    Event,
    Frame,
    Hello,
    MessageType,
    Parser,
    SampleRows,
    Schema,
    SetPoint,
    TimeSync,
    checksum,
    packed,
    rows_in_a_frame,
    sentence_of,
)
from twin.plant.devices.link.frame import stuff, unstuff

SCHEMA = Schema(
    (
        Channel("gyro", "rad/s", 3),
        Channel("stage_position", "m", 3, "int32", 2e-6),
        Channel("command_stage_position", "m", 3, "int32", 2e-6, "hold"),
        Channel("command_dipole", "A m^2", 3, safe="zero"),
    )
)


def payload_of(kind: MessageType, rng: np.random.Generator) -> bytes:
    """A payload that its type allows."""
    position = 2e-6 * rng.integers(-9999, 9999, 3)
    rows = int(rng.integers(0, rows_in_a_frame(SCHEMA.channels[0]) + 1))
    clocks = tuple(int(time) for time in rng.integers(0, 2**32, rows))
    return (
        {
            MessageType.hello: Hello(SCHEMA.hash, 500, "feather"),
            MessageType.timesync: TimeSync(int(rng.integers(-(2**63), 2**63)), 12345),
            MessageType.arm: ArmRequest(SCHEMA.hash, 250),
            MessageType.event: Event("EXPIRED", 2.0),
        }[kind].packed()
        if kind.name in ("hello", "timesync", "arm", "event")
        else {
            MessageType.samples: SampleRows(0, clocks, rng.normal(size=(rows, 3))).packed(SCHEMA),
            MessageType.setpoint: SetPoint(2, 100, position).packed(SCHEMA),
            MessageType.disarm: b"",
            MessageType.safe_stop: b"",
        }[kind]
    )


def frames_from(sender: str, count: int, seed: int = 0) -> list[Frame]:
    rng = np.random.default_rng(seed)
    kinds = [kind for kind, row in MESSAGES.items() if row.sender in (sender, "both")]
    return [
        Frame(kind, payload_of(kind, rng), number & 0xFFFF, int(rng.integers(0, 2**32)), 7, 1, 3)
        for number, kind in enumerate(kinds[i] for i in rng.integers(0, len(kinds), count))
    ]


def test_the_checksum_has_the_catalogued_check_value():
    assert checksum(b"123456789") == 0x29B1


@pytest.mark.parametrize(
    ("data", "stuffed"),
    [
        (b"\x00", b"\x01\x01"),
        (b"\x00\x00", b"\x01\x01\x01"),
        (b"\x11\x22\x00\x33", b"\x03\x11\x22\x02\x33"),
        (b"\x11\x00\x00\x00", b"\x02\x11\x01\x01\x01"),
        (bytes(range(1, 255)), b"\xff" + bytes(range(1, 255))),
        (b"\x00" + bytes(range(1, 254)), b"\x01\xfe" + bytes(range(1, 254))),
    ],
)
def test_stuffing_follows_the_published_examples_and_comes_back(data: bytes, stuffed: bytes):
    assert stuff(data) == stuffed
    assert unstuff(stuffed) == data


def test_stuffing_costs_one_byte_and_leaves_no_zero():
    rng = np.random.default_rng(1)
    for length in range(1, 255):
        data = rng.integers(0, 3, length, dtype=np.uint8).tobytes()
        assert len(stuff(data)) == length + 1
        assert 0 not in stuff(data)
        assert unstuff(stuff(data)) == data


@pytest.mark.parametrize("length", [0, 255])
def test_what_one_stuffing_byte_is_not_enough_for_is_refused(length: int):
    with pytest.raises(ValueError, match="one stuffing byte"):
        stuff(bytes(length))


@pytest.mark.parametrize("sender", ["host", "far end"])
@pytest.mark.parametrize("piece", [1, 7, 100_000])
def test_every_message_comes_back_however_the_bytes_are_cut(sender: str, piece: int):
    frames = frames_from(sender, 300)
    line = b"".join(map(packed, frames))
    parser = Parser(SCHEMA, sender)
    heard = [f for i in range(0, len(line), piece) for f in parser.feed(line[i : i + piece])]
    assert heard == frames
    assert vars(parser.counters) | {"frames": 0} == dict.fromkeys(vars(parser.counters), 0)


def test_no_frame_is_longer_than_the_line_was_planned_for():
    longest = packed(Frame(MessageType.samples, bytes(range(1, LONGEST_PAYLOAD + 1))))
    assert len(longest) == 256
    with pytest.raises(ValueError, match="240 fit"):
        packed(Frame(MessageType.samples, bytes(LONGEST_PAYLOAD + 1)))


def test_a_payload_of_each_kind_says_what_was_put_in():
    value = np.array([[1.5, -0.25, np.nan], [0.0, 1e-3, 3.0]])
    rows = SampleRows(0, (5, 2**32 - 1), value)
    back = SampleRows.unpacked(rows.packed(SCHEMA), SCHEMA)
    assert (back.channel, back.time_us) == (0, (5, 2**32 - 1))
    np.testing.assert_array_equal(back.value, value.astype(np.float32))
    for one in (Hello(1, 2, "name"), TimeSync(-(10**15), 7), ArmRequest(3, 4), Event("VALUE", 0.5)):
        assert type(one).unpacked(one.packed()) == one
    wish = SetPoint(2, 50, np.array([0.02, -2e-6, 0.0]))
    back = SetPoint.unpacked(wish.packed(SCHEMA), SCHEMA)
    np.testing.assert_allclose(back.value, wish.value, atol=1e-15)


def test_whole_counts_are_sent_to_the_nearest_count_and_absence_is_kept():
    channel = SCHEMA.channels[1]
    sent = channel.sent(np.array([3.1e-6, np.nan, 1e9]))
    np.testing.assert_allclose(sent, [4e-6, np.nan, (2**31 - 1) * 2e-6])


@pytest.mark.parametrize(
    "change",
    [
        {"unit": "rad"},
        {"columns": 2},
        {"number": "int32", "scale": 1e-6},
        {"stream": "accelerometer"},
    ],
)
def test_any_change_of_a_channel_changes_the_hash(change: dict):
    values = {"stream": "gyro", "unit": "rad/s", "columns": 3} | change
    assert Schema((Channel(**values), *SCHEMA.channels[1:])).hash != SCHEMA.hash


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"columns": 0}, "1 to 58"),
        ({"columns": 59}, "1 to 58"),
        ({"scale": 2.0}, "a scale is for int32"),
        ({"safe": "zero"}, "states safe"),
        ({"stream": "command_dipole"}, "states safe"),
    ],
)
def test_a_channel_that_cannot_travel_is_refused(values: dict, sentence: str):
    with pytest.raises(ValueError, match=sentence):
        Channel(**{"stream": "gyro", "unit": "rad/s", "columns": 3} | values)


def test_lost_and_doubled_frames_are_counted_by_their_sequence():
    frames = [Frame(MessageType.disarm, b"", number & 0xFFFF) for number in range(65530, 65545)]
    parser = Parser(SCHEMA, "host")
    kept = [frame for place, frame in enumerate(frames) if place not in (3, 4, 9)]
    heard = parser.feed(b"".join(packed(frame) for frame in [*kept[:6], kept[5], *kept[6:]]))
    assert heard == kept
    assert parser.counters.gaps == 3
    assert parser.counters.repeated == 1


def test_a_greeting_starts_the_count_anew():
    parser = Parser(SCHEMA, "far end")
    parser.feed(packed(Frame(MessageType.event, Event("SAFE", 0.0).packed(), 900)))
    parser.feed(packed(Frame(MessageType.hello, Hello(1, 1, "").packed(), 0)))
    parser.feed(packed(Frame(MessageType.event, Event("SAFE", 0.0).packed(), 1)))
    assert parser.counters.frames == 3
    assert parser.counters.gaps == 0


def test_every_kind_of_damage_has_its_counter():
    good = packed(Frame(MessageType.disarm, b"", 5))
    parser = Parser(SCHEMA, "host")
    body = unstuff(good[:-1])
    assert body is not None

    def with_check(changed: bytes) -> bytes:
        return stuff(changed + checksum(changed).to_bytes(2, "little")) + b"\0"

    parser.feed(b"\x05\x01\0" + b"\x02\x01\0" + b"\x07" * 300 + b"\0")
    assert parser.counters.malformed == 3
    parser.feed(stuff(body[:-1] + bytes((body[-1] ^ 1,))) + b"\0")
    assert parser.counters.bad_checksum == 1
    parser.feed(with_check(b"\x02" + body[1:-2]))
    assert parser.counters.bad_version == 1
    parser.feed(packed(Frame(200, b"", 6)))
    parser.feed(packed(Frame(MessageType.event, Event("SAFE", 0.0).packed(), 7)))
    assert parser.counters.unknown == 2, "an event is not the host's to send"
    parser.feed(packed(Frame(MessageType.disarm, b"x", 8)))
    parser.feed(packed(Frame(MessageType.setpoint, b"\x09\0\x10\0" + bytes(12), 9)))
    parser.feed(packed(Frame(MessageType.setpoint, b"\x00\0\x10\0" + bytes(12), 10)))
    assert parser.counters.bad_payload == 3
    assert parser.counters.frames == 0
    assert parser.feed(packed(Frame(MessageType.disarm, b"", 11))) != []


def test_one_flipped_bit_never_passes():
    line = packed(Frame(MessageType.arm, ArmRequest(SCHEMA.hash, 100).packed(), 3, 123456, 2, 1, 1))
    for bit in range(8 * (len(line) - 1)):
        bad = bytearray(line)
        bad[bit // 8] ^= 1 << bit % 8
        assert Parser(SCHEMA, "host").feed(bytes(bad) + b"\0") == []


def test_random_and_mutated_bytes_raise_nothing_and_the_next_good_frame_is_heard():
    rng = np.random.default_rng(11)
    parser = Parser(SCHEMA, "host")
    frames = frames_from("host", 400, seed=5)
    line = np.frombuffer(b"".join(map(packed, frames)), np.uint8)
    false = 0
    for round_ in range(60):
        bad = line.copy()
        places = rng.integers(0, len(bad), len(bad) // 40)
        bad[places] = rng.integers(0, 256, len(places))
        noise = rng.integers(0, 256, 3000, dtype=np.uint8)
        both = np.concatenate([noise, np.delete(bad, places[::7]), noise[:500]]).tobytes()
        for start in range(0, len(both), 1024):
            false += sum(f not in frames for f in parser.feed(both[start : start + 1024]))
            assert len(parser._rest) <= 255
        last = Frame(MessageType.disarm, b"", round_ + 60_000)
        assert parser.feed(b"\0" + packed(last)) == [last]
    assert false == 0, "a damaged frame passed a check of 16 bits: one in 65,536 may"


def test_events_are_told_in_a_sentence():
    assert sentence_of("EXPIRED", 2.0) == "no new set-point came in time on channel 2; it is safe"
    assert sentence_of("HOT", 91.5) == "HOT (91.5)"
    assert sentence_of("{x}", 1.0) == "{x} (1)", "a firmware's code is no template"


def test_the_document_lists_every_message_event_and_the_longest_payload():
    document = (Path(__file__).parents[3] / "docs" / "link.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| (\w+) \| ([\w ]+) \|", document, re.MULTILINE)
    stated = [(str(int(kind)), kind.name.upper(), row.sender) for kind, row in MESSAGES.items()]
    assert rows == stated
    assert all(code in document for code in EVENTS)
    assert f"0 to {LONGEST_PAYLOAD} | payload" in document
