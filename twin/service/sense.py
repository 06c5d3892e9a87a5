"""Whether a floating table turns as the model says when a mass has moved: the sign of its stage.

    J w(t) = J w(0) + integral of M x g + s (m u d(t)) x g - w x J w,    g in body axes

holds over some seconds around a move d(t) of a mass m along u. M, the mass moment before, and the
start are unknown; s is one where the stage does what the platform says, minus one where it is wired
the wrong way round. It is linear in all of them, so one least squares gives s and how sure it is.
Wheels and gyros that turn meanwhile are left out: what they do makes s less sure.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.rotation import cross, vertical_body
from twin.service.session import POSITION
from twin.signals import Reading

Array = NDArray[np.float64]

_SURE = 5.0
"""Standard deviations from zero at which a sign is believed."""

_FEWEST = 8
"""Samples of the gyro without which nothing is said."""

_NOISELESS = 1e-6
"""Taken for the noise of a gyro that states none [rad/s]."""

_SETTLES = 0.1
"""What a stage that ran shakes has come to rest [s]."""


class Sense(NamedTuple):
    """What part of the predicted turn was seen."""

    share: float
    deviation: float
    """1 sigma."""

    @property
    def seen(self) -> bool:
        """Enough to tell its sign."""
        return abs(self.share) > _SURE * self.deviation


def sense(platform: Platform, readings: Sequence[Reading], stage: int) -> Sense | None:
    """What the gyro saw of one stage's move.

    Args:
        platform: whose J, gravity and stage are taken.
        readings: from before the move until after it.
        stage: its number.

    Returns:
        None where the machine has no gyro, no sensor of the vertical, or too few samples came.
    """
    gyro, place = _rows(readings, "gyro"), _rows(readings, POSITION)
    tilt = _vertical(readings)
    if gyro is None or place is None or tilt is None:
        return None
    times, rate = gyro
    gravity = -platform.gravity * _at(times, *tilt)
    way = np.interp(times, place[0], place[1][:, stage] - place[1][0, stage])
    part = platform.stages[stage]
    moment = part.mass * way[:, None] * part.axis
    inverse = np.linalg.inv(platform.inertia)
    gyroscopic = -cross(rate, rate @ platform.inertia)
    # a stage that runs shakes the gyro
    still = ~_running(times, *place, stage)
    start = [np.broadcast_to(axis, rate.shape) for axis in np.eye(3)]
    # the columns of M x g, one for each component of M
    turned = [_integral(times, cross(axis[None], gravity) @ inverse) for axis in np.eye(3)]
    predicted = _integral(times, cross(moment, gravity) @ inverse)
    columns = (*start, *turned, predicted)
    design = np.stack([column[still].ravel() for column in columns], axis=1)
    wanted = (rate - _integral(times, gyroscopic @ inverse))[still].ravel()
    # in seconds a level table hardly shows M z: it is what the platform says, give or take itself
    stated = platform.center_of_mass_offset
    noise = float(np.max(platform.sensors["gyro"].noise)) or _NOISELESS
    prior = np.zeros((3, design.shape[1]))
    prior[:, 3:6] = np.eye(3) / max(float(np.linalg.norm(stated)), float(np.abs(moment).max()))
    rows = np.concatenate([design / noise, prior])
    right = np.concatenate([wanted / noise, prior[:, 3:6] @ stated])
    # columns of rad/s, of kg m and of one are made alike before they are solved for
    size = np.linalg.norm(rows, axis=0)
    if still.sum() < _FEWEST or size[-1] == 0.0:
        return None
    found, *_ = np.linalg.lstsq(rows / size, right, rcond=None)
    left = (right - rows / size @ found)[: len(wanted)]
    worse = max(float(left @ left) / len(wanted), 1.0)
    covariance = worse * np.linalg.inv((rows / size).T @ (rows / size))
    return Sense(found[-1] / size[-1], float(np.sqrt(covariance[-1, -1])) / size[-1])


def _rows(readings: Sequence[Reading], stream: str) -> tuple[Array, Array] | None:
    """Times (m,) and values (m, k) of what was valid."""
    times: list[float] = []
    values: list[Array] = []
    for reading in readings:
        if stream in reading.streams:
            samples = reading.streams[stream]
            good = samples.valid[0]
            times += samples.time[0, good].tolist()
            values += list(samples.value[0, good])
    order = np.argsort(times, kind="stable")
    return (np.array(times)[order], np.array(values)[order]) if times else None


def _running(times: Array, told: Array, places: Array, stage: int) -> NDArray[np.bool_]:
    """(m,) whether the stage may have been moving then, by when its readings changed."""
    changed = np.flatnonzero(np.diff(places[:, stage]))
    if not changed.size:
        return np.zeros(len(times), dtype=np.bool_)
    return (times > told[changed[0]]) & (times < told[changed[-1] + 1] + _SETTLES)


def _vertical(readings: Sequence[Reading]) -> tuple[Array, Array] | None:
    """The vertical in body axes (m, 3), from whichever sensor tells it."""
    attitude = _rows(readings, "attitude")
    if attitude is not None:
        return attitude[0], vertical_body(attitude[1])
    angles = _rows(readings, "inclinometer")
    if angles is None:
        return None
    roll, pitch = np.sin(angles[1]).T
    up = np.sqrt(np.maximum(1.0 - roll**2 - pitch**2, 0.0))
    return angles[0], np.stack([-pitch, roll, up], axis=1)


def _at(times: Array, known: Array, values: Array) -> Array:
    return np.stack([np.interp(times, known, column) for column in values.T], axis=1)


def _integral(times: Array, values: Array) -> Array:
    """From the first time on, (m, k), by trapezia."""
    pieces = 0.5 * (values[1:] + values[:-1]) * np.diff(times)[:, None]
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)])
