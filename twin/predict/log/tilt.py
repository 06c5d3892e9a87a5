"""An attitude from a gyro and what little else is known: enough to begin a prediction with.

With an inclinometer, or an accelerometer as if the machine stood still, its heading starts at 0 and
is the gyro's integral: no tilt tells it, and none of gravity's laws asks for it. With an attitude
at the start, all of it is the gyro's integral.
"""

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.recording import Series

Array = NDArray[np.float64]


def attitude_of_tilt(gyro: Series, tilt: Series) -> Series:
    """(m, 4) at the gyro's stamps at which there is a tilt too.

    Args:
        gyro: (., 3) [rad/s].
        tilt: of an inclinometer (., 2) [rad], or of an accelerometer (., 3) [m/s^2].
    """
    inside = (gyro.time >= tilt.time[0]) & (gyro.time <= tilt.time[-1])
    time, rate = gyro.time[inside], gyro.value[inside]
    vertical = _vertical(tilt.interpolated_at(time))
    turns = rotation.from_rotation_vector(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None])
    attitude = np.empty((len(time), 4))
    before = np.array([1.0, 0.0, 0.0, 0.0])
    for i in range(len(time)):
        turned = before if i == 0 else rotation.multiply(before, turns[i - 1])
        attitude[i] = before = _levelled(turned, vertical[i])
    return Series(time, attitude, ("w", "x", "y", "z"), "1")


def attitude_of_start(gyro: Series, attitude: Series) -> Series:
    """(m, 4) at the gyro's stamps from the first attitude on, as the gyro carries it on."""
    inside = gyro.time >= attitude.time[0]
    time, rate = gyro.time[inside], gyro.value[inside]
    turns = rotation.from_rotation_vector(0.5 * (rate[1:] + rate[:-1]) * np.diff(time)[:, None])
    carried = [attitude.value[0]]
    for turn in turns:
        carried.append(rotation.multiply(carried[-1], turn))
    return Series(time, np.array(carried), ("w", "x", "y", "z"), "1")


def _vertical(shown: Array) -> Array:
    """(m, 3) the world's z axis in body components, from elevations (m, 2) or a force (m, 3)."""
    if shown.shape[1] == 3:
        return shown / np.maximum(np.linalg.norm(shown, axis=1, keepdims=True), 1e-12)
    roll, pitch = np.sin(shown).T
    up = np.sqrt(np.maximum(1.0 - roll**2 - pitch**2, 0.0))
    return np.stack([-pitch, roll, up], axis=-1)


def _levelled(attitude: Array, vertical: Array) -> Array:
    """By the shortest turn to where the world's z axis has these body components."""
    across = rotation.cross(vertical, rotation.vertical_body(attitude))
    sine = float(np.linalg.norm(across))
    if sine == 0.0:
        return attitude
    angle = np.arctan2(sine, vertical @ rotation.vertical_body(attitude))
    return rotation.multiply(attitude, rotation.from_rotation_vector(across * (angle / sine)))
