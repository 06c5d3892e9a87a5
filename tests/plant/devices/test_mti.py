"""A session with an MTi against its emulation: over a pty, in another process, at 115,200 baud."""

import math

import numpy as np
import pytest

from twin.emulate.emulated import Fault
from twin.emulate.mti import EmulatedMti
from twin.errors import CommandError, DeviceError, UnknownName, UsageError
from twin.plant.devices.mti import Mti, MtiSettings

pytestmark = pytest.mark.wall_clock

RATE, GRAVITY = (0.01, -0.02, 0.03), (0.0, 0.0, 9.81)


@pytest.fixture
def mti(tmp_path):
    """A session, closed in the end; the keywords are settings."""
    opened = []

    def build(**settings) -> Mti:
        port = settings.pop("port", str(tmp_path / "port"))
        session = MtiSettings(name="imu", port=port, **settings).session()
        opened.append(session)
        return session

    yield build
    for session in opened:
        session.close()


@pytest.fixture
def running(plug, mti):
    """Line and session that measures; positional arguments are faults of the line."""

    def build(*faults: Fault, device: EmulatedMti | None = None, **settings):
        line = plug(device or EmulatedMti(), *faults)
        session = mti(**settings)
        session.configure()
        return line, session

    return build


def valid(samples, stream="gyro"):
    return [each for each in samples if each.valid and each.stream == stream]


def sound(samples):
    """No valid sample is anything but noise about the truth."""
    for stream, mean in (("gyro", RATE), ("accelerometer", GRAVITY)):
        values = np.array([each.value for each in valid(samples, stream)])
        assert not len(values) or np.max(np.abs(values - mean)) < 0.02, "a wrong value is valid"
    return True


@pytest.mark.parametrize("precision", ["float32", "fp12.20", "fp16.32", "float64"])
def test_values_times_and_rate_come_through_in_every_number_format(running, wait_for, precision):
    _, session = running(precision=precision)
    samples = wait_for(session, lambda got: len(valid(got)) >= 40)
    assert sound(samples)
    times = [each.device_time for each in valid(samples)]
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-9)
    assert session.counters.bad_checksums == session.counters.gaps == 0
    assert all(0.0 < each.latency < 0.02 for each in samples)


def test_items_of_different_rates_come_each_at_its_own(running, wait_for):
    _, session = running(rates={"gyro": 100, "accelerometer": 50, "temperature": 10})
    samples = wait_for(session, lambda got: len(valid(got, "temperature")) >= 4)
    gyro, acceleration = len(valid(samples)), len(valid(samples, "accelerometer"))
    assert gyro == pytest.approx(2 * acceleration, abs=4)
    assert valid(samples, "temperature")[0].value[0] == pytest.approx(298.15, abs=0.1)


def test_the_magnetic_field_is_in_tesla(running, wait_for):
    _, session = running(rates={"magnetometer": 50}, magnetic_unit=48e-6)
    samples = wait_for(session, lambda got: len(got) >= 5)
    assert samples[0].value == pytest.approx((24e-6, 0.0, 24e-6), abs=1e-6)


def test_attitude_is_given_by_a_model_that_has_it_and_refused_by_one_that_has_not(
    running, wait_for, mti
):
    _, session = running(
        device=EmulatedMti(has_orientation=True), rates={"attitude": 50}, frozen_after=0
    )
    assert wait_for(session, len)[0].value == (1.0, 0.0, 0.0, 0.0)


def test_a_model_without_orientation_refuses_it_with_a_reason(plug, mti):
    plug(EmulatedMti())
    with pytest.raises(DeviceError, match="imu: refuses SET_OUTPUT_CONFIGURATION: a parameter"):
        mti(rates={"attitude": 50}).configure()


def test_the_unit_that_is_meant_is_told_from_another(plug, mti):
    plug(EmulatedMti(device_id=0x03880011))
    session = mti(device_id=0x03880012)
    with pytest.raises(DeviceError, match="is 03880011, not 03880012; check which port"):
        session.connect()


def test_one_that_streams_already_is_stopped_and_configured(running, mti, wait_for):
    line, first = running()
    wait_for(first, len)
    first.close()
    second = mti()
    second.configure()
    assert sound(wait_for(second, lambda got: len(valid(got)) >= 10))
    assert line


def test_connecting_twice_in_a_row_works_after_every_close(running, wait_for):
    _, session = running()
    for _ in range(2):
        session.close()
        session.connect()
        session.connect()
        session.configure()
        assert sound(wait_for(session, lambda got: len(valid(got)) >= 5))


def test_a_port_that_is_not_there_is_one_sentence(mti):
    with pytest.raises(DeviceError, match="imu: cannot open /nowhere .No such file .*check the"):
        mti(port="/nowhere").connect()


def test_two_sessions_on_one_port_are_refused(running, mti):
    running()
    with pytest.raises(DeviceError, match=r"imu: cannot open .*; close the other program"):
        mti().connect()


def test_a_device_that_is_silent_is_asked_after(plug, mti, monkeypatch):
    monkeypatch.setattr("twin.plant.devices.mti._TRIES", 3)
    plug(EmulatedMti(), Fault("silence"))
    with pytest.raises(DeviceError, match="no answer to GO_TO_CONFIG in 0.3 s, 0 bytes arrived"):
        mti().connect()


def test_another_baud_rate_is_guessed_at(plug, mti, monkeypatch):
    monkeypatch.setattr("twin.plant.devices.mti._TRIES", 3)
    plug(EmulatedMti(baud=921600))
    with pytest.raises(DeviceError, match=r"[1-9]\d* bytes arrived; does it talk at 115200 baud"):
        mti().connect()


@pytest.mark.parametrize(
    ("fault", "value", "counter"),
    [
        ("bad_checksum", 3, "bad_checksums"),
        ("truncated", 2, "bad_checksums"),
        ("drop_packets", 4, "gaps"),
    ],
)
def test_lost_packets_are_counted_and_the_rest_is_sound(running, wait_for, fault, value, counter):
    line, session = running()
    line.inject(Fault(fault, start=0.1, value=value))
    samples = wait_for(session, lambda got: len(valid(got)) >= 40)
    assert sound(samples)
    assert getattr(session.counters, counter) >= (value if fault != "truncated" else 1)
    assert session.counters.gaps >= 1


def test_a_packet_sent_twice_counts_once(running, wait_for):
    line, session = running()
    line.inject(Fault("duplicate_packets", value=10))
    samples = valid(wait_for(session, lambda got: len(valid(got)) >= 30))
    times = [each.device_time for each in samples]
    assert len(set(times)) == len(times)


def test_a_preamble_inside_the_data_is_data(running, wait_for):
    line, session = running(rates={"gyro": 50, "temperature": 50})
    line.inject(Fault("inner_preamble"))
    samples = wait_for(
        session, lambda got: any(s.value[0] > 300.0 for s in got if s.stream == "temperature")
    )
    assert sound(samples)
    assert session.counters.bad_checksums == 0


def test_the_devices_clock_wraps_unseen(running, wait_for):
    line, session = running()
    line.inject(Fault("time_wrap"))
    line.inject(Fault("time_wrap"))
    samples = wait_for(session, lambda got: len(valid(got)) >= 60)
    steps = np.diff([each.device_time for each in valid(samples)])
    usual = steps[np.abs(steps - 0.01) < 1e-6]
    assert len(usual) >= len(steps) - 4, "no step but the two that the test makes"


def test_a_small_step_back_of_the_devices_clock_is_passed_on(running, wait_for):
    line, session = running()
    line.inject(Fault("time_step_back", start=0.1, value=500))
    samples = wait_for(session, lambda got: len(valid(got)) >= 40)
    assert min(np.diff([each.device_time for each in valid(samples)])) == pytest.approx(-0.04)


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("not_a_number", "imu: gyro not a number"),
        ("saturated", "imu: gyro saturated: 34.91 at a full scale of 34.91"),
        ("frozen", "imu: gyro the same for 20 samples: the sensor has stopped"),
    ],
)
def test_a_sick_sensor_gives_reasons_instead_of_values(running, wait_for, reasons, fault, reason):
    line, session = running()
    line.inject(Fault(fault, start=0.05))
    assert reason in reasons(wait_for(session, lambda got: reason in reasons(got)))
    line.inject(Fault("well"))
    assert sound(wait_for(session, lambda got: len(valid(got)) >= 5)[-5:])


def test_a_restart_in_the_stream_is_configured_again_and_told(running, wait_for):
    line, session = running()
    line.inject(Fault("restart", start=0.05))
    samples = wait_for(session, lambda got: session.notes and len(valid(got)) >= 30)
    assert sound(samples)
    assert session.notes[0] == "imu: restarted by itself, and was configured again"
    assert session.fault == ""


def test_a_complaint_of_the_device_is_told(running, wait_for):
    line, session = running()
    line.inject(Fault("error", value=0x29))
    wait_for(session, lambda got: session.notes)
    assert session.notes[0] == "imu: reports more data than the line can carry (code 29)"


def test_bursts_of_the_adapter_lose_nothing(running, wait_for):
    _, session = running(Fault("burst"))
    samples = wait_for(session, lambda got: len(valid(got)) >= 50)
    assert sound(samples)
    assert session.counters.gaps == session.counters.bad_checksums == 0


@pytest.mark.parametrize("kind", ["drop", "duplicate", "garble"])
def test_a_bad_cable_gives_gaps_not_wrong_values(running, wait_for, kind):
    line, session = running(largest_steps={"gyro": 0.01, "accelerometer": 0.1})
    line.inject(Fault(kind, share=0.003))
    samples = wait_for(session, lambda got: len(valid(got)) >= 60)
    assert sound(samples)
    assert session.counters.bad_checksums > 0
    assert session.counters.resyncs > 0


def test_silence_gives_invalid_samples_and_no_old_value(running, wait_for, reasons):
    line, session = running()
    wait_for(session, len)
    line.inject(Fault("silence", duration=0.5))
    samples = wait_for(session, lambda got: "imu: nothing usable for" in reasons(got))
    bad = [each for each in samples if not each.valid]
    assert all(math.isnan(number) for each in bad for number in each.value)
    assert {each.stream for each in bad} == {"gyro", "accelerometer"}
    assert session.counters.timeouts >= 1
    assert sound(wait_for(session, lambda got: len(valid(got)) >= 5))


def test_an_unplugged_port_is_a_reason_and_connecting_anew_works_twice(
    running, wait_for, reasons, tmp_path
):
    line, session = running()
    for _ in range(2):
        wait_for(session, lambda got: len(valid(got)) >= 3)
        line.inject(Fault("unplug", duration=0.2))
        samples = wait_for(session, lambda got: "imu: lost" in reasons(got))
        assert session.fault == samples[-1].reason
        assert "plug it in again, then connect anew" in session.fault
        assert session.read() == [], "no old value afterwards"
        wait_for(session, lambda got: (tmp_path / "port").exists())
        session.connect()
        session.configure()
        assert session.fault == ""


@pytest.mark.parametrize(
    ("settings", "error", "sentence"),
    [
        ({"rates": {"gyros": 100}}, UnknownName, "did you mean 'gyro'"),
        ({"rates": {"gyro": 0}}, UsageError, "gyro at 0 Hz; give 1 to 65534 Hz"),
        ({"precision": "double"}, UnknownName, "no number format named 'double'"),
        ({"baud": 56000}, UsageError, "56000 baud; an MTi has 9600"),
        ({"rates": {"magnetometer": 10}}, UsageError, "give that field's strength"),
        ({"rates": {"gyro": 400}}, UsageError, "need 111 % of a line of 115200 baud"),
    ],
)
def test_settings_that_cannot_work_are_refused_before_the_port_is_opened(
    mti, settings, error, sentence
):
    with pytest.raises(error, match=sentence):
        mti(**settings)


def test_a_sensor_takes_no_command(mti):
    with pytest.raises(CommandError, match="imu only measures, it takes no command_dipole"):
        mti().write({"command_dipole": np.zeros(3)})
