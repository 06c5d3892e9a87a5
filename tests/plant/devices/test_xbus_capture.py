"""Packets that a real MTi sent: their check holds, and their numbers agree with each other."""

from pathlib import Path

import numpy as np
import pytest

from twin.plant.devices.device import Counters
from twin.plant.devices.xbus.data import decode_data
from twin.plant.devices.xbus.frames import FrameParser

CAPTURE = Path(__file__).parent / "captures" / "mti.hex"
COUNTER, FINE_TIME = 0x1020, 0x1060
GAINED, FORCE, RATE, TURNED = 0x4010, 0x4020, 0x8020, 0x8030
"""Velocity and turn over a sample; specific force and rate as its mean."""
PERIOD = 0.01
"""[s]."""


@pytest.fixture(scope="module")
def packets() -> list[dict[int, np.ndarray]]:
    counters = Counters()
    heard = FrameParser(counters).feed(bytes.fromhex(CAPTURE.read_text()))
    assert counters.frames == 2
    assert not counters.bad_checksums
    return [{item.kind: np.array(item.values) for item in decode_data(m.data)} for m in heard]


def test_what_it_sums_up_over_a_sample_is_what_it_shows_times_the_sample(packets):
    for packet in packets:
        np.testing.assert_allclose(packet[GAINED], PERIOD * packet[FORCE], rtol=1e-3, atol=1e-6)
        half_turn = 0.5 * PERIOD * packet[RATE]
        np.testing.assert_allclose(packet[TURNED], [1.0, *half_turn], rtol=1e-3, atol=2e-7)


def test_its_counter_and_its_clock_go_on_together(packets):
    first, last = packets
    ticks = 1e-4 * (last[FINE_TIME] - first[FINE_TIME])
    assert ticks == pytest.approx(PERIOD * (last[COUNTER] - first[COUNTER]))
