"""What part of a predicted turn a floating body shows: the sign, and the size, of what turned it.

    J w(t) = J w(0) + integral of M x g + sum s_k tau_k - w x (J w + h),    g in body axes

holds over some seconds in which actuators push with tau_k. M, the mass moment, and the start are
unknown; s_k is one where an actuator does what the platform says, minus one where it is wired the
wrong way round. It is linear in all of them, so one least squares gives each s_k and how sure it
is. h is what wheels and rotors hold as they were measured, or stand at the start.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from twin.platform import Platform
from twin.rotation import cross, vertical_body
from twin.service.session import POSITION
from twin.service.stages import tolerance
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


class ObservedShare(NamedTuple):
    """What part of what was predicted was seen."""

    share: float
    deviation: float
    """1 sigma."""
    misfit: float = 1.0
    """Mean square of what the fit leaves, over that of the noise."""

    @property
    def sign_known(self) -> bool:
        """Enough to tell its sign."""
        return abs(self.share) > _SURE * self.deviation

    def words(self) -> str:
        """The share, with its 95 % interval."""
        return f"{self.share:.2f} +- {2.0 * self.deviation:.2f}"


@dataclass(frozen=True)
class FloatingMotion:
    """How a floating body moved, at the times of its gyro's samples."""

    times: Array
    """(m,) [s]."""
    rate: Array
    """(m, 3) [rad/s, body]."""
    gravity: Array
    """(m, 3) [m/s^2, body]."""
    places: Array
    """(m, stages) [m]; width zero where none was measured."""
    momentum: Array
    """(m, 3) h [N m s, body]."""
    still: NDArray[np.bool_]
    """(m,) False: a stage may have been running, which shakes the gyro."""


def motion(platform: Platform, readings: Sequence[Reading]) -> FloatingMotion | None:
    """What was read; None where there is no gyro, no sensor of the vertical, or too few samples."""
    gyro, tilt = rows(readings, "gyro"), _vertical(readings)
    if gyro is None or tilt is None or len(gyro[0]) < _FEWEST:
        return None
    times, rate = gyro
    place = rows(readings, POSITION)
    places, still = np.zeros((len(times), 0)), np.ones(len(times), dtype=np.bool_)
    if place is not None:
        places = at(times, *place)
        still = ~_running(times, *place, tolerance(platform))
    gravity = -platform.gravity * at(times, *tilt)
    return FloatingMotion(times, rate, gravity, places, _momentum(platform, readings, times), still)


def slid(platform: Platform, motion: FloatingMotion, stage: int) -> Array:
    """Change of the rate (m, 3) that a stage's mass should have made since the start [rad/s]."""
    part = platform.stages[stage]
    way = motion.places[:, stage] - motion.places[0, stage]
    torque = cross(part.mass * way[:, None] * part.axis, motion.gravity)
    return _integral(motion.times, torque @ np.linalg.inv(platform.inertia))


def senses(
    platform: Platform, motion: FloatingMotion, predicted: Sequence[Array], *, knots: float = np.inf
) -> list[ObservedShare] | None:
    """What part of each prediction was seen, all of them together.

    Args:
        platform: whose J and m r are taken.
        seen: from before the first was made to push.
        predicted: (m, 3) changes of the rate since the start [rad/s].
        knots: a torque in body axes acts besides, straight between knots so far apart [s]; inf:
            none.

    Returns:
        None where one of them predicts nothing, or too little was seen.
    """
    inverse, still = np.linalg.inv(platform.inertia), motion.still
    gyroscopic = -cross(motion.rate, motion.rate @ platform.inertia + motion.momentum)
    start = [np.broadcast_to(axis, motion.rate.shape) for axis in np.eye(3)]
    # the columns of M x g, one for each component of M
    turned = [
        _integral(motion.times, cross(axis[None], motion.gravity) @ inverse) for axis in np.eye(3)
    ]
    steady = [
        hat[:, None] * axis[None] @ inverse
        for hat in _hats(motion.times, knots)
        for axis in np.eye(3)
    ]
    columns = (*start, *turned, *steady, *predicted)
    design = np.stack([column[still].ravel() for column in columns], axis=1)
    wanted = (motion.rate - _integral(motion.times, gyroscopic @ inverse))[still].ravel()
    # in seconds a level table hardly shows M z: it is what the platform says, give or take itself
    # and what the masses can make of it
    stated = platform.center_of_mass_offset
    reach = sum(stage.mass * (stage.travel[1] - stage.travel[0]) for stage in platform.stages)
    noise = float(np.max(platform.sensors["gyro"].noise)) or _NOISELESS
    prior = np.zeros((3, design.shape[1]))
    prior[:, 3:6] = np.eye(3) / max(float(np.linalg.norm(stated)), reach, 1e-12)
    weighed = np.concatenate([design / noise, prior])
    right = np.concatenate([wanted / noise, prior[:, 3:6] @ stated])
    asked = 6 + len(steady)
    if still.sum() < _FEWEST or not weighed[:, asked:].any(axis=0).all():
        return None
    return shares(weighed, right, len(wanted))[asked:]


def _hats(times: Array, spacing: float) -> list[Array]:
    """Integrals (m,) of the functions that are one at one knot and zero at the others."""
    if not np.isfinite(spacing):
        return []
    span = float(times[-1] - times[0])
    knots = times[0] + np.linspace(0.0, span, max(round(span / spacing), 1) + 1)
    hats = [np.interp(times, knots, row) for row in np.eye(len(knots))]
    return [np.asarray(cumulative_trapezoid(hat, times, initial=0.0)) for hat in hats]


def shares(weighed: Array, right: Array, measured: int) -> list[ObservedShare]:
    """Least squares; what is left of the measured rows makes all less sure, where it is much.

    Args:
        weighed: (m, k) over the noise of each row; columns may be of any unit.
        right: (m,) likewise.
        measured: of the rows, the first, which are not known beforehand.
    """
    size = np.linalg.norm(weighed, axis=0)
    alike = weighed / size
    result, *_ = np.linalg.lstsq(alike, right, rcond=None)
    left = (right - alike @ result)[:measured]
    misfit = float(left @ left) / measured
    deviation = np.sqrt(max(misfit, 1.0) * np.diag(np.linalg.pinv(alike.T @ alike)))
    return [
        ObservedShare(*pair, misfit)
        for pair in zip((result / size).tolist(), (deviation / size).tolist(), strict=True)
    ]


def sense(platform: Platform, readings: Sequence[Reading], stage: int) -> ObservedShare | None:
    """What the gyro saw of one stage's move.

    Args:
        platform: whose J, gravity and stage are taken.
        readings: from before the move until after it.
        stage: its number.

    Returns:
        None where the machine has no gyro, no sensor of the vertical, or too few samples came.
    """
    seen = motion(platform, readings)
    if seen is None or not seen.places.size:
        return None
    result = senses(platform, seen, [slid(platform, seen, stage)])
    return None if result is None else result[0]


def rows(readings: Sequence[Reading], stream: str) -> tuple[Array, Array] | None:
    """Times (m,) and values (m, k) of what was valid; None: nothing was."""
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


def at(times: Array, known: Array, values: Array) -> Array:
    """Values (m, k) at other times, between their neighbours."""
    return np.stack([np.interp(times, known, column) for column in values.T], axis=1)


def _integral(times: Array, values: Array) -> Array:
    """From the first time on, (m, k)."""
    return np.asarray(cumulative_trapezoid(values, times, axis=0, initial=0.0), dtype=np.float64)


def carried_axes(platform: Platform, readings: Sequence[Reading], times: Array) -> list[Array]:
    """Where the axes of wheels and then rotors stand, (m, 3) each, as their gimbals are read."""
    angles = rows(readings, "gimbal_angle")
    axes: list[Array] = []
    for part in (*platform.wheels, *platform.rotors):
        axis = np.broadcast_to(part.axis, (len(times), 3))
        for k, gimbal in enumerate(platform.gimbals):
            if gimbal.name == part.gimbal:
                angle = gimbal.home if angles is None else at(times, *angles)[:, k, None]
                turned = cross(gimbal.axis[None], part.axis[None])
                axis = part.axis * np.cos(angle) + turned * np.sin(angle)
        axes.append(np.broadcast_to(axis, (len(times), 3)))
    return axes


def speeds(platform: Platform, readings: Sequence[Reading], times: Array) -> list[Array]:
    """Of wheels and then rotors, (m,) each [rad/s], as read or as stated."""
    read = rows(readings, "wheel_speed")
    wheels = [
        np.full(len(times), wheel.home) if read is None else at(times, *read)[:, k]
        for k, wheel in enumerate(platform.wheels)
    ]
    return [*wheels, *(np.full(len(times), rotor.speed) for rotor in platform.rotors)]


def _momentum(platform: Platform, readings: Sequence[Reading], times: Array) -> Array:
    parts = (*platform.wheels, *platform.rotors)
    axes, turning = carried_axes(platform, readings, times), speeds(platform, readings, times)
    held = [p.inertia * s[:, None] * a for p, s, a in zip(parts, turning, axes, strict=True)]
    return np.sum(held, axis=0) if held else np.zeros((len(times), 3))


def _running(times: Array, stamps: Array, places: Array, allowed: Array) -> NDArray[np.bool_]:
    """(m,) whether a stage may have been moving then, by when its readings changed."""
    running = np.zeros(len(times), dtype=np.bool_)
    for k in np.flatnonzero((np.abs(np.diff(places, axis=0)) > allowed).any(axis=1)):
        running |= (times > stamps[k]) & (times < stamps[k + 1] + _SETTLES)
    return running


def _vertical(readings: Sequence[Reading]) -> tuple[Array, Array] | None:
    """The vertical in body axes (m, 3), from whichever sensor tells it."""
    attitude = rows(readings, "attitude")
    if attitude is not None:
        return attitude[0], vertical_body(attitude[1])
    angles = rows(readings, "inclinometer")
    if angles is None:
        return None
    roll, pitch = np.sin(angles[1]).T
    up = np.sqrt(np.maximum(1.0 - roll**2 - pitch**2, 0.0))
    return angles[0], np.stack([-pitch, roll, up], axis=1)
