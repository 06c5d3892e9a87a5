"""The emulated MDrive: what the manual says of its replies, defaults, buffer and errors."""

import pytest

from twin.emulate.mdrive import Axis, EmulatedDrive, EmulatedMDrives


class Bench:
    """A drive and a clock of its own."""

    def __init__(self, *drives: EmulatedDrive) -> None:
        self.line = EmulatedMDrives(drives=list(drives or (EmulatedDrive(),)))
        self.now = 0.0

    def say(self, text: bytes, wait: float = 0.02) -> bytes:
        out = self.line.receive(text, self.now)
        return out + self.wait(wait)

    def wait(self, seconds: float) -> bytes:
        out = b""
        for _ in range(round(seconds / 0.001)):
            self.now += 0.001
            out += self.line.advance(self.now)
        return out


@pytest.fixture
def bench() -> Bench:
    """Party mode awake, no echo."""
    bench = Bench(EmulatedDrive(saved={"PY": 1, "EM": 1}))
    bench.say(b"\n")
    return bench


def test_the_manuals_worked_example_by_its_own_commands(bench):
    assert bench.say(b"1MA 3840000\n") == b"\r\n"
    bench.wait(5.74)
    assert bench.say(b"1PR MV\n", 0.005) == b"1\r\n"
    bench.wait(0.02)
    assert bench.say(b'1PR P,"_"MV\n') == b"3840000_0\r\n"


def test_a_drive_begins_with_its_factory_values_and_without_its_position(bench):
    assert (
        bench.say(b'1PR VI,"_"VM,"_"A,"_"D,"_"RC,"_"HC\n')
        == b"1000_768000_1000000_1000000_25_5\r\n"
    )
    bench.say(b"1VM=500000\n")
    bench.say(b"1MA 1000\n", 0.5)
    bench.line.power_cycle(bench.now)
    bench.say(b"\n")
    assert bench.say(b'1PR P,"_"VM\n') == b"0_768000\r\n"


def test_party_mode_sleeps_until_a_bare_line_feed():
    bench = Bench(EmulatedDrive(saved={"PY": 1, "EM": 1}))
    assert bench.say(b"1PR P\n") == b""
    assert bench.say(b"\n1PR P\n") == b"0\r\n"


@pytest.mark.parametrize(
    ("mode", "reply", "done"),
    [
        (0, b"1PR P\r\n0\r\n>", b"1VM=9000\r\n>"),
        (1, b"0\r\n", b"\r\n"),
        (2, b"0\r\n", b""),
        (3, b"1PR P\r\n0\r\n", b"1VM=9000\r\n"),
    ],
)
def test_each_echo_mode_answers_as_the_table_says(mode, reply, done):
    bench = Bench(EmulatedDrive(saved={"PY": 1, "EM": mode}))
    bench.say(b"\n")
    assert bench.say(b"1PR P\n") == reply
    assert bench.say(b"1VM=9000\n") == done


def test_checksums_are_asked_for_and_given(bench):
    bench.say(b"1CK=1\n")
    assert bench.say(b"1MR 1\xdf\n") == b"\x06"
    assert bench.say(b"1MR 1\xde\n") == b"\x15"
    assert bench.say(b"1PR P" + bytes([-sum(b"1PR P") & 0xFF | 0x80]) + b"\n")[:3] == b"1\xcf\r"


@pytest.mark.parametrize(
    ("command", "code"),
    [
        (b"1XY=3\n", 20),
        (b"1VM=9000000\n", 21),
        (b"1VM=1000\n", 23),
        (b"1VI=768000\n", 22),
        (b"1V=3\n", 25),
        (b"1PR XY\n", 35),
        (b"1EX AA\n", 30),
        (b"1HM 1\n", 80),
        (b"1" + 70 * b"x" + b"\n", 20),
    ],
)
def test_mistakes_have_the_manuals_codes(bench, command, code):
    bench.say(command, 0.1)
    assert bench.say(b"1PR EF\n").strip()[-1:] == b"1"
    assert bench.say(b"1PR ER\n").strip() == str(code).encode()
    assert bench.say(b"1PR EF\n").strip() == b"0"


def test_only_the_one_addressed_answers_and_all_obey_a_star():
    bench = Bench(*(EmulatedDrive(name=n, saved={"PY": 1, "EM": 1}) for n in "ab"))
    bench.say(b"\n")
    assert bench.say(b"*VM=5000\n") == b""
    assert bench.say(b"aPR VM\n") == b"5000\r\n"
    assert bench.say(b"bPR VM\n") == b"5000\r\n"
    assert bench.say(b"cPR VM\n") == b""


def test_a_drive_says_its_name_when_a_move_that_asks_for_it_is_done(bench):
    bench.say(b"1MA 1000,1\n", 0.0)
    assert bench.wait(0.3) == b"\r\n1"


def test_escape_stops_without_a_ramp_and_then_each_reply_has_an_extra_line(bench):
    bench.say(b"1SL 500000\n", 1.0)
    bench.say(b"\x1b", 0.001)
    assert bench.say(b"1PR V\n") == b"\r\n0\r\n"


def test_a_limit_switch_stops_the_stage_and_says_so():
    axis = Axis(travel=100_000)
    bench = Bench(EmulatedDrive(axis=axis, saved={"PY": 1, "EM": 1}, inputs={2: (2, 1)}))
    bench.say(b"\n")
    bench.say(b"1MA 500000\n", 2.0)
    assert bench.say(b"1PR ER\n") == b"83\r\n"
    assert axis.speed(bench.now) == 0
    assert 100_000 <= axis.carriage(bench.now) <= 120_001


def test_homing_ends_where_the_switch_opens():
    axis = Axis(position=8_000)
    saved = {"PY": 1, "EM": 1, "VM": 40_000, "VI": 5_000}
    bench = Bench(EmulatedDrive(axis=axis, saved=saved, inputs={1: (1, 0)}))
    bench.say(b"\n")
    bench.say(b"1HM 1\n", 2.0)
    assert bench.say(b'1PR MV,"_"EF\n') == b"0_0\r\n"
    assert axis.carriage(bench.now) == pytest.approx(0.0, abs=20.0)


def test_after_the_hosts_death_a_bounded_move_ends_within_its_quarter_second_and_one_ramp():
    saved = {"PY": 1, "EM": 1, "VM": 503_937, "A": 1_024_000, "D": 1_024_000}
    bench = Bench(EmulatedDrive(saved=saved))
    bench.say(b"\n")
    bench.say(b"1MA 125984\n", 0.0)  # VM x 0.25 s, and not a word afterwards
    bench.wait(0.25 + 503_937 / 1_024_000)
    assert bench.say(b'1PR MV,"_"P\n') == b"0_125984\r\n"
