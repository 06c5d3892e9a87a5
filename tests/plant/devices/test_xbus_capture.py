"""Packets that a real MTi sent: their check holds, and their numbers agree with each other."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from twin.plant.devices.device import Counters
from twin.plant.devices.xbus import FrameParser, decode_data

CAPTURES = Path(__file__).parent / "captures"
INERTIAL = ("float32", "fp12_20", "fp16_32", "float64")
"""One file for each number format."""

COUNTER, FINE_TIME = 0x1020, 0x1060
GAINED, FORCE, RATE, TURNED = 0x4010, 0x4020, 0x8020, 0x8030
"""Velocity and turn over a sample; specific force and rate as its mean."""
QUATERNION, MATRIX, EULER = 0x2010, 0x2020, 0x2030
PERIOD = 0.01
"""[s]."""
GRAVITY = 9.81


def heard(name: str) -> list[dict[int, np.ndarray]]:
    counters = Counters()
    sent = (CAPTURES / f"{name}.hex").read_text()
    messages = FrameParser(counters).feed(bytes.fromhex(sent))
    assert len(messages) == counters.frames == len(sent.split())
    assert not counters.bad_checksums
    return [{item.kind: np.array(item.values) for item in decode_data(m.data)} for m in messages]


@pytest.mark.parametrize("name", INERTIAL)
def test_what_it_sums_up_over_a_sample_is_what_it_shows_times_the_sample(name):
    for packet in heard(name):
        # the velocity is summed up in axes that turn by 5e-5 rad meanwhile: times g and the sample
        np.testing.assert_allclose(packet[GAINED], PERIOD * packet[FORCE], rtol=1e-3, atol=5e-6)
        half_turn = 0.5 * PERIOD * packet[RATE]
        np.testing.assert_allclose(packet[TURNED], [1.0, *half_turn], rtol=1e-3, atol=2e-6)


@pytest.mark.parametrize("name", [*INERTIAL, "attitude"])
def test_its_counter_and_its_clock_go_on_together(name):
    packets = heard(name)
    for first, last in zip(packets, packets[1:], strict=False):
        ticks = 1e-4 * (last[FINE_TIME] - first[FINE_TIME])
        assert ticks == pytest.approx(PERIOD * (last[COUNTER] - first[COUNTER]))


@pytest.mark.parametrize("name", INERTIAL)
def test_at_rest_its_attitude_says_where_the_specific_force_points(name):
    for packet in (each for each in heard(name) if EULER in each):
        roll, pitch, yaw = packet[EULER]
        body_to_world = Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)
        # within its own tilt error and the bias of its accelerometer: 0.02 g
        np.testing.assert_allclose(
            packet[FORCE], body_to_world.inv().apply([0.0, 0.0, GRAVITY]), atol=0.2
        )


def test_its_quaternion_turns_as_its_rotation_matrix_does():
    for packet in heard("attitude"):
        rotation = Rotation.from_quat(packet[QUATERNION], scalar_first=True)
        # the device sends the matrix column by column
        np.testing.assert_allclose(rotation.as_matrix().T.ravel(), packet[MATRIX], atol=2e-6)


def test_what_the_twin_does_not_read_hides_nothing_beside_it():
    (packet,) = heard("position")
    assert packet.keys() == {FINE_TIME, COUNTER}
