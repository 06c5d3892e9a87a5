"""The emulated SOLAR-2: seven characters in, two bytes or two angles out."""

import math
import struct

import pytest

from twin.emulate.solar2 import EmulatedSolar2


class Bench:
    """A unit and a clock of its own."""

    def __init__(self, **fields) -> None:
        self.device, self.now = EmulatedSolar2(noise=0.0, **fields), 0.0

    def say(self, text: bytes, wait: float = 0.01) -> bytes:
        out = self.device.receive(text, self.now)
        self.now += wait
        return out + self.device.advance(self.now)


def test_angles_are_thousandths_of_a_degree_in_binary_and_eight_characters_in_text():
    assert Bench().say(b"get-x&y") == struct.pack(">ii", 1500, -2250)
    assert Bench(text=True).say(b"get-x&y") == b"+001.500,-002.250\r"
    assert Bench(x_first=False).say(b"get-x&y") == struct.pack(">ii", -2250, 1500)


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        (b"get-flt", struct.pack(">h", 125)),
        (b"setflt4", b"OK"),
        (b"setflt0", b"\xff\xff"),
        (b"str0050", b"OK"),
        (b"str0049", b"\xff\xff"),
        (b"setzcur", b"OK"),
        (b"nothing", b"\xff\xff"),
    ],
)
def test_each_command_has_its_reply(command, reply):
    assert Bench().say(command) == reply


def test_half_a_command_is_forgotten_after_a_pause():
    bench = Bench()
    assert bench.say(b"get-", 0.11) == b""
    assert len(bench.say(b"get-x&y")) == 8


def test_its_stream_keeps_the_interval_that_was_set():
    bench = Bench(text=True)
    bench.say(b"str0050")
    bench.say(b"setcasc")
    assert bench.say(b"", 1.0).count(b"\r") == pytest.approx(20, abs=1)
    bench.say(b"stpcasc")
    bench.say(b"")
    assert bench.say(b"", 1.0) == b""


def test_a_tilt_comes_through_its_filter_and_stops_at_its_range():
    bench = Bench(x=0.0, filter=4)  # 1 Hz
    bench.device.x = 40.0
    for _ in range(4):
        bench.say(b"", 0.01)
    (early,) = struct.unpack(">i", bench.say(b"get-x&y")[:4])
    assert early == pytest.approx(40_000 * (1.0 - math.exp(-2.0 * math.pi * 0.04)), rel=1e-3)
    for _ in range(100):
        bench.say(b"", 0.01)
    assert struct.unpack(">i", bench.say(b"get-x&y")[:4]) == (30_000,)


def test_tare_takes_the_present_angle_off():
    bench = Bench()
    bench.say(b"setzcur")
    assert bench.say(b"get-x&y") == struct.pack(">ii", 0, 0)
    bench.say(b"setzfac")
    assert bench.say(b"get-x&y") == struct.pack(">ii", 1500, -2250)
