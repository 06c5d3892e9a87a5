"""What a faulty sensor of a running machine shows is its formula of what a sound one shows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim
from scipy.spatial.transform import Rotation

from twin.contrast import undisturbed
from twin.effects import parse_effects, with_effects
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.rotation import from_rotation_vector
from twin.signals import Samples

SECONDS = 3.0
TURN = np.array([0.1, -0.2, 0.15])


@pytest.fixture(scope="module")
def sound() -> Platform:
    """Every kind of sensor, without noise, steps or filter, on a machine that tumbles."""
    quiet = undisturbed(load_platform("astros"))
    sensors = {
        name: replace(sensor, range=np.inf, cutoff=np.inf) for name, sensor in quiet.sensors.items()
    }
    return replace(quiet, sensors=sensors)


def shown(platform: Platform, text: str, stream: str) -> Samples:
    """All readings of one stream while gimbals turn and thrusters fire."""
    plant = SimulatedPlant(
        with_effects(platform, parse_effects(text)) if text else platform,
        initial=InitialState(
            attitude=from_rotation_vector(np.array([0.1, -0.05, 0.4])),
            rate_body=np.array([0.05, -0.04, 0.3]),
        ),
    )
    readings = []
    for k in range(round(SECONDS / platform.tick) + 1):
        reading = plant.read(k * platform.tick)
        readings += [reading.streams[stream]] if stream in reading.streams else []
        plant.write(
            {
                "command_gimbal_rate": np.full((1, 4), 0.3 * np.cos(k * platform.tick)),
                "command_thruster": np.full((1, 12), 0.5),
            }
        )
    return Samples(
        np.concatenate([one.value for one in readings], axis=1)[0],
        np.concatenate([one.time for one in readings], axis=1)[0],
        np.concatenate([one.valid for one in readings], axis=1)[0],
    )


def scalar_first(rotation: Rotation) -> np.ndarray:
    return rotation.as_quat(scalar_first=True)


def turned_attitude(x, t, platform):
    seen = Rotation.from_quat(x, scalar_first=True) * Rotation.from_rotvec(TURN)
    return scalar_first(seen)


def seen_from_a_tilted_world(x, t, platform):
    room = Rotation.from_rotvec([0.1, -0.2, 0.0]).inv()
    return scalar_first(room * Rotation.from_quat(x, scalar_first=True))


def askew_elevations(x, t, platform):
    """Of the axes of a sensor that stands turned on the body."""
    up = np.stack([-np.sin(x[:, 1]), np.sin(x[:, 0]), np.zeros(len(x))], axis=1)
    up[:, 2] = np.sqrt(1.0 - np.square(up).sum(axis=1))
    own = up @ Rotation.from_rotvec(TURN).as_matrix()
    return np.stack([np.arcsin(own[:, 1]), -np.arcsin(own[:, 0])], axis=1)


def low_passed(x, t, platform):
    return np.stack([lsim(([1.0], [0.2, 1.0]), x[:, i], t, x[0, i] * 0.2)[1] for i in range(3)], 1)


THREE = np.array([0.1, -0.2, 0.3])
FORMULAS = {
    "gyro_bias=0.1/-0.2/0.3": ("gyro", lambda x, t, _: x + THREE),
    "gyro_drift=0.1/-0.2/0.3": ("gyro", lambda x, t, _: x + t[:, None] * THREE),
    "gyro_vibration=0.1/-0.2/0.3/0.3/0.1/-0.2/3.7": (
        "gyro",
        lambda x, t, _: (
            x
            + np.outer(np.sin(2.0 * np.pi * 3.7 * t), THREE)
            + np.outer(np.cos(2.0 * np.pi * 3.7 * t), [0.3, 0.1, -0.2])
        ),
    ),
    "gyro_scale_factor=0.1/-0.2/0.3": ("gyro", lambda x, t, _: x * (1.0 + THREE)),
    "gyro_misalignment=0.1/-0.2/0.15": (
        "gyro",
        lambda x, t, _: x @ Rotation.from_rotvec(TURN).as_matrix(),
    ),
    "attitude_misalignment=0.1/-0.2/0.15": ("attitude", turned_attitude),
    "attitude_reference_tilt=0.1/-0.2": ("attitude", seen_from_a_tilted_world),
    "inclinometer_bias=0.1/-0.2": ("inclinometer", lambda x, t, _: x + THREE[:2]),
    "inclinometer_misalignment=0.1/-0.2/0.15": ("inclinometer", askew_elevations),
    "accelerometer_bias=0.1/-0.2/0.3": ("accelerometer", lambda x, t, _: x + THREE),
    "accelerometer_scale=0.1/-0.2/0.3": ("accelerometer", lambda x, t, _: x * (1.0 + THREE)),
    "magnetometer_bias=1e-6/2e-6/3e-6": (
        "magnetometer",
        lambda x, t, _: x + np.array([1e-6, 2e-6, 3e-6]),
    ),
    "magnetometer_scale=0.1/-0.2/0.3": ("magnetometer", lambda x, t, _: x * (1.0 + THREE)),
    "gimbal_offset:g2=0.1": (
        "gimbal_angle",
        lambda x, t, _: x + np.array([0.0, 0.1, 0.0, 0.0]),
    ),
    "gas_consumption=1e-3": (
        "gas_pressure",
        lambda x, t, platform: x - 1e-3 * t[:, None] * platform.gas.pressure / platform.gas.mass,
    ),
    "sensor_lag:gyro=0.2": ("gyro", low_passed),
}


@pytest.mark.parametrize("text", FORMULAS)
def test_a_faulty_reading_is_the_formula_of_a_sound_one(text, sound, agrees):
    stream, formula = FORMULAS[text]
    true, faulty = shown(sound, "", stream), shown(sound, text, stream)
    expected = formula(true.value, true.time, sound)
    size = np.abs(expected).max()
    error = np.abs(faulty.value - expected).max() / size
    name = text.partition("=")[0]
    agrees(f"{name}: reading, by its formula", error, 1e-12)
    np.testing.assert_array_equal(faulty.time, true.time)
    assert np.abs(true.value - expected).max() > 1e-4 * size, "the case would not show the effect"


@pytest.mark.parametrize(
    ("text", "formula"),
    [
        ("clock_lag:gyro=0.17", lambda t: t + 0.17),
        ("clock_drift:gyro=0.01", lambda t: t * 1.01),
    ],
)
def test_a_wrong_clock_shows_the_same_values_at_other_times(text, formula, sound, agrees):
    true, faulty = shown(sound, "", "gyro"), shown(sound, text, "gyro")
    both = min(len(true.time), len(faulty.time))
    error = np.abs(faulty.time[:both] - formula(true.time[:both])).max()
    agrees(f"{text.partition('=')[0]}: stamps, by its formula", error, 1e-12, "s")
    np.testing.assert_array_equal(faulty.value[:both], true.value[:both])
    assert both > 0.9 * len(true.time)
