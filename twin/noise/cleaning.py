"""A log without samples that are no measurements, each kind counted and said.

Samples far off between others that go on as if nothing had been: wrong bytes, a marker taken for
another.
A stream leaves its course in one step, and within a quarter of a second comes back to it in one
step, calm before and after. No body does that: what has been pushed stays pushed. What noise may do
is not touched.

Steps of a clock and resets of an attitude: nothing happened to the body, and it goes on.
A clock that steps leaves a gap in all streams at once, over which the body moved no further than in
a usual interval. A heading that is reset leaps between two samples and stays, while the gyro shows
no turn; of a leap that tilts the body nobody knows whether it was one. Both are undone from there
on, and said; where the motion is too slow to tell a step from a gap, the gap is left as it is.

In this order: steps of the clock and resets of the attitude are undone, wheel speeds without a sign
get theirs, and a pulse a turn becomes the passages of its mark. Left out are streams with a dead
axis, samples at the end of a sensor's range, those that a sensor repeats after it hung, those of
one stuck axis, those that a slow sensor repeats or that are interpolated between its measurements,
and glitches.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.noise.stream import ANGLES, counts_turns, noise_of, passages
from twin.noise.stuck import (
    CLIPPED,
    OF_AXES,
    SLOW,
    dead_axes,
    range_ends,
    slow_sensor,
    stopped,
    stuck_rows,
    with_neighbours,
)
from twin.noise.tachometer import with_signs
from twin.recording import Recording, Series
from twin.signals import OF_MOTION
from twin.units import printed, three_digits

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


Apart = Callable[[NDArray[np.intp], NDArray[np.intp]], Array]

FAR = 5.0
"""Usual steps from one sample to the next that a step off the course is longer than."""
USUAL = 0.95
"""Quantile of the steps that is their usual length, unless noise alone takes longer ones."""
OF_NOISE = 6.0
"""White sigmas that a usual step is taken to be at least."""
LONGEST = 0.25
"""After which a stream has not come back, but is elsewhere [s]."""
CALM = 3
"""Steps before and after that are no longer than FAR; elsewhere it rattles."""


def glitches(series: Series) -> Mask:
    """(m,) samples that are off the course of their stream."""
    off = np.zeros(len(series), dtype=np.bool_)
    if len(series) <= 2 * CALM + 2:
        return off
    apart = _step_distance(series)
    row = np.arange(len(series))
    step = apart(row[:-1], row[1:])
    calm = np.convolve(step <= FAR, np.ones(CALM), mode="valid") == CALM
    last = 0
    for before in np.flatnonzero(step[CALM:] > FAR) + CALM:
        if before < last or not calm[before - CALM]:
            continue
        reach = np.searchsorted(series.time, series.time[before] + LONGEST, side="right")
        after = np.arange(before + 1, min(int(reach) + 1, len(series) - CALM))
        distance = apart(np.full(len(after), before), after)
        # on its course it may have gone a usual step a sample
        near = distance <= FAR + (after - before)
        back = after[near & calm[after]]
        if not len(back) or back[0] == before + 1:
            continue
        last = int(back[0])
        off[before + 1 : last] = ~near[: last - before - 1]
    return off


def _step_distance(series: Series) -> Apart:
    """How many usual steps apart two samples are, in the column in which they are furthest."""
    value, white = series.value, noise_of(series)
    if series.columns == ("w", "x", "y", "z"):
        turned = rotation.conjugate(value)

        def distance(a: NDArray[np.intp], b: NDArray[np.intp]) -> Array:
            turn = rotation.to_rotation_vector(rotation.multiply(turned[a], value[b]))
            return np.linalg.norm(turn, axis=1)[:, None]

        white = np.array([np.linalg.norm(white)])
    else:

        def distance(a: NDArray[np.intp], b: NDArray[np.intp]) -> Array:
            return np.abs(value[b] - value[a])

    row = np.arange(len(series))
    steps = distance(row[:-1], row[1:])
    usual = np.maximum(np.quantile(steps, USUAL, axis=0), OF_NOISE * white)
    return lambda a, b: (distance(a, b) / usual).max(axis=1)


LEAST_GAP = 5.0
"""Usual intervals of the slowest stream that a step of the clock is longer than."""
LONGEST_GAP = 5.0
"""A longer one parts a log in two (`recording/pauses.py`), whatever happened in it [s]."""
WINDOW = 1.0
"""Before and after, over which a motion is taken to be smooth [s]."""
MIN_MISSING = 8
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
    """A smooth motion at an instant, in the unit of a stream; of an attitude in rad."""

    angle: Array
    """(k,) from a reference."""
    rate: Array
    """(k,) [1/s]."""
    angle_sigma: float
    """Of each angle."""


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


SMOOTH = ("attitude", "joint_angle", "gyro", "joint_rate", "wheel_speed")
"""Streams that show how much time passed over a gap; one of the first two is needed."""


def _clock_steps(recording: Recording) -> Iterator[tuple[float, float]]:
    """Last time before each step, and by how much the clock steps [s]."""
    name = next((item for item in SMOOTH[:2] if item in recording), None)
    clocked = [series for key, series in recording.items() if not key.startswith("command_")]
    if name is None or any(len(series) < 2 * MIN_MISSING for series in clocked):
        return
    smooth = [recording[item] for item in SMOOTH if item in recording]
    motion = recording[name]
    usual = [float(np.median(np.diff(series.time))) for series in clocked]
    gaps = np.diff(motion.time)
    passed = 0.0
    for row in np.flatnonzero((gaps > LEAST_GAP * max(usual)) & (gaps < LONGEST_GAP)):
        middle = 0.5 * float(motion.time[row] + motion.time[row + 1])
        edges = [_edges(series, middle) for series in clocked]
        if any(edge is None for edge in edges):
            continue
        steps = [e[1] - e[0] - period for e, period in zip(edges, usual, strict=True) if e]
        step = float(np.median(steps))
        if np.ptp(steps) > 2.0 * max(usual) or step <= 0.0:
            continue
        if _no_time_passed(smooth, middle, step):
            yield max(e[0] for e in edges if e) - passed, step
            passed += step


def _edges(series: Series, time: float) -> tuple[float, float] | None:
    """The samples before and after an instant; None where there is none."""
    after = int(np.searchsorted(series.time, time))
    if not 0 < after < len(series):
        return None
    return float(series.time[after - 1]), float(series.time[after])


def _no_time_passed(smooth: Sequence[Series], middle: float, step: float) -> bool:
    """Whether motions went over a gap as far as over one that is shorter by a step [s], by the time
    that each shows to have passed, weighed by its uncertainty."""
    weight, late, bent = 0.0, 0.0, np.inf
    for series in smooth:
        row = int(np.searchsorted(series.time, middle)) - 1
        sides = _sides(series, row) if 0 <= row < len(series) - 1 else None
        if sides is None:
            continue
        before, after = sides
        gap = float(series.time[row + 1] - series.time[row])
        rate = 0.5 * (before.rate + after.rate)
        speed = float(np.linalg.norm(rate))
        # far from where the motion is smooth the mean of two rates says little
        bend = float(np.linalg.norm(after.rate - before.rate)) * gap / 8.0
        sigma = float(np.hypot(np.hypot(before.angle_sigma, after.angle_sigma), bend))
        if speed <= 0.0 or sigma <= 0.0:
            continue
        moved = float((after.angle - before.angle) @ rate) / speed**2
        bent = min(bent, bend / speed)
        weight += (speed / sigma) ** 2
        late += (speed / sigma) ** 2 * (gap - moved)
    if weight <= 0.0:
        return False
    # streams of one motion bend together
    late, spread = late / weight, max(1.0 / np.sqrt(weight), bent)
    interval = min(float(np.median(np.diff(series.time))) for series in smooth)
    return late > SURE * spread and abs(late - step) < LIKE * spread + interval


def _sides(series: Series, row: int) -> tuple[_Side, _Side] | None:
    """The motion at a row, from before, and at the next one, from after; None with few samples."""
    time = series.time
    first = int(np.searchsorted(time, time[row] - WINDOW))
    last = int(np.searchsorted(time, time[row + 1] + WINDOW, side="right"))
    if row + 1 - first < MIN_MISSING or last - row - 1 < MIN_MISSING:
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
    result, *_ = np.linalg.lstsq(columns, angle, rcond=None)
    left = angle - columns @ result
    noise = float(np.sqrt(np.sum(np.square(left)) / max(left.size - result.size, 1)))
    spread = noise * np.sqrt(np.diag(np.linalg.pinv(columns.T @ columns)))
    return _Side(result[0], result[1], float(spread[0]))


def _earlier(series: Series, start: float, step: float) -> Series:
    return replace(series, time=np.where(series.time > start, series.time - step, series.time))


def _resets(recording: Recording) -> Iterator[tuple[float, Array]]:
    """Time of the first sample after each reset, and the turn of the world about its vertical."""
    if "attitude" not in recording or "gyro" not in recording:
        return
    attitude, gyro = recording["attitude"], recording["gyro"]
    if gyro.columns != ("x", "y", "z") or attitude.columns != ("w", "x", "y", "z"):
        return
    if len(attitude) < 4 * MIN_MISSING or len(gyro) < 4 * MIN_MISSING:
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
        result = rotation.multiply(q[row], rotation.from_rotation_vector(after.angle))
        turn = rotation.multiply(result, rotation.conjugate(base))
        about = rotation.to_rotation_vector(turn)
        if np.hypot(about[0], about[1]) < max(UPRIGHT * np.linalg.norm(about), SURE * sigma):
            # the lean that noise gives it would bend gravity from there on
            yield float(time[row + 1]), rotation.from_rotation_vector(about * [0.0, 0.0, 1.0])


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


Finder = Callable[[Series, str, str], tuple[Mask, str]]
"""Of a series, its name and its unit: (m,) rows to leave out, and a sentence on them."""

OF_PARTS = ("wheel_speed", "gimbal_angle")
"""Streams of parts that cannot jump. Thrusters and coils make an accelerometer and a magnetometer
jump, and a stage stands still."""


def cleaned(
    recording: Recording, *, all_axes: bool = True, wheel_axes: Sequence[Array] = ()
) -> Recording:
    """A log without samples that are no measurements; `repairs` says what was left out or undone.

    Args:
        recording: a log.
        all_axes: the body turns about all axes; else a sensor with a dead axis is of use too.
        wheel_axes: in body axes, (3,) each, against which a gyro shows a wheel's sign.
    """
    recording, undone = without_steps(recording)
    recording, signed = with_signs(recording, wheel_axes)
    recording, counted = _by_passages(recording)
    streams, said = dict(recording.streams), [*recording.repairs, *undone, *signed, *counted]
    for name, series in recording.items():
        # a stream that says nothing at all is refused elsewhere
        if series.stands_still:
            continue
        dead = dead_axes(series) if all_axes and name in OF_AXES else ()
        if dead:
            if not is_needed(name, recording):
                del streams[name]
                said.append(f"{dead_words(name, dead)}: {name} is not used")
            continue
        for find, names in FINDERS:
            if name not in names:
                continue
            lost, sentence = find(streams[name], name, recording.unit_of(name))
            if lost.any():
                streams[name] = streams[name].only(~lost)
                said.append(sentence)
    return replace(recording, streams=streams, repairs=tuple(said))


def _by_passages(recording: Recording) -> tuple[Recording, list[str]]:
    """Counts of whole turns as the instants at which the mark passed, each said."""
    streams, said = dict(recording.streams), list[str]()
    for name in ANGLES:
        if name in streams and counts_turns(streams[name]):
            before = len(streams[name])
            streams[name] = passages(streams[name])
            said.append(
                f"{name} counts whole turns: of {before} samples the {len(streams[name])} at which "
                "the count changes are used, as passages of its mark"
            )
    return replace(recording, streams=streams), said


def is_needed(name: str, recording: Recording) -> bool:
    """Whether nothing else in a log shows the motion that a sensor measures."""
    return name != "magnetometer" and "attitude" not in recording


def dead_words(name: str, axes: Sequence[str]) -> str:
    """That axes of a sensor are dead, as the begin of a sentence."""
    verb = "keeps" if len(axes) == 1 else "keep"
    return f"{name} {', '.join(axes)} {verb} one value in nearly all rows while other axes scatter"


def _at_range_ends(series: Series, name: str, unit: str) -> tuple[Mask, str]:
    result = range_ends(series)
    lost = with_neighbours(result.rows)
    if not lost.any():
        return lost, ""
    sizes = sorted({round(abs(end), 12) for end in result.ends})
    ends = " or ".join(printed(size, unit, sizes[-1]) for size in sizes)
    count = np.count_nonzero(result.rows)
    share = f"{100.0 * count / len(series):.2g}"
    return lost, (
        f"{count} of {len(series)} samples of {name} ({share} %) are at {ends}, the end of its "
        "range, and are not used, nor are those next to them"
    )


def _hung(series: Series, name: str, unit: str) -> tuple[Mask, str]:
    del unit
    lost = stopped(series, steady=name in OF_PARTS)
    words = "repeat one that was read before, as of a sensor that hung"
    return lost, _sentence(name, series, lost, words)


def _stuck(series: Series, name: str, unit: str) -> tuple[Mask, str]:
    del unit
    stuck = stuck_rows(series)
    axes = [column for column, item in zip(series.columns, stuck.T, strict=True) if item.any()]
    lost: Mask = np.asarray(stuck.any(axis=1))
    words = f"have {' or '.join(axes)} stuck at one value while the other axes scatter"
    return lost, _sentence(name, series, lost, words)


def _not_measured(series: Series, name: str, unit: str) -> tuple[Mask, str]:
    del unit
    sensor = slow_sensor(series)
    if sensor is None:
        return np.zeros(len(series), dtype=np.bool_), ""
    lost = ~sensor.measured
    words = (
        "lie on the straight line between two others"
        if sensor.interpolated
        else "repeat the one before"
    )
    return lost, (
        f"{np.count_nonzero(lost)} of {len(series)} samples of {name} {words}: the sensor gives "
        f"{three_digits(sensor.rate)} Hz, and its fresh samples are used"
    )


def _glitches(series: Series, name: str, unit: str) -> tuple[Mask, str]:
    del unit
    lost = glitches(series)
    return lost, _sentence(name, series, lost, "lie far off the ones before and after")


FINDERS: tuple[tuple[Finder, tuple[str, ...]], ...] = (
    (_at_range_ends, CLIPPED),
    (_hung, (*OF_MOTION, *OF_PARTS)),
    (_stuck, OF_AXES),
    (_not_measured, SLOW),
    (_glitches, (*OF_MOTION, *OF_PARTS)),
)
"""What is looked for, in this order, and the streams in which it is."""


def _sentence(name: str, series: Series, lost: Mask, words: str) -> str:
    time = series.time[lost]
    count = len(time)
    if not count:
        return ""
    where = f"at {time[0]:.6g} s" if count == 1 else f"from {time[0]:.6g} to {time[-1]:.6g} s"
    verb = words if count > 1 else words.replace("repeat ", "repeats ").replace("lie ", "lies ")
    return f"{count} of {len(series)} samples of {name}, {where}, {verb}, and are not used"
