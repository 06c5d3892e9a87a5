"""A log without what hung sensors repeat and without glitches, each counted and said."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.noise.glitches import glitches
from twin.noise.stopped import stopped
from twin.recording import Recording, Series
from twin.signals import OF_MOTION

Mask = NDArray[np.bool_]

OF_PARTS = ("wheel_speed", "gimbal_angle")
"""Streams of parts that cannot jump. Thrusters and coils make an accelerometer and a magnetometer
jump, and a stage stands still."""


def cleaned(recording: Recording) -> Recording:
    """A log without what hung sensors repeat and without glitches; `repairs` says so."""
    streams, said = dict(recording.streams), list(recording.repairs)
    for name in (*OF_MOTION, *OF_PARTS):
        # one that says nothing at all is refused elsewhere
        if name not in streams or streams[name].stands_still:
            continue
        for find, words in (
            (_stopped_of(name), "repeat one that was read before, as of a sensor that hung"),
            (glitches, "lie far off the ones before and after"),
        ):
            series = streams[name]
            lost = find(series)
            if lost.any():
                streams[name] = series.only(~lost)
                said.append(_sentence(name, series, lost, words))
    return replace(recording, streams=streams, repairs=tuple(said))


def _stopped_of(name: str) -> Callable[[Series], Mask]:
    return lambda series: stopped(series, steady=name in OF_PARTS)


def _sentence(name: str, series: Series, lost: Mask, words: str) -> str:
    time = series.time[lost]
    count = len(time)
    where = f"at {time[0]:.6g} s" if count == 1 else f"from {time[0]:.6g} to {time[-1]:.6g} s"
    verb = words if count > 1 else words.replace("repeat ", "repeats ").replace("lie ", "lies ")
    return f"{count} of {len(series)} samples of {name}, {where}, {verb}, and are not used"
