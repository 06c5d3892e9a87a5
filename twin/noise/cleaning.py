"""A log without samples that are no measurements, each kind counted and said.

In this order: samples at the end of a sensor's range, those that a sensor repeats after it hung,
those that a slow sensor repeats or that are interpolated between its measurements, and glitches.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.noise.clipping import CLIPPED, range_ends
from twin.noise.glitches import glitches
from twin.noise.held import SLOW, slow_sensor
from twin.noise.stopped import stopped
from twin.recording import Recording, Series
from twin.signals import OF_MOTION
from twin.units import printed, three_digits

Mask = NDArray[np.bool_]
Finder = Callable[[Series, str, str], tuple[Mask, str]]
"""Of a series, its name and its unit: (m,) rows to leave out, and a sentence on them."""

OF_PARTS = ("wheel_speed", "gimbal_angle")
"""Streams of parts that cannot jump. Thrusters and coils make an accelerometer and a magnetometer
jump, and a stage stands still."""


def cleaned(recording: Recording) -> Recording:
    """A log without samples that are no measurements; `repairs` says what was left out."""
    streams, said = dict(recording.streams), list(recording.repairs)
    for name, series in recording.items():
        # a stream that says nothing at all is refused elsewhere
        if series.stands_still:
            continue
        for find, names in FINDERS:
            if name not in names:
                continue
            lost, sentence = find(streams[name], name, recording.unit_of(name))
            if lost.any():
                streams[name] = streams[name].only(~lost)
                said.append(sentence)
    return replace(recording, streams=streams, repairs=tuple(said))


def _at_range_ends(series: Series, name: str, unit: str) -> tuple[Mask, str]:
    found = range_ends(series)
    if not found.lost.any():
        return found.lost, ""
    sizes = sorted({round(abs(end), 12) for end in found.ends})
    ends = " or ".join(printed(size, unit, sizes[-1]) for size in sizes)
    count = np.count_nonzero(found.lost)
    share = f"{100.0 * count / len(series):.2g}"
    return found.lost, (
        f"{count} of {len(series)} samples of {name} ({share} %) are at {ends}, the end of its "
        "range, and are not used"
    )


def _hung(series: Series, name: str, unit: str) -> tuple[Mask, str]:
    del unit
    lost = stopped(series, steady=name in OF_PARTS)
    words = "repeat one that was read before, as of a sensor that hung"
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
