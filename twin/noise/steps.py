"""Steps of a clock and resets of an attitude: nothing happened to the body, and it goes on.

A clock that steps leaves a gap in all streams at once, over which the body moved no further than in
a usual interval. A heading that is reset leaps between two samples and stays, while the gyro shows
no turn; of a leap that tilts the body nobody knows whether it was one. Both are undone from there
on, and said; where the motion is too slow to tell a step from a gap, the gap is left as it is.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.recording import Recording, Series

Array = NDArray[np.float64]

LEAST_GAP = 5.0
"""Usual intervals of the slowest stream that a step of the clock is longer than."""
LONGEST_GAP = 5.0
"""A longer one parts a log in two (`recording/pauses.py`), whatever happened in it [s]."""
WINDOW = 1.0
"""Before and after, over which a motion is taken to be smooth [s]."""
FEWEST = 8
"""Samples in such a window."""
SURE = 6.0
"""Sigmas by which the time that passed differs from the gap, and a turn from what noise may do."""
LIKE = 4.0
"""Sigmas within which the time that passed is a usual interval."""
UPRIGHT = 0.05
"""Share of a reset's turn that is not about the vertical."""
LATE = 0.1
"""Latency of a stamp within which the gyro may show a turn of the attitude [s]."""
LEAP = 0.02
"""A smaller turn of an attitude is no reset [rad]."""


@dataclass(frozen=True)
class _Side:
    """A smooth motion at an instant."""

    angle: Array
    """(k,) from a reference [rad]."""
    rate: Array
    """(k,) [rad/s]."""
    angle_sigma: float
    """Of each angle [rad]."""


def without_steps(recording: Recording) -> tuple[Recording, list[str]]:
    """A log whose clock does not step and whose heading is not reset, and a sentence on each."""
    said = list[str]()
    for start, step in list(_clock_steps(recording)):
        streams = {name: _earlier(series, start, step) for name, series in recording.items()}
        recording = replace(recording, streams=streams)
        said.append(
            f"the clock of all streams steps by {step:.3f} s after {start:.6g} s, for the motion "
            "goes on as if no time had passed: times after that are taken as much earlier"
        )
    for time, turn in list(_resets(recording)):
        streams = dict(recording.streams)
        streams["attitude"] = _turned_back(streams["attitude"], time, turn)
        recording = replace(recording, streams=streams)
        angle = float(rotation.to_rotation_vector(turn)[2])
        said.append(
            f"attitude is reset by {np.degrees(angle):.3g} deg about the vertical at "
            f"{time:.6g} s, where the gyro shows no such turn: it is turned back from there on"
        )
    return recording, said


def _clock_steps(recording: Recording) -> Iterator[tuple[float, float]]:
    """Last time before each step, and by how much the clock steps [s]."""
    name = next((one for one in ("attitude", "joint_angle") if one in recording), None)
    clocked = [series for key, series in recording.items() if not key.startswith("command_")]
    if name is None or any(len(series) < 2 * FEWEST for series in clocked):
        return
    motion = recording[name]
    usual = [float(np.median(np.diff(series.time))) for series in clocked]
    gaps = np.diff(motion.time)
    passed = 0.0
    for row in np.flatnonzero((gaps > LEAST_GAP * max(usual)) & (gaps < LONGEST_GAP)):
        start, stop = float(motion.time[row]), float(motion.time[row + 1])
        edges = [_edges(series, 0.5 * (start + stop)) for series in clocked]
        if any(edge is None for edge in edges):
            continue
        steps = [e[1] - e[0] - period for e, period in zip(edges, usual, strict=True) if e]
        step = float(np.median(steps))
        if np.ptp(steps) > 2.0 * max(usual) or step <= 0.0:
            continue
        sides = _sides(motion, int(row))
        if sides is not None and _no_time_passed(*sides, stop - start, stop - start - step):
            yield max(e[0] for e in edges if e) - passed, step
            passed += step


def _edges(series: Series, time: float) -> tuple[float, float] | None:
    """The samples before and after an instant; None where there is none."""
    after = int(np.searchsorted(series.time, time))
    if not 0 < after < len(series):
        return None
    return float(series.time[after - 1]), float(series.time[after])


def _no_time_passed(before: _Side, after: _Side, gap: float, interval: float) -> bool:
    """Whether a motion went over a gap [s] as far as in a usual interval."""
    rate = 0.5 * (before.rate + after.rate)
    speed = float(np.linalg.norm(rate))
    # far from where the motion is smooth the mean of two rates says little
    bend = float(np.linalg.norm(after.rate - before.rate)) * gap / 8.0
    sigma = float(np.hypot(before.angle_sigma, after.angle_sigma))
    sigma = float(np.hypot(sigma, bend))
    if speed <= 0.0:
        return False
    moved = float((after.angle - before.angle) @ rate) / speed**2
    spread = sigma / speed
    return gap - moved > SURE * spread and abs(moved - interval) < LIKE * spread + interval


def _sides(series: Series, row: int) -> tuple[_Side, _Side] | None:
    """The motion at a row, from before, and at the next one, from after; None with few samples."""
    time = series.time
    first = int(np.searchsorted(time, time[row] - WINDOW))
    last = int(np.searchsorted(time, time[row + 1] + WINDOW, side="right"))
    if row + 1 - first < FEWEST or last - row - 1 < FEWEST:
        return None
    angle = _angles(series.value[first:last], series.value[row])
    at = row + 1 - first
    before = _fitted(time[first : row + 1] - time[row], angle[:at])
    after = _fitted(time[row + 1 : last] - time[row + 1], angle[at:])
    return before, after


def _angles(value: Array, reference: Array) -> Array:
    """(m, k) angles from a reference: of quaternions the rotation vectors in its body axes."""
    if value.shape[1] == 4:
        turn = rotation.multiply(rotation.conjugate(reference), value)
        return rotation.to_rotation_vector(turn)
    return value - reference


def _fitted(time: Array, angle: Array) -> _Side:
    """A parabola through samples, at time 0."""
    columns = np.stack([np.ones_like(time), time, time**2], axis=-1)
    found, *_ = np.linalg.lstsq(columns, angle, rcond=None)
    left = angle - columns @ found
    noise = float(np.sqrt(np.sum(np.square(left)) / max(left.size - found.size, 1)))
    spread = noise * np.sqrt(np.diag(np.linalg.pinv(columns.T @ columns)))
    return _Side(found[0], found[1], float(spread[0]))


def _earlier(series: Series, start: float, step: float) -> Series:
    return replace(series, time=np.where(series.time > start, series.time - step, series.time))


def _resets(recording: Recording) -> Iterator[tuple[float, Array]]:
    """Time of the first sample after each reset, and the turn of the world that it is."""
    if "attitude" not in recording or "gyro" not in recording:
        return
    attitude, gyro = recording["attitude"], recording["gyro"]
    if gyro.columns != ("x", "y", "z") or attitude.columns != ("w", "x", "y", "z"):
        return
    if len(attitude) < 4 * FEWEST or len(gyro) < 4 * FEWEST:
        return
    q, time = attitude.value, attitude.time
    interval = np.diff(time)
    turned = rotation.to_rotation_vector(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]))
    shown = _integral(gyro.time, gyro.value, time[1:]) - _integral(gyro.time, gyro.value, time[:-1])
    # stamps may be late by a latency
    speed = np.linalg.norm(gyro.value, axis=1)[:, None]
    around = _integral(gyro.time, speed, time[1:] + LATE) - _integral(
        gyro.time, speed, time[:-1] - LATE
    )
    off = np.linalg.norm(turned - shown, axis=1)
    usual = float(np.median(off))
    gyros = float(np.median(np.diff(gyro.time)))
    for row in np.flatnonzero(off > np.maximum(max(LEAP, 20.0 * usual), 2.0 * around[:, 0])):
        if interval[row] > 2.0 * np.median(interval) + 2.0 * gyros:
            continue  # over a gap nobody knows
        sides = _sides(attitude, int(row))
        if sides is None:
            continue
        before, after = sides
        sigma = float(np.hypot(before.angle_sigma, after.angle_sigma))
        jump = after.angle - before.angle - shown[row]
        if np.linalg.norm(jump) < max(LEAP, SURE * sigma):
            continue  # it came back: a glitch
        # in the body axes of the sample before; the world turns the other way about
        leap = rotation.from_rotation_vector(before.angle + shown[row])
        base = rotation.multiply(q[row], leap)
        found = rotation.multiply(q[row], rotation.from_rotation_vector(after.angle))
        turn = rotation.multiply(found, rotation.conjugate(base))
        about = rotation.to_rotation_vector(turn)
        if np.hypot(about[0], about[1]) < max(UPRIGHT * np.linalg.norm(about), SURE * sigma):
            yield float(time[row + 1]), turn


def _integral(time: Array, value: Array, at: Array) -> Array:
    """(n, k) integral of a piecewise linear stream from its start, at times (n,)."""
    steps = 0.5 * (value[1:] + value[:-1]) * np.diff(time)[:, None]
    whole = np.concatenate([np.zeros((1, value.shape[1])), np.cumsum(steps, axis=0)])
    return np.stack([np.interp(at, time, column) for column in whole.T], axis=-1)


def _turned_back(series: Series, time: float, turn: Array) -> Series:
    after = series.time >= time
    value = series.value.copy()
    value[after] = rotation.multiply(rotation.conjugate(turn), value[after])
    return replace(series, value=rotation.continuous(value))
