"""A tachometer without a sign is found in the data; its sign comes back where the log tells it."""

from dataclasses import replace

import numpy as np
import pytest

from twin.noise.cleaning import cleaned
from twin.recording import Recording, Series

INERTIA = 1e-3
"""Of a wheel about its axis [kg m^2]."""


def wheels(draw: np.random.Generator, *, noise: float, gyro: bool = False) -> Recording:
    """Three wheels that run to and fro through zero for 60 s, with friction in their bearings."""
    time = np.arange(0.0, 60.0, 0.02)
    speeds, torques = [], []
    for _ in range(3):
        rate, phase = draw.uniform(0.2, 0.5), draw.uniform(0.0, 6.28)
        torque = 0.02 * np.cos(rate * time + phase) + 0.01 * np.cos(2.7 * rate * time)
        speed = np.zeros(len(time))
        for i in range(1, len(time)):
            change = (torque[i - 1] - 2e-5 * speed[i - 1]) / INERTIA
            speed[i] = speed[i - 1] + 0.02 * change
        speeds.append(speed)
        torques.append(torque)
    speed, torque = np.column_stack(speeds), np.column_stack(torques)
    names = ("a", "b", "c")
    streams = {
        "wheel_speed": Series(time, speed + draw.normal(0.0, noise, speed.shape), names, "rad/s"),
        "command_wheel_torque": Series(time, torque, names, "N m"),
    }
    if gyro:
        body = -INERTIA * speed / 2.0 + draw.normal(0.0, 1e-4, speed.shape)
        streams["gyro"] = Series(time, body, ("x", "y", "z"), "rad/s")
    return Recording(streams, {"kind": "log", "source": "drawn"})


def unsigned(recording: Recording, *without: str) -> Recording:
    speed = recording["wheel_speed"]
    streams = {**recording.streams, "wheel_speed": replace(speed, value=np.abs(speed.value))}
    return replace(recording, streams={k: s for k, s in streams.items() if k not in without})


def kept_rows(found: Recording, true: Recording) -> np.ndarray:
    return np.isin(true["wheel_speed"].time, found["wheel_speed"].time)


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("by", ["command", "gyro"])
def test_the_sign_is_restored_from_what_drives_the_wheel_and_that_is_said(noise, by, draw):
    true = wheels(draw, noise=noise, gyro=True)
    log = unsigned(true, *(["command_wheel_torque"] if by == "gyro" else ["gyro"]))
    axes = list(np.eye(3)) if by == "gyro" else []
    found = cleaned(log, wheel_axes=axes)
    assert sum("the tachometer has no sign" in said for said in found.repairs) == 3
    kept = kept_rows(found, true)
    assert kept.mean() > 0.7
    # where the noise is folded at zero, no sign is right
    wrong = np.abs(found["wheel_speed"].value - true["wheel_speed"].value[kept])
    assert wrong.max() < 12.0 * noise + 1.0


@pytest.mark.parametrize("variant", ["signed", "one way", "at rest first", "stopped and on again"])
def test_a_speed_that_has_its_sign_is_left_alone(variant, draw):
    log = wheels(draw, noise=0.05)
    speed = log["wheel_speed"]
    if variant == "one way":
        value = np.abs(speed.value) + 200.0
    elif variant == "at rest first":
        value = np.maximum(speed.time[:, None] - 20.0, 0.0) * [1.0, 2.0, 3.0]
    elif variant == "stopped and on again":
        course = 50.0 * (1.0 - np.cos(2.0 * np.pi * speed.time / 20.0))
        value = np.column_stack([course] * 3)
        torque = INERTIA * np.gradient(course, speed.time)
        command = replace(log["command_wheel_torque"], value=np.column_stack([torque] * 3))
        log = replace(log, streams={**log.streams, "command_wheel_torque": command})
    else:
        value = speed.value
    streams = {**log.streams, "wheel_speed": replace(speed, value=value)}
    found = cleaned(replace(log, streams=streams))
    assert not [said for said in found.repairs if "no sign" in said]
    kept = np.isin(speed.time, found["wheel_speed"].time)
    np.testing.assert_array_equal(found["wheel_speed"].value, value[kept])


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_without_a_drive_such_a_speed_is_not_used_and_that_is_said(noise, draw):
    log = unsigned(wheels(draw, noise=noise), "command_wheel_torque")
    found = cleaned(log)
    assert "wheel_speed" not in found
    (said,) = [one for one in found.repairs if "no sign" in one]
    assert "wheel_speed is not used" in said
