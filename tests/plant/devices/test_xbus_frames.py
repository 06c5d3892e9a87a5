"""The Xbus codec: published bytes, and no bytes that it cannot take."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.plant.devices.device import Counters
from twin.plant.devices.xbus import (
    BAUD_CODES,
    DATA_ITEMS,
    LONGEST,
    DeviceClock,
    FrameParser,
    OutputSetting,
    Wrapping,
    XbusMessage,
    decode_data,
    decode_outputs,
    encode,
    encode_outputs,
    packet_bytes,
)

PUBLISHED = [
    (0x00, "", "FA FF 00 00 01"),
    (0x10, "", "FA FF 10 00 F1"),
    (0x11, "", "FA FF 11 00 F0"),
    (0x30, "", "FA FF 30 00 D1"),
    (0x31, "", "FA FF 31 00 D0"),
    (0x3E, "", "FA FF 3E 00 C3"),
    (0x3F, "", "FA FF 3F 00 C2"),
    (0x40, "", "FA FF 40 00 C1"),
    (0xC0, "", "FA FF C0 00 41"),
    (0x42, "04", "FA FF 42 01 04 BA"),
    (0x18, "02", "FA FF 18 01 02 E6"),
]
CONFIGURATION = (
    "FA FF C0 18 10 20 FF FF 10 60 FF FF 20 10 00 64 80 20 00 64 40 20 00 64 C0 20 00 64 ED"
)
ASKED = [
    OutputSetting(0x1020, 0xFFFF),
    OutputSetting(0x1060, 0xFFFF),
    OutputSetting(0x2010, 100),
    OutputSetting(0x8020, 100),
    OutputSetting(0x4020, 100),
    OutputSetting(0xC020, 100),
]
PACKET = bytes.fromhex(
    "FA FF 36 4C 10 20 02 00 07 10 60 04 00 01 E2 40 20 10 10 3F 80 00 00"
    + 12 * "00"
    + "80 20 0C"
    + 8 * "00"
    + "3D CC CC CD 40 20 0C"
    + 8 * "00"
    + "41 1C F5 C3 C0 20 0C 3F 00 00 00 00 00 00 00 3F 00 00 00 77"
)


def parse(data: bytes) -> list[XbusMessage]:
    return FrameParser(Counters()).feed(data)


@pytest.mark.parametrize(("identifier", "data", "published"), PUBLISHED)
def test_published_frames_come_out_of_the_encoder_and_go_into_the_parser(
    identifier, data, published
):
    message, wire = XbusMessage(identifier, bytes.fromhex(data)), bytes.fromhex(published)
    assert encode(message) == wire
    assert parse(wire) == [message]


def test_the_published_output_configuration_is_ours():
    wire = encode(XbusMessage(0xC0, encode_outputs(ASKED)))
    assert wire == bytes.fromhex(CONFIGURATION)
    assert decode_outputs(parse(wire)[0].data) == ASKED


def test_the_published_packet_is_read_number_by_number():
    assert len(PACKET) == 81 == packet_bytes(ASKED)
    (message,) = parse(PACKET)
    items = decode_data(message.data)
    assert items is not None
    values = {item.kind: item.values for item in items}
    assert values[0x1020] == (7,)
    assert values[0x1060] == (123456,)
    assert values[0x2010] == (1.0, 0.0, 0.0, 0.0)
    assert values[0x8020] == pytest.approx((0.0, 0.0, 0.1), rel=1e-7)
    assert values[0x4020] == pytest.approx((0.0, 0.0, 9.81), rel=1e-7)
    assert values[0xC020] == (0.5, 0.0, 0.5)


@pytest.mark.parametrize("code", [0, 1, 2, 3])
@pytest.mark.parametrize("value", [0.0, 1.0, -1.0, 0.1, -9.81, 1234.56, -2000.25])
def test_every_number_format_carries_the_value(code, value):
    if code in (0, 3):
        raw = struct.pack(">f" if code == 0 else ">d", value)
    elif code == 1:
        raw = round(value * 2**20).to_bytes(4, "big", signed=True)
    else:
        six = round(value * 2**32).to_bytes(6, "big", signed=True)
        raw = six[2:] + six[:2]
    items = decode_data(struct.pack(">HB", 0x8020 | code, 3 * len(raw)) + 3 * raw)
    assert items is not None
    resolution = (2e-7 * abs(value), 2**-21, 2**-33, 0.0)[code]
    assert items[0].values == pytest.approx((value,) * 3, abs=resolution + 1e-15)


def test_the_frame_of_an_orientation_does_not_hide_it():
    raw = struct.pack(">4f", 1.0, 0.0, 0.0, 0.0)
    for frame in (0x0, 0x4, 0x8):
        (item,) = decode_data(struct.pack(">HB", 0x2010 | frame, 16) + raw) or []
        assert item.kind == 0x2010


def test_a_byte_at_a_time_is_as_good_as_all_at_once():
    parser = FrameParser(Counters())
    messages = [m for byte in PACKET + PACKET for m in parser.feed(bytes([byte]))]
    assert messages == 2 * parse(PACKET)


@pytest.mark.parametrize("size", [0, 254, 255, 1000, LONGEST])
def test_both_kinds_of_length_go_there_and_back(size):
    message = XbusMessage(0x36, bytes(k & 0xFF for k in range(size)))
    assert parse(encode(message)) == [message]


def test_more_data_than_a_frame_holds_is_refused():
    with pytest.raises(ValueError, match="2049 bytes of data: a frame holds 2048"):
        encode(XbusMessage(0x36, bytes(LONGEST + 1)))


def test_a_corrupt_frame_is_counted_and_the_next_one_is_found():
    counters = Counters()
    broken = bytearray(PACKET)
    broken[30] ^= 0x10
    assert FrameParser(counters).feed(bytes(broken) + PACKET) == parse(PACKET)
    assert counters == Counters(frames=1, bad_checksums=1, resyncs=1)


def test_a_preamble_inside_the_data_of_a_corrupt_frame_does_not_hide_the_next():
    inner = XbusMessage(0x36, b"\x01\xfa\xff\x36\x4c\x02")
    broken = encode(inner)[:-1] + b"\x00"
    parser = FrameParser(Counters())
    assert parser.feed(broken + PACKET) + parser.idle() == parse(PACKET)


def test_a_corrupt_length_does_not_swallow_what_stands_behind_it():
    broken = bytearray(PACKET)
    broken[3] = 0xFF
    broken[4:6] = b"\x08\x00"
    parser = FrameParser(Counters())
    assert parser.feed(bytes(broken) + PACKET) == [], "2 kB are announced"
    assert parser.idle() == parse(PACKET), "a quiet line says that they will not come"


def test_a_length_that_the_device_cannot_have_to_send_is_not_waited_for():
    broken = bytearray(PACKET)
    broken[3:6] = b"\xff\x08\x00"
    assert FrameParser(Counters(), longest=254).feed(bytes(broken) + PACKET) == parse(PACKET)


def test_data_whose_lengths_contradict_each_other_is_not_data():
    assert decode_data(b"\x80\x20\x0c\x00") is None
    assert decode_data(b"\x80\x20\x0b" + bytes(11)) is None
    assert decode_data(b"\x80") is None
    assert decode_data(b"\x99\x90\x02ab") == [], "an unknown item is passed over"


@given(st.lists(st.binary(max_size=300), max_size=20))
@settings(max_examples=300, deadline=None)
def test_any_bytes_are_taken_and_the_next_good_frames_are_found(chunks):
    counters = Counters()
    parser = FrameParser(counters)
    for chunk in chunks:
        for message in parser.feed(chunk):
            decode_data(message.data)
        assert len(parser._buffer) <= LONGEST + 7
    # a false frame whose checksum is right by chance takes those that it holds
    found = parser.feed(PACKET * (LONGEST // len(PACKET) + 3)) + parser.idle()
    assert found[-1:] == parse(PACKET)


@given(
    st.lists(st.tuples(st.integers(0, 10), st.integers(0, 80), st.integers(0, 255)), max_size=30)
)
@settings(max_examples=200, deadline=None)
def test_mutated_frames_cost_no_frame_that_is_whole(mutations):
    stream = [bytearray(PACKET) for _ in range(11)]
    for which, where, value in mutations:
        stream[which][where] = value
    whole = sum(frame == PACKET for frame in stream)
    parser = FrameParser(Counters())
    found = parser.feed(b"".join(stream)) + parser.idle()
    assert found.count(parse(PACKET)[0]) >= whole - 1, "only one that begins inside a false one"


@given(st.sampled_from(sorted(DATA_ITEMS)), st.integers(0, 15), st.binary(max_size=80))
@settings(max_examples=300, deadline=None)
def test_any_data_is_decoded_or_refused(kind, low, rest):
    for item in decode_data(struct.pack(">HB", kind | low, len(rest)) + rest) or []:
        assert all(isinstance(value, (int, float)) for value in item.values)


def test_counters_follow_their_wrap_forwards_and_backwards():
    packets = Wrapping(1 << 16)
    assert [packets.step(n) for n in (65534, 65535, 0, 3, 2, 2)] == [None, 1, 1, 3, -1, 0]


@pytest.mark.parametrize("span", [1 << 32, 864_000_000])
def test_the_devices_clock_runs_on_over_its_wrap(span):
    clock = DeviceClock(span)
    times = [clock.read((span - 100 + 50 * k) % span)[0] for k in range(5)]
    assert [b - a for a, b in zip(times, times[1:], strict=False)] == pytest.approx(4 * [0.005])
    assert math.isclose(clock.read((100 - 30) % span)[1], -0.003)


def test_every_baud_rate_has_its_own_code():
    assert len(set(BAUD_CODES.values())) == len(BAUD_CODES)
