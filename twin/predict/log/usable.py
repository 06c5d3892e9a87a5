"""Samples that say nothing of the motion are not used: at the end of the range that platform.toml
states, or no measurements at all by `twin.noise.cleaning`. Each kind is counted and said."""

from dataclasses import replace

import numpy as np

from twin.noise.cleaning import cleaned
from twin.noise.clipping import with_neighbours
from twin.platform import Platform
from twin.recording import Recording
from twin.units import printed

AT_RANGE = 1e-3
"""Of the range: so near to it a reading is taken to be at its end."""


def usable(recording: Recording, platform: Platform) -> Recording:
    """A log without samples that say nothing of the motion; `repairs` says so."""
    held, said = within_range(recording, platform)
    return cleaned(
        replace(held, repairs=(*held.repairs, *said)),
        all_axes=turns_about_all_axes(platform),
        wheel_axes=[wheel.axis for wheel in platform.wheels if wheel.gimbal is None],
    )


def turns_about_all_axes(platform: Platform) -> bool:
    """Whether the base turns about three axes, so that a sensor must measure all of them."""
    base = platform.base
    return base.kind != "hinge" and not base.planar and not base.locked


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
            streams[name] = series.only(~with_neighbours(~good))
            said.append(
                f"{lost} of {len(series)} samples of {name} are at the end of its range, "
                f"{printed(sensor.range, series.unit)}, and are not used, nor are those next "
                "to them"
            )
    return replace(recording, streams=streams), tuple(said)
