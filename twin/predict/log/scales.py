"""Streams whose factor to SI nobody knows (`scale = "fit"`): a first guess of it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.predict.log.motion import Motion, motion_of, swing_rate
from twin.recording import Recording, Series

Array = NDArray[np.float64]

SWING = 0.5
"""Where nothing else shows how far a pendulum swings, it is first taken to swing so far [rad]."""

RATES = ("gyro", "joint_rate")
"""Streams whose scale can be fitted: an unknown scale of a rate."""


@dataclass(frozen=True)
class Scaled:
    """A log in SI, as far as its scales are known."""

    recording: Recording
    factor: Mapping[str, float]
    """To SI, of each stream whose scale is sought; its offset was taken out before."""

    def by(self, change: Mapping[str, float]) -> "Scaled":
        """With the factors multiplied by further ones."""
        recording = self.recording
        for name, factor in change.items():
            recording = _times(recording, name, factor, 0.0)
        return Scaled(recording, {n: f * change.get(n, 1.0) for n, f in self.factor.items()})


def first_scaled(recording: Recording, platform: Platform) -> Scaled:
    """Guess the scales: from the other streams of the motion, else from a swing of half a radian.

    The offset of such a stream is as unknown as its scale. It is taken for the mean of what the
    other streams do not show.
    """
    scaled = Scaled(recording, {})
    for name in sought(recording):
        series = recording[name]
        shown = _shown(recording, platform, name)
        if shown is None:
            offset = series.value.mean(axis=0)
            size = np.sqrt(2.0) * float((series.value - offset).std())
            hinge = platform.base.kind == "hinge"
            factor = SWING * swing_rate(platform) / size if hinge and size > 0.0 else 0.0
            if factor == 0.0:
                factor, offset = 1.0, np.zeros_like(offset)
        else:
            rate = shown.at(series.time).rate
            centred = series.value - series.value.mean(axis=0)
            slope = float(np.sum(centred * (rate - rate.mean(axis=0))) / np.sum(np.square(centred)))
            factor = slope if slope != 0.0 else 1.0
            offset = series.value.mean(axis=0) - rate.mean(axis=0) / factor
        recording = _times(recording, name, factor, offset)
        scaled = Scaled(recording, {**scaled.factor, name: factor})
    return replace(scaled, recording=recording)


def sought(recording: Recording) -> tuple[str, ...]:
    """The rates whose log.toml says `scale = "fit"`."""
    facts = _facts(recording)
    return tuple(n for n in RATES if n in recording and facts.get(n, {}).get("fit_scale"))


def unit_of(recording: Recording, name: str) -> str:
    """The unit that the file of a stream is in."""
    stated = _facts(recording).get(name, {}).get("unit")
    return stated if isinstance(stated, str) else recording[name].unit


def _shown(recording: Recording, platform: Platform, name: str) -> Motion | None:
    """The motion by the other streams."""
    needed = "joint_angle" if platform.base.kind == "hinge" else "attitude"
    if needed not in recording:
        return None
    kept = {key: series for key, series in recording.items() if key != name}
    return motion_of(replace(recording, streams=kept), platform)


def _times(recording: Recording, name: str, factor: float, offset: Array | float) -> Recording:
    series = recording[name]
    moved = Series(series.time, (series.value - offset) * factor, series.columns, series.unit)
    facts = dict(_facts(recording))
    noise = facts.get(name, {}).get("noise")
    if noise is not None:
        scaled = (np.asarray(noise, dtype=np.float64) * abs(factor)).tolist()
        facts[name] = {**facts[name], "noise": scaled}
    return replace(
        recording,
        streams={**recording.streams, name: moved},
        provenance={**recording.provenance, "streams": facts},
    )


def _facts(recording: Recording) -> Mapping[str, Mapping[str, Any]]:
    return cast(Mapping[str, Mapping[str, Any]], recording.provenance.get("streams") or {})
