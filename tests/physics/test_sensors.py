"""What sound sensors show of a top whose motion is known in closed form."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.effects.motion import apart
from tests.physics.motion import rigid
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, Sensor, load_platform
from twin.rotation import conjugate, from_rotation_vector, multiply, rotate

ACROSS, ALONG = 0.03, 0.05
TOP = np.diag([ACROSS, ACROSS, ALONG])
START = from_rotation_vector(np.array([0.1, -0.05, 0.5]))
RATE = np.array([0.08, -0.05, 0.4])
FIELD = np.array([2.2e-5, 1e-5, -4.2e-5])
WIDTHS = {"gyro": 3, "attitude": 3, "magnetometer": 3, "accelerometer": 3, "inclinometer": 2}

Array = np.ndarray


@pytest.fixture(scope="module")
def readings() -> tuple[Platform, dict[str, Array]]:
    """All samples of 20 s, the sensors at the machine's `imu`."""
    sensors = {
        name: Sensor(name, 20.0, np.zeros(width), np.zeros(width), site="imu")
        for name, width in WIDTHS.items()
    }
    platform = replace(rigid(TOP), sensors=sensors, magnetic_field=FIELD)
    plant = SimulatedPlant(platform, initial=InitialState(attitude=START, rate_body=RATE))
    found: dict[str, list[Array]] = {name: [] for name in WIDTHS}
    for k in range(400):
        for name, samples in plant.read(k * platform.tick).streams.items():
            found[name] += list(samples.value[0])
    return platform, {name: np.array(values) for name, values in found.items()}


def motion(time: Array) -> tuple[Array, Array, Array]:
    """Attitude, rate and angular acceleration, body axes."""
    pace = (1.0 - ALONG / ACROSS) * RATE[2] * np.array([0.0, 0.0, 1.0])
    turn = from_rotation_vector(time[:, None] * pace)
    attitude = multiply(
        multiply(from_rotation_vector(time[:, None] * rotate(START, TOP @ RATE) / ACROSS), START),
        turn,
    )
    rate = rotate(conjugate(turn), np.broadcast_to(RATE, (len(time), 3)))
    return attitude, rate, np.cross(rate, pace)


def test_sensors_show_what_a_nutating_top_does(readings, agrees):
    platform, found = readings
    assert platform.sensors.keys() == found.keys()
    time = 0.05 * np.arange(len(found["gyro"]))
    attitude, rate, acceleration = motion(time)
    agrees("gyro: rate of a nutating top", np.abs(found["gyro"] - rate).max(), 1e-11, "rad/s")
    turn = max(apart(*pair) for pair in zip(attitude, found["attitude"], strict=True))
    agrees("attitude: that of a nutating top", turn, 1e-11, "rad")
    field = rotate(conjugate(attitude), np.broadcast_to(FIELD, (len(time), 3)))
    error = np.abs(found["magnetometer"] - field).max() / np.linalg.norm(FIELD)
    agrees("magnetometer: the field on a nutating top", error, 1e-11, "of the field")

    arm = place_of("imu")
    force = rotate(conjugate(attitude), np.array([0.0, 0.0, platform.gravity]))
    force = force + np.cross(acceleration, arm) + np.cross(rate, np.cross(rate, arm))
    # the sensor takes the change of the rate over the step before
    off = np.abs(found["accelerometer"] - force)[1:].max()
    agrees("accelerometer: specific force on a nutating top", off, 1e-5, "m/s^2")
    expected = np.stack([np.arcsin(force[:, 1] / 9.81), -np.arcsin(force[:, 0] / 9.81)], axis=1)
    off = np.abs(found["inclinometer"] - expected)[1:].max()
    agrees("inclinometer: elevations on a nutating top", off, 1e-6, "rad")


def place_of(site: str) -> Array:
    """(3,) from the CR [m]."""
    model = mujoco.MjModel.from_xml_path(str(load_platform("cubesat").model_path))
    return model.site(site).pos.copy()
