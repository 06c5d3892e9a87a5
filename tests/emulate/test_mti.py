"""The emulated MTi: the vendor's bytes in and out, its states, and what it refuses."""

import pytest

from twin.emulate.mti import EmulatedMti, frame, number

TO_CONFIG, CONFIG = "FA FF 30 00 D1", "FA FF 31 00 D0"
TO_MEASUREMENT, MEASUREMENT = "FA FF 10 00 F1", "FA FF 11 00 F0"
WAKE_UP, WAKE_UP_ACKNOWLEDGE = "FA FF 3E 00 C3", "FA FF 3F 00 C2"
ASK_ALL = "FA FF C0 18 10 20 FF FF 10 60 FF FF 20 10 00 64 80 20 00 64 40 20 00 64 C0 20 00 64 ED"


class Bench:
    """A unit and a clock of its own."""

    def __init__(self, **fields) -> None:
        self.device, self.now = EmulatedMti(**fields), 0.0

    def say(self, text: str, wait: float = 0.005) -> bytes:
        out = self.device.receive(bytes.fromhex(text), self.now)
        self.now += wait
        return out + self.device.advance(self.now)


@pytest.fixture
def bench() -> Bench:
    """In Config."""
    bench = Bench(has_orientation=True)
    assert bench.say(TO_CONFIG)[-5:] == bytes.fromhex(CONFIG)
    return bench


def test_it_wakes_up_and_stays_in_config_if_somebody_is_there():
    bench = Bench()
    assert bench.say("") == bytes.fromhex(WAKE_UP)
    bench.say(WAKE_UP_ACKNOWLEDGE)
    assert bench.say("", 2.0) == b""


def test_it_measures_as_stored_if_nobody_is_there():
    bench = Bench()
    bench.say("", 0.501)
    assert bench.say("", 0.1).startswith(b"\xfa\xff\x36")


def test_the_published_configuration_gives_packets_of_the_published_length(bench):
    acknowledged = bench.say(ASK_ALL)
    assert acknowledged == frame(0xC1, bytes.fromhex(ASK_ALL)[4:-1])
    assert bench.say(TO_MEASUREMENT) == bytes.fromhex(MEASUREMENT)
    packets = bench.say("", 1.0)
    assert len(packets) == 100 * 81
    assert packets[:10] == bytes.fromhex("FA FF 36 4C 10 20 02 00 01 10")


def test_more_than_the_line_carries_is_error_29(bench):
    twice = bytes.fromhex(ASK_ALL)[4:-1].replace(b"\x00\x64", b"\x00\xc8")
    assert bench.say(frame(0xC0, twice).hex()) == frame(0x42, b"\x29")


def test_a_model_without_orientation_refuses_it():
    bench = Bench(has_orientation=False)
    bench.say(TO_CONFIG)
    assert bench.say(ASK_ALL) == frame(0x42, b"\x21")


def test_requests_while_it_measures_are_not_answered(bench):
    bench.say(TO_MEASUREMENT)
    assert b"\x01" + b"\x04" not in bench.say("FA FF 00 00 01", 0.001)


def test_a_new_baud_rate_holds_from_the_next_start_on(bench):
    assert bench.say("FA FF 18 01 05 E3") == frame(0x19)
    assert bench.device.baud == 115200
    bench.say("FA FF 40 00 C1")
    assert bench.device.baud == 38400


def test_an_unknown_message_is_error_4(bench):
    assert bench.say(frame(0x77).hex()) == bytes.fromhex("FA FF 42 01 04 BA")


@pytest.mark.parametrize(
    ("code", "value", "bytes_"),
    [
        (0, 9.81, "41 1C F5 C3"),
        (1, 1.5, "00 18 00 00"),
        (1, -1.0, "FF F0 00 00"),
        (2, 1.5, "80 00 00 00 00 01"),
        (2, -0.5, "80 00 00 00 FF FF"),
        (3, 1.0, "3F F0 00 00 00 00 00 00"),
    ],
)
def test_numbers_have_the_order_of_bytes_that_the_vendor_gives(code, value, bytes_):
    assert number(value, code) == bytes.fromhex(bytes_)
