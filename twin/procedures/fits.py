"""Identification between phases, in another process, while the loop runs."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.estimators.offset_filter import BIAS, MOMENT, GyrostatEstimate, OffsetFilter
from twin.identification import Identification, Misfit, identify
from twin.plant.replayed import ReplayedPlant
from twin.platform import Platform
from twin.processes import Pool, first_completed
from twin.recording import Recording
from twin.rotation import skew

Array = NDArray[np.float64]

SAME = 1e-6
"""Relative difference of what two fits leave: they are the same, wherever they began."""


@dataclass(frozen=True)
class MomentFit:
    """What logs say, or why they say nothing."""

    moment: Array
    """(3,) m r at stage position 0 [kg m, body]."""
    covariance: Array
    """(3, 3) of it."""
    quantile: float
    """Half a 95 % interval is this many standard deviations."""
    inertia: Array
    """(3, 3) at stage position 0 [kg m^2]."""
    misfit: Misfit
    """Of all streams of the logs together."""
    failure: str = ""
    """A sentence; empty when all is well."""


def fit_moment(recordings: Sequence[Recording], platform: Platform, guesses: Array) -> MomentFit:
    """J and m r by prediction error from some logs, together.

    Args:
        recordings: of one run.
        platform: the machine as stated.
        guesses: (k, 3) m r to begin from [kg m]; the next one where the last led to more than
            noise, until two lead to the same. The likeliest fit counts.
    """
    best: Identification | None = None
    failure = ""
    for guess in guesses:
        try:
            identification = identify(recordings, replace(platform, center_of_mass_offset=guess))
        except TwinError as problem:
            failure = str(problem)
            continue
        if identification.fit is None or not identification.fit.converged:
            failure = "the fit of J and m r did not settle"
            continue
        misfit = identification.misfit[0].chi2_per_sample
        smallest = np.inf if best is None else best.misfit[0].chi2_per_sample
        best = identification if misfit < smallest else best
        if identification.misfit[0].is_noise or np.isclose(misfit, smallest, rtol=SAME):
            break
    if best is None:
        return _failed(failure)
    spread = best.base.map @ best.covariance @ best.base.map.T
    entries = best.base.entries(best.theta)
    xx, yy, zz, xy, xz, yz = entries[:6]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return MomentFit(entries[6:], spread[6:, 6:], best.quantile, inertia, best.misfit[0])


def filter_moment(recordings: Sequence[Recording], platform: Platform, guesses: Array) -> MomentFit:
    """m r by the Kalman filter of paper 001, all three offsets of it (`OffsetFilter`), J as stated.

    Each log goes through the filter tick by tick; the next one begins with what the last has told.
    The filter is linear about its estimate, which is far off at first: it goes through the logs
    again from where it came, with the same uncertainty, until it comes to the same. What a constant
    error of an inclinometer or an accelerometer does (m r off by that x m r) is added to the
    covariance, and a misfit beyond noise scales it.

    Args:
        recordings: of one run.
        platform: the machine as stated.
        guesses: (k, 3) m r [kg m]; the filter begins at none, within twice the largest of them.
    """
    widest = 2.0 * float(np.abs(guesses).max(initial=0.0)) / platform.mass
    usual = OffsetFilter()
    share = float(np.trace(platform.inertia)) / _USUAL
    estimator = OffsetFilter(
        torque_noise=share * usual.torque_noise,
        wheel_noise=share * usual.wheel_noise,
        offset_start=max(widest, _NARROW),
    )
    try:
        end = _filtered(estimator, recordings, platform, np.zeros(3))
        for _ in range(_PASSES):
            before, sigma = end.moment[0], np.sqrt(np.diag(end.spread[0, MOMENT, MOMENT]))
            end = _filtered(estimator, recordings, platform, before)
            if (np.abs(end.moment[0] - before) <= 0.1 * sigma).all():
                break
    except (TwinError, np.linalg.LinAlgError) as problem:
        return _failed(str(problem))
    moment, covariance = end.moment[0], end.spread[0, MOMENT, MOMENT]
    if not (np.isfinite(moment).all() and np.isfinite(covariance).all()):
        return _failed("the filter of m r lost the motion")
    count = float(end.counted[0])
    misfit = float(end.squares[0]) / max(count, 1.0)
    half = 1.96 * np.sqrt(2.0 / max(count, 1.0))
    tipped = skew(end.center_of_mass_offset)[0]
    covariance = covariance * max(misfit, 1.0) + tipped @ _tilt_variance(platform) @ tipped.T
    judged = Misfit("all streams", misfit, 1.0 - half, 1.0 + half)
    return MomentFit(moment, covariance, 1.96, platform.inertia, judged)


_PASSES = 5
"""Of the filter through the logs at most, after the first."""
_NARROW = 1e-4
"""1 sigma of the offset that the filter begins with at least [m]."""
_USUAL = 49.5
"""Sum of the principal moments of `astros`, for whose size the filter's noises are stated
[kg m^2]."""


def _filtered(
    estimator: OffsetFilter, recordings: Sequence[Recording], platform: Platform, moment: Array
) -> GyrostatEstimate:
    """After all logs, begun at m r (3,) [kg m]."""
    known: GyrostatEstimate | None = None
    for recording in recordings:
        plant = ReplayedPlant(platform, recording)
        estimate = estimator.init(plant.platform, 1)
        spread = estimate.spread.copy()
        if known is not None:
            spread[:, MOMENT, MOMENT] = known.spread[:, MOMENT, MOMENT]
            spread[:, BIAS, BIAS] = known.spread[:, BIAS, BIAS]
            estimate = replace(
                estimate,
                gyro_bias=known.gyro_bias,
                squares=known.squares,
                counted=known.counted,
            )
        start = moment[None] if known is None else known.moment
        estimate = replace(estimate, moment=start, spread=spread)
        for time in np.arange(0.0, plant.duration, platform.tick):
            estimate = estimator.update(estimate, plant.read(float(time)))
            estimate = estimator.with_command(estimate, plant.write({}))
        known = estimate
    assert known is not None
    return known


def _tilt_variance(platform: Platform) -> Array:
    """(3, 3) by which a constant error of what shows the vertical tilts it [rad^2]."""
    sensors = platform.sensors
    if "attitude" in sensors:
        return np.zeros((3, 3))
    if "inclinometer" in sensors:
        roll, pitch = sensors["inclinometer"].bias
        return np.diag([roll**2, pitch**2, 0.0])
    x, y, _ = sensors["accelerometer"].bias / platform.gravity
    return np.diag([y**2, x**2, 0.0])


def _failed(sentence: str) -> MomentFit:
    nothing = Misfit("", np.nan, np.nan, np.nan)
    return MomentFit(np.zeros(3), np.eye(3), 1.96, np.eye(3), nothing, sentence)


class Fits:
    """Asked run by run; an answer is waited for, or looked for at each tick on a wall's clock."""

    def __init__(
        self,
        platform: Platform,
        *,
        fit: Callable[[Sequence[Recording], Platform, Array], MomentFit] = fit_moment,
        workers: int = 1,
        wait: bool = True,
    ) -> None:
        """Start the processes.

        Args:
            platform: the machine as stated.
            fit: `fit_moment` or `filter_moment`.
            workers: processes; 0 fits in this one, and holds the loop up meanwhile.
            wait: for an answer, so that a simulation does not depend on how long a fit takes.
        """
        self._platform = platform
        self.by = fit
        """What finds m r in logs."""
        self._wait = wait
        self._workers = workers
        self._pool = Pool(workers) if workers else None
        self._waiting: dict[int, Future[MomentFit]] = {}

    def ask(self, run: int, recordings: Sequence[Recording], guesses: Array) -> None:
        """Begin to identify a run's logs, all together, from guesses (k, 3) of m r [kg m]."""
        logs = tuple(recordings)
        if self._pool is None:
            future: Future[MomentFit] = Future()
            future.set_result(self.by(logs, self._platform, guesses))
        else:
            try:
                future = self._pool.submit(self.by, logs, self._platform, guesses)
            except BrokenProcessPool:
                self._pool.end()
                self._pool = Pool(self._workers)
                future = self._pool.submit(self.by, logs, self._platform, guesses)
        self._waiting[run] = future

    def answer(self, run: int) -> MomentFit | None:
        """What was found for a run; None while it is being looked for.

        Where its process died, of too little memory for one, that is why nothing was found; what is
        asked next is asked of others.

        Raises:
            Stopped: a stop was requested while an answer was waited for.
        """
        future = self._waiting[run]
        if self._wait:
            first_completed([future])
        elif not future.done():
            return None
        del self._waiting[run]
        try:
            return future.result()
        except BrokenProcessPool:
            return _failed("the process that fits died")

    @property
    def waiting(self) -> Mapping[int, object]:
        """The runs that wait for an answer."""
        return self._waiting

    def close(self) -> None:
        """End the processes; what they still do is not waited for."""
        if self._pool is not None:
            self._pool.end()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
