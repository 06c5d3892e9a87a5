"""A line's bytes that were kept once are a device again."""

import time

import numpy as np
import pytest

from twin.cli.main import main
from twin.emulate.line import EmulatedLine
from twin.emulate.mti import EmulatedMti
from twin.emulate.replayed import ReplayedDevice, Said, spied
from twin.errors import UsageError
from twin.plant.devices.device import Sample
from twin.plant.devices.mti import MtiSettings

pytestmark = pytest.mark.wall_clock

PATIENCE = 30.0
"""For which a session is listened to [s]."""


def heard(port: str, count: int) -> tuple[list[Sample], int]:
    """Samples of a session of the driver, and the messages that failed a check."""
    session = MtiSettings(name="imu", port=port).session()
    try:
        session.configure()
        samples: list[Sample] = []
        end = time.monotonic() + PATIENCE
        while len(samples) < count and time.monotonic() < end:
            samples += session.read()
        return samples, session.counters.bad_checksums
    finally:
        session.close()


def test_a_driver_hears_from_the_replay_what_it_heard_from_the_device(tmp_path):
    port, kept = tmp_path / "port", tmp_path / "imu.spy"
    with EmulatedLine(EmulatedMti(), port):
        first, _ = heard(f"spy://{port}?file={kept}", 120)
    replayed = ReplayedDevice(spied(kept), baud=115_200)
    with EmulatedLine(replayed, port):
        again, wrong = heard(str(port), 100)
    assert wrong == 0
    assert len(again) >= 100
    for one, other in zip(first[:100], again[:100], strict=True):
        assert (other.stream, other.device_time) == (one.stream, one.device_time)
        np.testing.assert_array_equal(other.value, one.value)


def test_an_answer_comes_as_long_after_its_question_as_it_did():
    said = [Said(1.0, True, b"ask"), Said(1.2, False, b"answer"), Said(1.5, False, b"more")]
    device = ReplayedDevice(said, baud=9600)
    assert device.advance(10.0) == b""
    assert device.receive(b"as", 20.0) == b""
    assert device.receive(b"k", 21.0) == b""
    assert device.advance(21.1) == b""
    assert device.advance(21.25) == b"answer"
    assert device.advance(21.6) == b"more"
    assert device.receive(b"ask", 22.0) == b"", "it has said all"


def test_what_a_device_said_unasked_it_says_unasked():
    device = ReplayedDevice([Said(0.5, False, b"a"), Said(0.7, False, b"b")], baud=9600)
    assert device.advance(0.6) == b"a"
    device.power_cycle(2.0)
    assert device.advance(2.71) == b"ab"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time,gyro\n", r"imu\.spy:1: 'time,gyro' is no line of a spy"),
        ("000000.000 Q-RX reset_input_buffer\n", "the device says nothing in it"),
    ],
)
def test_a_file_that_no_spy_wrote_is_refused(tmp_path, text, sentence):
    path = tmp_path / "imu.spy"
    path.write_text(text)
    with pytest.raises(UsageError, match=sentence):
        spied(path)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("imu", "replay 'imu': give DEVICE=FILE"),
        ("wheel={kept}", "no device named 'wheel' (known: feather)"),
    ],
)
def test_what_cannot_be_replayed_is_told_before_anything_is_emulated(
    tmp_path, capsys, words, sentence
):
    kept = tmp_path / "kept.spy"
    kept.write_text("000000.100 RX   0000  08                                                .\n")
    assert main(["emulate", "cubesat", "--replay", words.format(kept=kept)]) == 2
    assert sentence in capsys.readouterr().err


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(UsageError, match=r"nothing\.spy: No such file"):
        spied(tmp_path / "nothing.spy")
