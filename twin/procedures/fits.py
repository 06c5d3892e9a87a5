"""Identification between phases, in another process, while the loop runs."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.identification import Identification, Misfit, identify
from twin.platform import Platform
from twin.processes import Pool, first_completed
from twin.recording import Recording

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


def _failed(sentence: str) -> MomentFit:
    nothing = Misfit("", np.nan, np.nan, np.nan)
    return MomentFit(np.zeros(3), np.eye(3), 1.96, np.eye(3), nothing, sentence)


class Fits:
    """Asked run by run; an answer is waited for, or looked for at each tick on a wall's clock."""

    def __init__(self, platform: Platform, *, workers: int = 1, wait: bool = True) -> None:
        """Start the processes.

        Args:
            platform: the machine as stated.
            workers: processes; 0 fits in this one, and holds the loop up meanwhile.
            wait: for an answer, so that a simulation does not depend on how long a fit takes.
        """
        self._platform = platform
        self._wait = wait
        self._workers = workers
        self._pool = Pool(workers) if workers else None
        self._waiting: dict[int, Future[MomentFit]] = {}

    def ask(self, run: int, recordings: Sequence[Recording], guesses: Array) -> None:
        """Begin to identify a run's logs, all together, from guesses (k, 3) of m r [kg m]."""
        logs = tuple(recordings)
        if self._pool is None:
            future: Future[MomentFit] = Future()
            future.set_result(fit_moment(logs, self._platform, guesses))
        else:
            try:
                future = self._pool.submit(fit_moment, logs, self._platform, guesses)
            except BrokenProcessPool:
                self._pool.end()
                self._pool = Pool(self._workers)
                future = self._pool.submit(fit_moment, logs, self._platform, guesses)
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
