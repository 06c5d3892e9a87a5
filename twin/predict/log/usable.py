"""Samples that say nothing of the motion are not used: at the end of a sensor's range, repeated by
a sensor that hung, or far off between good ones. Each is counted and said."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.noise.glitches import glitches
from twin.noise.stopped import stopped
from twin.platform import Platform
from twin.recording import Recording, Series
from twin.signals import OF_MOTION
from twin.units import printed

Mask = NDArray[np.bool_]

AT_RANGE = 1e-3
"""Of the range: so near to it a reading is taken to be at its end."""
OF_PARTS = ("wheel_speed", "gimbal_angle")
"""Streams of parts that cannot jump. Thrusters and coils make an accelerometer and a magnetometer
jump, and a stage stands still."""


def usable(recording: Recording, platform: Platform) -> Recording:
    """A log without samples that say nothing of the motion; `repairs` says so."""
    held, said = within_range(recording, platform)
    return cleaned(replace(held, repairs=(*held.repairs, *said)))


def within_range(recording: Recording, platform: Platform) -> tuple[Recording, tuple[str, ...]]:
    """A log without the samples at the range that platform.toml states, and a sentence a stream."""
    streams = dict(recording.streams)
    said: list[str] = []
    for name, sensor in platform.sensors.items():
        if name not in streams or not np.isfinite(sensor.range):
            continue
        series = streams[name]
        good = np.all(np.abs(series.value) < sensor.range * (1.0 - AT_RANGE), axis=1)
        lost = int(np.count_nonzero(~good))
        if lost:
            streams[name] = _only(series, good)
            said.append(
                f"{lost} of {len(series)} samples of {name} are at the end of its range, "
                f"{printed(sensor.range, series.unit)}, and are not used"
            )
    return replace(recording, streams=streams), tuple(said)


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
                streams[name] = _only(series, ~lost)
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


def _only(series: Series, good: Mask) -> Series:
    return replace(series, time=series.time[good], value=series.value[good])
