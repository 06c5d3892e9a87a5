"""The SOLAR-2 codec: bytes from programs in use, and no bytes that it cannot take."""

import math
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.plant.devices.solar2 import (
    READ,
    LineParser,
    decode_binary,
    decode_text,
    describe,
    interval,
)


def test_binary_angles_are_thousandths_of_a_degree():
    known = bytes.fromhex("00 01 7F E3")  # 98.275 deg, as a program for the family has it
    below = (-2250).to_bytes(4, "big", signed=True)
    assert decode_binary(known + below) == pytest.approx((math.radians(98.275), -0.03926991))
    assert decode_binary(known) is None
    assert decode_binary(known + below + b"\x00") is None


@pytest.mark.parametrize(
    "line", [b"+001.500,-002.250", b"+  1.500 -  2.250", b"  01.500\t-02.2500"]
)
def test_text_angles_are_two_numbers_of_eight_characters(line):
    assert decode_text(line) == pytest.approx((math.radians(1.5), math.radians(-2.25)))


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"+001.500-002.250",
        b"+001.500,-002.25",
        b"+001.5x0,-002.250",
        b"+001.500,-00+.250",
        b"+001.50012-002.25",
        b"nan     ,     inf",
    ],
)
def test_a_line_that_lacks_or_changes_a_character_is_no_angle(line):
    assert decode_text(line) is None


def test_a_command_has_seven_characters():
    assert len(READ) == len(interval(50)) == len(interval(9999)) == 7
    assert interval(50) == b"str0050"
    with pytest.raises(ValueError, match="an interval of 49 ms; the unit has 50 to 9999 ms"):
        interval(49)


@pytest.mark.parametrize(
    ("reply", "expected", "told"),
    [
        (b"", "binary", "no answer"),
        (b"+001.500,-002.250\r", "binary", "set the mode to text"),
        (b"\x00\x00\x05\xdc\xff\xff\xf7\x36", "text", "set the mode to binary"),
        (b"$PLDL1,1.500,-2.250*00\r\n", "binary", r"\$PLDL100,1\*38"),
        (b"\xff\xff", "binary", "does not know the command"),
        (b"\x00\x01\x02", "binary", "3 bytes that are no answer"),
    ],
)
def test_a_wrong_reply_tells_what_is_the_matter(reply, expected, told):
    assert re.search(told, describe(reply, expected))


def test_lines_come_out_whole_whatever_the_pieces():
    stream = 3 * b"+001.500,-002.250\r\n"
    for size in (1, 2, 7, 19, 60):
        parser = LineParser()
        pieces = [stream[k : k + size] for k in range(0, len(stream), size)]
        assert sum((parser.feed(p) for p in pieces), []) == 3 * [b"+001.500,-002.250"]


@given(st.lists(st.binary(max_size=200), max_size=20))
@settings(max_examples=300, deadline=None)
def test_any_bytes_are_taken_and_the_next_good_line_is_found(chunks):
    parser = LineParser()
    for chunk in chunks:
        for line in parser.feed(chunk):
            decode_text(line)
            describe(line, "text")
        decode_binary(chunk)
        assert len(parser._buffer) <= 64
    parser.feed(b"\r")
    assert parser.feed(b"+001.500,-002.250\r\n") == [b"+001.500,-002.250"]
