"""Identification between phases, in another process, while the loop goes on."""

import os
import signal
import sys
import threading
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.identify import Identification, Misfit, identify
from twin.platform import Platform
from twin.recording import Recording

Array = NDArray[np.float64]

SAME = 1e-6
"""Relative difference of what two fits leave: they are the same, wherever they began."""


@dataclass(frozen=True)
class Found:
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


def found_in(recordings: Sequence[Recording], platform: Platform, guesses: Array) -> Found:
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
            one = identify(recordings, replace(platform, center_of_mass_offset=guess))
        except TwinError as problem:
            failure = str(problem)
            continue
        if one.fit is None or not one.fit.converged:
            failure = "the fit of J and m r did not settle"
            continue
        left = one.misfit[0].chi2_per_sample
        least = np.inf if best is None else best.misfit[0].chi2_per_sample
        best = one if left < least else best
        if one.misfit[0].is_noise or np.isclose(left, least, rtol=SAME):
            break
    if best is None:
        return _failed(failure)
    spread = best.base.map @ best.covariance @ best.base.map.T
    entries = best.base.entries(best.theta)
    xx, yy, zz, xy, xz, yz = entries[:6]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Found(entries[6:], spread[6:, 6:], best.quantile, inertia, best.misfit[0])


def _failed(sentence: str) -> Found:
    nothing = Misfit("", np.nan, np.nan, np.nan)
    return Found(np.zeros(3), np.eye(3), 1.96, np.eye(3), nothing, sentence)


class _Processes:
    """They fit until they are told to end, or whoever started them ends in whatever way."""

    def __init__(self, workers: int) -> None:
        context = get_context("spawn")
        ended, self._alive = context.Pipe(duplex=False)
        self._ended = ended
        self._pool = ProcessPoolExecutor(
            workers, mp_context=context, initializer=_begin, initargs=(ended,)
        )

    def ask(
        self, recordings: Sequence[Recording], platform: Platform, guesses: Array
    ) -> Future[Found]:
        """`found_in`, in one of them.

        Raises:
            BrokenProcessPool: one of them died.
        """
        with _deaf():
            return self._pool.submit(found_in, tuple(recordings), platform, guesses)

    def end(self) -> None:
        """At once, whatever they do."""
        self._alive.close()
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._ended.close()


def _begin(ended: Connection) -> None:
    """Of a process that fits. Ctrl-C goes to all processes, and the first one ends them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(ended,), daemon=True).start()


def _end_with(ended: Connection) -> None:
    wait([ended])
    os._exit(0)


@contextmanager
def _deaf() -> Generator[None, None, None]:
    """What starts meanwhile does not hear Ctrl-C either until it has begun; we hear it later."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
        self._processes = _Processes(workers) if workers else None
        self._asked: dict[int, Future[Found]] = {}

    def ask(self, run: int, recordings: Sequence[Recording], guesses: Array) -> None:
        """Begin to identify a run's logs, all together, from guesses (k, 3) of m r [kg m]."""
        if self._processes is None:
            future: Future[Found] = Future()
            future.set_result(found_in(recordings, self._platform, guesses))
        else:
            try:
                future = self._processes.ask(recordings, self._platform, guesses)
            except BrokenProcessPool:
                self._processes.end()
                self._processes = _Processes(self._workers)
                future = self._processes.ask(recordings, self._platform, guesses)
        self._asked[run] = future

    def answer(self, run: int) -> Found | None:
        """What was found for a run; None while it is being looked for.

        Where its process died, of too little memory for one, that is why nothing was found; what is
        asked next is asked of others.
        """
        future = self._asked[run]
        if not (self._wait or future.done()):
            return None
        del self._asked[run]
        try:
            return future.result()
        except BrokenProcessPool:
            return _failed("the process that fits died")

    @property
    def asked(self) -> Mapping[int, object]:
        """The runs that wait for an answer."""
        return self._asked

    def close(self) -> None:
        """End the processes; what they still do is not waited for."""
        if self._processes is not None:
            self._processes.end()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
