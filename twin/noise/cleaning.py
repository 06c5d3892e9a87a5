"""A log without samples that are no measurements, each kind counted and said.

In this order: steps of the clock and resets of the attitude are undone, wheel speeds without a sign
get theirs, and a pulse a turn becomes the passages of its mark. Left out are streams with a dead
axis, samples at the end of a sensor's range, those that a sensor repeats after it hung, those of
one stuck axis, those that a slow sensor repeats or that are interpolated between its measurements,
and glitches.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.noise.clipping import CLIPPED, range_ends, with_neighbours
from twin.noise.glitches import glitches
from twin.noise.held import SLOW, slow_sensor
from twin.noise.index_pulse import ANGLES, counts_turns, passages
from twin.noise.steps import without_steps
from twin.noise.stopped import stopped
from twin.noise.stuck import OF_AXES, dead_axes, stuck_rows
from twin.noise.tachometer import with_signs
from twin.recording import Recording, Series
from twin.signals import OF_MOTION
from twin.units import printed, three_digits

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
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
    found = range_ends(series)
    lost = with_neighbours(found.rows)
    if not lost.any():
        return lost, ""
    sizes = sorted({round(abs(end), 12) for end in found.ends})
    ends = " or ".join(printed(size, unit, sizes[-1]) for size in sizes)
    count = np.count_nonzero(found.rows)
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
    axes = [column for column, one in zip(series.columns, stuck.T, strict=True) if one.any()]
    lost: Mask = np.asarray(stuck.any(axis=1))
    words = f"have {' or '.join(axes)} stuck at one value while the other axes scatter"
    return lost, _sentence(name, series, lost, words)


def _not_measured(series: Series, name: str, unit: str) -> tuple[Mask, str]:
    del unit
    found = slow_sensor(series)
    if found is None:
        return np.zeros(len(series), dtype=np.bool_), ""
    lost = ~found.measured
    words = (
        "lie on the straight line between two others"
        if found.interpolated
        else "repeat the one before"
    )
    return lost, (
        f"{np.count_nonzero(lost)} of {len(series)} samples of {name} {words}: the sensor gives "
        f"{three_digits(found.rate)} Hz, and its fresh samples are used"
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
