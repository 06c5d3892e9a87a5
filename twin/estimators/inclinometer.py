"""Tilt from an inclinometer alone, and the rate by its differences."""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.estimators.estimator import (
    Estimator,
    blank,
    encoders,
    instead,
    newest,
    ready_runs,
    shared,
    still_awaited,
)
from twin.platform import Platform
from twin.rotation import conjugate, from_euler_zyx, multiply, to_rotation_vector
from twin.signals import Estimate, Reading, Samples

Array = NDArray[np.float64]


@dataclass(slots=True, kw_only=True)
class TiltEstimate(Estimate):
    """The estimate at the newest sample, and when that was."""

    tilt_time: Array
    """(n,) [s]; NaN before the first."""


@dataclass(frozen=True)
class InclinometerDifferences(Estimator):
    """The newest tilt as an attitude without yaw, and its change since the tick before as the rate.

    q = q(yaw 0, pitch, asin(sin roll / cos pitch)),   w = log(q_0^* q_1) / (t_1 - t_0)

    The rate is half a period old, lacks the turn about the vertical, and carries the resolution
    over the period: 3.5e-4 rad/s for 0.001 deg at 20 Hz.

    Source: S. Y. Choi, Automatic mass balancing system for the 5-DOF spacecraft simulator, Georgia
    Institute of Technology 2016, section 4.2: what its experiment was flown with.
    """

    def init(self, platform: Platform, n: int) -> TiltEstimate:
        """Level and at rest, not valid."""
        if "inclinometer" not in platform.sensors:
            raise UsageError(
                f"the estimator 'inclinometer' needs one, and {platform.name} has none; "
                f"{instead(platform)}"
            )
        return TiltEstimate(
            **shared(blank(platform, n)),
            tilt_time=np.full(n, np.nan),
        )

    def shows(self, platform: Platform) -> frozenset[str]:
        """No heading."""
        del platform
        return frozenset(("attitude", "rate"))

    def update(self, estimate: Estimate, reading: Reading) -> TiltEstimate:
        """Valid from a run's first sample and positions; its rate is 0 until the second sample."""
        before, streams = cast(TiltEstimate, estimate), reading.streams
        attitude, rate, time = before.attitude, before.rate_body, before.tilt_time
        tilts = streams.get("inclinometer")
        if tilts is not None:
            new = np.asarray(tilts.valid.any(axis=1))
            time = newest(_stamps(tilts), time[:, None])[:, 0]
            sines = np.sin(newest(tilts, np.zeros((len(new), 2))))
            cosine = np.sqrt(1.0 - np.square(sines[:, 1]))
            roll = np.arcsin(np.clip(sines[:, 0] / np.maximum(cosine, 1e-12), -1.0, 1.0))
            result = from_euler_zyx(np.zeros_like(roll), np.arcsin(sines[:, 1]), roll)
            attitude = np.where(new[:, None], result, attitude)
            turn = to_rotation_vector(multiply(conjugate(before.attitude), attitude))
            period = (time - before.tilt_time)[:, None]
            rate = rate.copy()
            np.divide(turn, period, out=rate, where=new[:, None] & (period > 0.0))
        oriented, awaited = ~np.isnan(time), still_awaited(streams, before)
        return replace(
            before,
            time=reading.time,
            attitude=attitude,
            rate_body=rate,
            **encoders(streams, before),
            valid=ready_runs(oriented, awaited),
            oriented=oriented,
            awaited=awaited,
            tilt_time=time,
        )


def _stamps(samples: Samples) -> Samples:
    """When each sample was true, as if it were its value."""
    return Samples(samples.time[..., None], samples.time, samples.valid)
