"""VN-100 and BNO08x against their documents' bytes, and against their emulations on a pty."""

import binascii
import struct
from contextlib import closing

import numpy as np
import pytest

from tests.plant.devices.swing import PERIOD, Swing, attitude_at, rate_at
from twin.emulate.emulated import Fault
from twin.emulate.imus import EmulatedBno08x, EmulatedVn100, _crc
from twin.errors import DeviceError, UsageError
from twin.plant.devices.bno08x import Bno08xSettings, RvcParser
from twin.plant.devices.counters import Counters
from twin.plant.devices.vn100 import BinaryParser, Vn100Settings, checked, decode_answer

TIMES = PERIOD * np.arange(3000)
ATTITUDES = np.array([attitude_at(time) for time in TIMES])
RATES = np.array([rate_at(time) for time in TIMES])


def nearest(values: np.ndarray, true: np.ndarray) -> float:
    """Largest distance of a value to the nearest that there was."""
    return max(float(np.abs(true - value).max(axis=1).min()) for value in values)


def of(samples, stream):
    values = np.array([s.value for s in samples if s.valid and s.stream == stream])
    return values * np.sign(values[:, :1]) if stream == "attitude" else values


def test_the_data_sheets_packet_of_a_bno08x_is_read():
    counters = Counters()
    packet = bytes.fromhex("AAAADE0100 92FF2508 8DFEECFFD103 000000E7".replace(" ", ""))
    (values,) = RvcParser(counters).feed(packet)
    assert values == (0xDE, 1, -110, 2085, -371, -20, 977)
    assert counters.frames == 1
    assert not RvcParser(counters).feed(packet[:-1] + b"\xe8")
    assert counters.bad_checksums == 1


def test_the_manuals_message_of_a_vn100_has_the_checksum_that_is_used():
    data = bytes.fromhex("FA010800 93502E42 833EF13F 48B504BB 9288".replace(" ", ""))
    assert _crc(data[1:-2]) == int.from_bytes(data[-2:], "big")
    assert binascii.crc_hqx(data[1:], 0) == 0


def test_commands_of_a_vn100_have_their_checksum():
    assert checked("VNRRG,01") == b"$VNRRG,01*72\r\n"
    assert decode_answer(b"\x00\xfa$VNRRG,01*72\r") == "VNRRG,01"
    assert decode_answer(b"$VNRRG,01*73\r") is None


@pytest.mark.wall_clock
def test_a_vn100_gives_attitude_rate_and_force(plug, wait_for, tmp_path):
    device = EmulatedVn100(
        Swing("attitude", "gyro"),
        (
            "attitude",
            "gyro",
        ),
    )
    plug(device)
    with (
        closing(
            Vn100Settings(name="imu", port=str(tmp_path / "port"), magnetometer=True).session()
        ) as session,
    ):
        session.configure()
        samples = wait_for(session, lambda seen: len(seen) >= 200)
    assert session.identity == "VN-100S-CR"
    assert nearest(of(samples, "attitude"), ATTITUDES * np.sign(ATTITUDES[:, :1])) < 1e-6
    assert nearest(of(samples, "gyro"), RATES) < 1e-6
    np.testing.assert_allclose(of(samples, "magnetometer")[0], (2e-5, 0.0, -4e-5), rtol=1e-6)
    assert session.counters.bad_checksums == 0


@pytest.mark.wall_clock
def test_a_bno08x_gives_attitude_and_force(plug, wait_for, tmp_path):
    plug(EmulatedBno08x(Swing("attitude"), ("attitude",)))
    with (
        closing(Bno08xSettings(name="imu", port=str(tmp_path / "port")).session()) as session,
    ):
        session.configure()
        samples = wait_for(session, lambda seen: len(seen) >= 100)
    # angles are told to 0.01 deg
    assert nearest(of(samples, "attitude"), ATTITUDES * np.sign(ATTITUDES[:, :1])) < 2e-4
    np.testing.assert_allclose(of(samples, "accelerometer")[0], (0, 0, 9.80665), atol=1e-9)


@pytest.mark.wall_clock
@pytest.mark.parametrize("kind", ["vn100", "bno08x"])
def test_over_a_noisy_line_nothing_wrong_is_believed(kind, plug, wait_for, tmp_path):
    port = str(tmp_path / "port")
    if kind == "vn100":
        device = EmulatedVn100(Swing("attitude", "gyro"), ("attitude", "gyro"))
        settings = Vn100Settings(name="imu", port=port)
    else:
        device = EmulatedBno08x(Swing("attitude"), ("attitude",))
        settings = Bno08xSettings(name="imu", port=port)
    faults = [
        Fault("silence", 0.5, 0.2),
        Fault("drop", 0.9, 0.3, share=0.01),
        Fault("duplicate", 1.3, 0.3, share=0.01),
    ]
    # eight bits of checksum would let one damaged packet in 256 through
    faults = faults if kind == "vn100" else faults[:1]
    plug(device, *faults, seed=1)
    with closing(settings.session()) as session:
        session.configure()
        samples = wait_for(
            session, lambda seen: sum(s.valid for s in seen) >= (400 if kind == "vn100" else 200)
        )
    assert nearest(of(samples, "attitude"), ATTITUDES * np.sign(ATTITUDES[:, :1])) < 2e-4
    assert session.counters.gaps > 0


def test_rates_that_a_vn100_or_its_line_has_not_are_refused():
    for changed, why in {"rate": 300, "serial_port": 3, "baud": 9600}.items():
        with pytest.raises(UsageError):
            Vn100Settings(name="imu", port="p", **{changed: why})


@pytest.mark.wall_clock
def test_a_line_without_the_unit_says_what_to_look_at(plug, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.plant.devices.vn100._TRIES", 1)
    plug(EmulatedBno08x(Swing("attitude"), ("attitude",)))
    with pytest.raises(DeviceError, match="115200 baud"):
        Vn100Settings(name="imu", port=str(tmp_path / "port")).session().connect()


def test_a_message_that_arrives_byte_by_byte_is_read_once():
    device = EmulatedVn100(
        Swing("attitude", "gyro"),
        (
            "attitude",
            "gyro",
        ),
    )
    device.receive(b"$VNWRG,75,1,8,01,0131*" + b"%02X\r\n" % _xor(b"VNWRG,75,1,8,01,0131"), 0.0)
    data = device.advance(0.05)
    parser = BinaryParser(Counters(), 0x0131)
    payloads = [each for byte in data for each in parser.feed(bytes([byte]))]
    assert len(payloads) == 6
    assert [struct.unpack_from("<Q", each)[0] for each in payloads] == [
        10_000_000 * k + 1 for k in range(6)
    ]


def _xor(text: bytes) -> int:
    code = 0
    for byte in text:
        code ^= byte
    return code
