"""The emulated line: bytes take their time, settings must agree, faults are those of the seed."""

import ast
import os
import sys
import termios
import time
from pathlib import Path

import numpy as np
import pytest
import serial

import twin.emulate.line as line_module
from twin.emulate.emulated import LINE_FAULTS, EmulatedDevice, Fault, Wire, schedule
from twin.emulate.line import EmulatedLine, PacedQueue, Server
from twin.emulate.mti import EmulatedMti
from twin.emulate.solar2 import EmulatedSolar2
from twin.errors import DeviceError, UnknownName, UsageError

EMULATE = Path(line_module.__file__).parent
MESSAGE = bytes(range(100))


@pytest.mark.parametrize("file", sorted(EMULATE.glob("*.py")), ids=lambda file: file.stem)
def test_no_emulation_is_written_with_the_drivers_code(file):
    tree = ast.parse(file.read_text(encoding="utf-8"))
    # what a laboratory states of a device is neither side's
    sources = {
        node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        and not all(alias.name.endswith("Settings") for alias in node.names)
    }
    vendors = ("xbus", "mti", "mdrive", "solar2", "port", "sensor")
    drivers = tuple(f"twin.plant.devices.{vendor}" for vendor in vendors)
    assert not [source for source in sources if source and source.startswith(drivers)]


def test_bytes_take_their_time_one_after_the_other():
    queue = PacedQueue()
    queue.send(b"abc", 1.0, 0.1)
    queue.send(b"d", 1.05, 0.1)
    assert queue.arrived(1.09) == b""
    assert queue.arrived(1.25) == b"ab"
    assert queue.arrived(1.29) == b""
    assert queue.arrived(1.45) == b"cd"


def test_a_line_of_9600_baud_needs_a_second_for_960_bytes(tmp_path):
    device = EmulatedSolar2(baud=9600, text=True, streaming=True, interval=0.015)
    now, size = 0.0, 0
    with (
        EmulatedLine(device, tmp_path / "port", lockstep=True) as line,
        serial.Serial(str(tmp_path / "port"), 9600, timeout=0.1),
    ):
        while now < 1.0:
            told = line.go_on(1.0, 0)
            assert told is not None, "the emulation is gone"
            now, size = told
    assert size == pytest.approx(960, abs=20), "18 bytes each 15 ms, 1200 a second, overfill it"


@pytest.mark.wall_clock
def test_a_host_at_another_rate_gets_garbage(tmp_path):
    with (
        EmulatedLine(EmulatedMti(), tmp_path / "port"),
        serial.Serial(str(tmp_path / "port"), 57600, timeout=1.0) as port,
    ):
        heard = port.read(400)
    assert heard
    assert b"\xfa\xff\x36" not in heard


@pytest.mark.wall_clock
def test_a_host_at_the_same_rate_is_heard_whichever_that_is(tmp_path):
    with (
        EmulatedLine(EmulatedSolar2(baud=1_000_000), tmp_path / "port"),
        serial.Serial(str(tmp_path / "port"), 1_000_000, timeout=1.0) as port,
    ):
        port.write(b"get-x&y")
        assert len(port.read(8)) == 8


def test_a_schedule_is_the_same_for_the_same_seed_and_another_for_another():
    def faults(seed):
        return schedule(seed, LINE_FAULTS, span=60.0, mean_gap=2.0, duration=0.3, share=0.1)

    assert faults(1) == faults(1) != faults(2)
    assert 15 < len(faults(1)) < 50
    assert all(0.0 <= fault.start < 60.0 and fault.kind in LINE_FAULTS for fault in faults(1))


def carry(*faults, now=1.0, matched=True, seed=0):
    return Wire(list(faults), seed).carry(MESSAGE, now, matched=matched)


def test_a_sound_wire_carries_everything():
    assert carry() == MESSAGE
    assert carry(Fault("drop", start=2.0), Fault("garble", duration=0.5)) == MESSAGE


@pytest.mark.parametrize(
    ("kind", "low", "high"), [("drop", 60, 95), ("duplicate", 105, 140), ("garble", 100, 100)]
)
def test_each_fault_hits_its_share_of_the_bytes(kind, low, high):
    carried = carry(Fault(kind, share=0.2))
    assert low <= len(carried) <= high
    assert carried != MESSAGE
    assert carried == carry(Fault(kind, share=0.2)), "the seed decides"


def test_silence_carries_nothing_and_a_mismatch_no_byte_as_it_was():
    assert carry(Fault("silence")) == b""
    garbage = carry(matched=False)
    assert garbage
    assert garbage not in MESSAGE


def test_a_kind_that_no_line_has_is_refused():
    with pytest.raises(UnknownName, match="no line fault named 'dropp'"):
        Wire([]).active("dropp", 0.0)
    with pytest.raises(UnknownName, match="no fault of an MTi named 'stall'"):
        EmulatedMti().inject("stall")
    with pytest.raises(UnknownName, match="no fault of a SOLAR-2 named 'stall'"):
        EmulatedSolar2().inject("stall")


def test_raw_bytes_of_both_directions_are_logged(tmp_path):
    with (
        EmulatedLine(EmulatedSolar2(), tmp_path / "port", log=tmp_path / "log"),
        serial.Serial(str(tmp_path / "port"), 38400, timeout=1.0) as port,
    ):
        port.write(b"get-x&y")
        reply = port.read(8)
    lines = (tmp_path / "log").read_text().splitlines()
    for mark, data in (("<", b"get-x&y"), (">", reply)):
        logged = b"".join(bytes.fromhex(each[1:]) for each in lines if each[0] == mark)
        assert logged == data


def refused():
    raise UsageError("no such machine")


def ended():
    raise SystemExit(3)


def test_what_an_emulation_refuses_is_told_where_it_was_asked_for(tmp_path, capfd):
    with (
        pytest.raises(UsageError, match="^no such machine$"),
        EmulatedLine(refused, tmp_path / "port"),
    ):
        pass
    assert "Traceback" not in capfd.readouterr().err


def test_an_emulation_that_ends_or_does_not_come_up_is_a_device_that_is_not_there(
    tmp_path, monkeypatch
):
    with (
        pytest.raises(DeviceError, match="port: ended before its ports were there"),
        EmulatedLine(ended, tmp_path / "port"),
    ):
        pass
    monkeypatch.setattr(line_module, "_START", 0.0)
    line = EmulatedLine(EmulatedMti, tmp_path / "port")
    with pytest.raises(DeviceError, match="port: did not start within 0 s"), line:
        pass
    assert not line.alive


def exhaust(port):
    while port.read(1000):
        pass
    port.read(1000)


def test_an_emulation_that_is_killed_ends_the_port(tmp_path):
    line = EmulatedLine(EmulatedMti(), tmp_path / "port")
    with line, serial.Serial(str(tmp_path / "port"), 115200, timeout=10.0) as port:
        assert port.read(10)
        line.kill()
        with pytest.raises(serial.SerialException):
            exhaust(port)


class Heard(EmulatedDevice):
    """Keeps when each byte came."""

    def __init__(self) -> None:
        self.baud, self.times = 1_000_000, []

    def receive(self, data: bytes, now: float) -> bytes:
        self.times += [now] * len(data)
        return b""

    def advance(self, now: float) -> bytes:
        return b""

    def power_cycle(self, now: float) -> None:
        raise NotImplementedError

    def inject(self, fault: str, value: float = 0.0) -> None:
        raise NotImplementedError


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_what_came_while_the_process_stood_still_is_heard_evenly_over_that_time(
    tmp_path, monkeypatch
):
    device, now = Heard(), [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    server = Server(device, tmp_path / "port", (), 0, start=100.0)
    host = os.open(tmp_path / "port", os.O_RDWR | os.O_NOCTTY)
    attributes = termios.tcgetattr(host)
    attributes[4] = attributes[5] = termios.B1000000
    termios.tcsetattr(host, termios.TCSANOW, attributes)
    server.step()
    os.write(host, b"x" * 100)
    now[0] += 0.5
    server.step()
    now[0] += 0.01
    server.step()
    os.close(host)
    assert len(device.times) == 100
    assert np.diff(device.times).max() < 0.02, "no set-point of 50 ms would have run out"
    assert device.times[0] < 0.05
    assert server.stalled == pytest.approx(0.5)
