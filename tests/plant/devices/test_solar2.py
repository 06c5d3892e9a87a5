"""A session with a SOLAR-2 against its emulation, over a pty at 38,400 baud."""

import math

import numpy as np
import pytest

from twin.emulate.emulated import Fault
from twin.emulate.solar2 import EmulatedSolar2
from twin.errors import DeviceError, UsageError
from twin.plant.devices.solar2 import Solar2, Solar2Settings

pytestmark = pytest.mark.wall_clock

TILT = (math.radians(1.5), math.radians(-2.25))


@pytest.fixture
def solar(tmp_path):
    """A session, closed in the end; the keywords are settings."""
    opened = []

    def build(**settings) -> Solar2:
        opened.append(
            Solar2Settings(name="tilt", port=str(tmp_path / "port"), **settings).session()
        )
        return opened[-1]

    yield build
    for session in opened:
        session.close()


@pytest.fixture
def running(plug, solar):
    """Line and session that measures."""

    def build(*faults, device=None, **settings):
        line = plug(device or EmulatedSolar2(), *faults)
        session = solar(**settings)
        session.configure()
        return line, session

    return build


def valid(samples):
    return [each.value for each in samples if each.valid]


def sound(samples, degrees=0.1):
    values = np.array(valid(samples)).reshape(-1, 2)
    assert np.max(np.abs(values - TILT), initial=0.0) < math.radians(degrees), (
        "a wrong value is valid"
    )
    return True


@pytest.mark.parametrize("mode", ["binary", "text"])
def test_asked_in_either_form_it_gives_both_angles_at_the_rate(running, wait_for, mode):
    _, session = running(device=EmulatedSolar2(text=mode == "text"), mode=mode)
    samples = wait_for(session, lambda got: len(valid(got)) >= 20)
    assert not samples[0].valid
    assert "the first" in samples[0].reason, "nothing yet supports it"
    assert sound(samples)
    # a busy computer may ask late, and never early
    assert samples[-1].host_time - samples[0].host_time > 0.05 * (len(samples) - 1) - 0.02


def test_a_stream_is_followed_at_twenty_hertz(running, wait_for):
    device = EmulatedSolar2(text=True, streaming=True, interval=0.05)
    _, session = running(device=device, mode="stream")
    samples = wait_for(session, lambda got: len(valid(got)) >= 30)
    assert sound(samples)
    # those that a busy computer hands over late come together
    steps = np.diff([each.host_time for each in samples])
    assert np.mean(steps) == pytest.approx(0.05, abs=0.02)


def test_a_stream_is_started_only_when_it_may_be(plug, solar, wait_for):
    plug(EmulatedSolar2())
    with pytest.raises(DeviceError, match="tilt: no angles on .*; no answer"):
        solar(mode="stream").connect()
    session = solar(mode="stream", start_stream=True)
    session.configure()
    assert sound(wait_for(session, lambda got: len(valid(got)) >= 5))
    session.close()
    with pytest.raises(DeviceError, match="no answer"):
        solar(mode="stream").connect()


def test_the_order_of_the_axes_is_a_setting(running, wait_for):
    _, session = running(device=EmulatedSolar2(x_first=False), x_first=False)
    assert sound(wait_for(session, lambda got: len(valid(got)) >= 3))


@pytest.mark.parametrize(
    ("device", "settings", "told"),
    [
        (EmulatedSolar2(text=True), {}, "it answers in text; set the mode to text"),
        (EmulatedSolar2(), {"mode": "text"}, "it answers in binary; set the mode to binary"),
        (EmulatedSolar2(), {"baud": 9600}, "tilt: no angles on"),
    ],
)
def test_a_unit_that_is_set_otherwise_is_told_at_once(plug, solar, device, settings, told):
    plug(device)
    with pytest.raises(DeviceError, match=told):
        solar(**settings).connect()


@pytest.mark.parametrize(
    ("fault", "value", "reason"),
    [
        ("short_reply", 4, "7 bytes that are no answer"),
        ("text", 0, "it answers in text"),
        ("nmea", 0, "no answer"),
        ("saturated", 0, "saturated: 0.5236 at a full scale of 0.5236"),
        ("stale", 0, "the same for 10 samples: the sensor has stopped"),
        ("baud", 9600, "tilt: "),
    ],
)
def test_a_sick_unit_gives_reasons_instead_of_values(
    running, wait_for, reasons, fault, value, reason
):
    line, session = running(frozen_after=10)
    line.inject(Fault(fault, start=0.05, value=value))
    samples = wait_for(session, lambda got: reason in reasons(got))
    assert sound(samples)
    if fault in ("saturated", "stale"):
        line.inject(Fault("well"))
        samples = wait_for(session, lambda got: len(valid(got)) >= 3)
        assert sound(samples)


@pytest.mark.parametrize("kind", ["drop", "duplicate", "garble"])
@pytest.mark.parametrize("mode", ["binary", "text"])
def test_a_bad_cable_gives_reasons_and_no_wrong_value(running, wait_for, mode, kind):
    line, session = running(device=EmulatedSolar2(text=mode == "text"), mode=mode)
    line.inject(Fault(kind, share=0.02))
    samples = wait_for(session, lambda got: len(got) > len(valid(got)) >= 3)
    assert sound(samples, degrees=0.25), "the two readings may differ by 0.2 deg"


def test_silence_gives_reasons_and_then_values_again(running, wait_for, reasons):
    line, session = running()
    line.inject(Fault("silence", duration=1.0))
    bad = wait_for(session, lambda got: "tilt: no answer" in reasons(got))
    assert all(math.isnan(number) for each in bad if not each.valid for number in each.value)
    assert sound(wait_for(session, lambda got: len(valid(got)) >= 3))
    assert session.counters.timeouts >= 1


def test_bursts_of_the_adapter_lose_nothing(running, wait_for):
    _, session = running(Fault("burst"))
    samples = wait_for(session, lambda got: len(valid(got)) >= 8)
    assert sound(samples)
    assert len(valid(samples)) == len(samples) - 1, "the first has nothing to support it"


def test_unplugging_is_a_reason_and_connecting_anew_works(running, wait_for, reasons, tmp_path):
    line, session = running()
    line.inject(Fault("unplug", duration=0.2))
    wait_for(session, lambda got: "tilt: lost" in reasons(got))
    wait_for(session, lambda got: (tmp_path / "port").exists())
    session.configure()
    assert sound(wait_for(session, lambda got: len(valid(got)) >= 3))


def test_a_rate_that_the_line_cannot_carry_is_refused(solar):
    with pytest.raises(UsageError, match="tilt: 100 Hz; in mode binary at 38400 baud it gives 0.1"):
        solar(rate=100.0)


def test_a_stream_slower_than_the_unit_can_be_told_is_refused(solar):
    with pytest.raises(UsageError, match="tilt: 0.1 Hz; in mode stream .* it gives 0.10001 to 20"):
        solar(mode="stream", start_stream=True, rate=0.1)
    solar(mode="stream", rate=0.1)
