"""The methods of the papers by name, each as it stands there, beside our own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.identification.levenberg_marquardt import levenberg_marquardt
from twin.identification.linear.equations import (
    Equations,
    energy,
    filtered,
    integrated,
    natural,
    power,
    shifted,
)
from twin.identification.linear.equilibria import equilibria
from twin.identification.linear.least_squares import BLOCK, Estimate, least_squares
from twin.identification.linear.recursive import recursive
from twin.identification.momentum import momentum_fit
from twin.identification.start import first_theta
from twin.identification.track import Track, raw_motion, track_of
from twin.predict.base import BaseParameters
from twin.predict.logs import Motion, motion_of
from twin.recording import Recording

Array = NDArray[np.float64]

FEWEST = 4
"""Blocks of time for each parameter."""

Form = Literal["integrated", "natural"]


@dataclass(frozen=True)
class Settings:
    """What the papers leave to choose."""

    form: Form = "integrated"
    """Of torque, momentum and energy."""
    shift: int = 0
    """Of momentum: samples between the two ends of a difference; 0: no differences, the constant is
    fitted, which is ours."""
    corner: float = 0.5
    """Of filtered [rad/s]."""
    forgetting: float = 0.99
    """Of recursive, what a step of 0.2 s leaves of the weight of what came before."""

    def __post_init__(self) -> None:
        if self.shift < 0:
            raise UsageError(f"a shift is a number of samples, 0 or more, not {self.shift}")
        if not self.corner > 0.0:
            raise UsageError(f"the filter's corner must be above 0 rad/s, not {self.corner:g}")
        if not 0.0 < self.forgetting <= 1.0:
            raise UsageError(f"a forgetting is above 0 and at most 1, not {self.forgetting:g}")

    def named(self, method: str) -> str:
        """A method with what was chosen of it: `momentum, integrated, shift 1`."""
        form = f"{method}, {self.form}"
        return {
            "torque": form,
            "momentum": f"{form}, shift {self.shift}" if self.shift else method,
            "energy": form,
            "filtered": f"{method} at {self.corner:g} rad/s",
            "recursive": f"{method}, forgetting {self.forgetting:g}",
        }.get(method, method)


class Logs:
    """Some logs of one machine, as smoothed and as read."""

    def __init__(self, logs: Sequence[Recording], base: BaseParameters) -> None:
        self.recordings, self.base = logs, base

    @cached_property
    def smoothed(self) -> list[tuple[Recording, Motion]]:
        """Each with its smoothed motion."""
        platform = self.base.machine.platform
        return [(log, motion_of(log, platform)) for log in self.recordings]

    @cached_property
    def tracks(self) -> list[Track]:
        """Of each, as it was read."""
        kind = self.base.machine.platform.base.kind
        return [
            track_of(self.base.machine, log, raw_motion(log, kind), raw=True)
            for log in self.recordings
        ]

    @cached_property
    def calm(self) -> list[Track]:
        """Of each, as smoothed."""
        return [track_of(self.base.machine, log, motion) for log, motion in self.smoothed]


Method = Callable[[Logs, Settings], Estimate]


def _solved(equations: Sequence[Equations], logs: Logs) -> Estimate:
    """Its blocks so short that there are several for each parameter."""
    pairs = zip(equations, logs.tracks, strict=True)
    seconds = sum(float(one.time[-1] - one.time[0]) for one in equations)
    return least_squares(
        [one.about(track.axis) for one, track in pairs],
        logs.base,
        block=min(BLOCK, seconds / (FEWEST * len(logs.base.scale))),
    )


def _form(track: Track, settings: Settings) -> Equations:
    return natural(track) if settings.form == "natural" else integrated(track)


def _torque(logs: Logs, settings: Settings) -> Estimate:
    return _solved([_form(track, settings) for track in logs.tracks], logs)


def _momentum(logs: Logs, settings: Settings) -> Estimate:
    if settings.shift == 0:
        return momentum_fit(logs.smoothed, logs.base)
    return _solved(
        [shifted(_form(t, settings), t.attitude, settings.shift) for t in logs.tracks], logs
    )


def _energy(logs: Logs, settings: Settings) -> Estimate:
    form = power if settings.form == "natural" else energy
    return _solved([form(track) for track in logs.tracks], logs)


def _filtered(logs: Logs, settings: Settings) -> Estimate:
    return _solved([filtered(track, settings.corner) for track in logs.tracks], logs)


def _integrated(logs: Logs, settings: Settings) -> Estimate:
    return _solved([integrated(track) for track in logs.tracks], logs)


def _recursive(logs: Logs, settings: Settings) -> Estimate:
    return recursive(logs.tracks, logs.base, settings.forgetting)


def _equilibria(logs: Logs, settings: Settings) -> Estimate:
    return equilibria(logs.calm, logs.base)


def _levenberg_marquardt(logs: Logs, settings: Settings) -> Estimate:
    first = first_theta(logs.base, momentum_fit(logs.smoothed, logs.base))
    return levenberg_marquardt(logs.smoothed, logs.base, first)


def _ekf(logs: Logs, settings: Settings) -> Estimate:
    from twin.identification.kalman import ekf

    return ekf(list(zip(logs.recordings, logs.tracks, strict=True)), logs.base)


def _ukf(logs: Logs, settings: Settings) -> Estimate:
    from twin.identification.kalman import ukf

    return ukf(list(zip(logs.recordings, logs.tracks, strict=True)), logs.base)


PAPERS: Mapping[str, Method] = {
    "momentum": _momentum,
    "torque": _torque,
    "energy": _energy,
    "filtered": _filtered,
    "integrated": _integrated,
    "recursive": _recursive,
    "levenberg-marquardt": _levenberg_marquardt,
    "ekf": _ekf,
    "ukf": _ukf,
    "equilibria": _equilibria,
}
"""By name."""
