"""A whole balancing of many runs against bare `Batch.step`, with its fits and without them.

A fit takes seconds where the rest of the procedure takes microseconds a tick, so the two are told
apart. Many runs go through every phase with fits that are answered at once, from the truth; then
some go through it with fits as they are, and each fit is timed.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from benchmarks.batch import bare_batch
from benchmarks.measure import median, seconds, spread, table
from twin.clock import SimulatedClock
from twin.estimators import load_estimator, usual_estimator
from twin.identification import Misfit
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.procedures import Balancing, Fits, Lab, balancing, random_offsets, usual_target
from twin.procedures.fits import MomentFit, fit_moment
from twin.recording import Recording
from twin.reference import Hold

Array = NDArray[np.float64]

MACHINE = "cubesat"
RUNS = 256
"""Of each process, as in a campaign."""
FITTED = 4
"""Runs that are fitted, of all processes together."""
SEED = 1
CAP = 3600.0
"""[s]."""
BLOCK, BARE = 200, 20
"""Ticks of the loop and of bare physics in a turn."""
ERROR = 1e-3
"""Of what the truth is told with, in parts of what the target allows."""


@dataclass(frozen=True)
class Balanced:
    """What one process measured."""

    bare: float
    """[us a run and tick], median of its turns."""
    flown: Sequence[float]
    """The same of the loop, turn by turn, fits left out."""
    runs: int
    ticks: int
    fits: Sequence[float]
    """Seconds of each."""
    done: int
    """Runs that were balanced."""


class Answered(Fits):
    """Fits that are answered at once, from the truth."""

    def __init__(self, platform: Platform, offsets: Array, target: float) -> None:
        super().__init__(platform, workers=0)
        self._machine = platform
        self._offsets = offsets
        self._variance = (ERROR * target / platform.gravity) ** 2

    def ask(self, run: int, recordings: Sequence[Recording], guesses: Array) -> None:
        """Answer; the logs are made all the same."""
        del recordings, guesses
        future: Future[MomentFit] = Future()
        spread_out = self._variance * np.eye(3)
        noise = Misfit("", 1.0, 0.0, 2.0)
        fit = MomentFit(self._offsets[run], spread_out, 1.96, self._machine.inertia, noise)
        future.set_result(fit)
        self._waiting[run] = future


class Timed(Fits):
    """Fits in this process, each of them timed."""

    def __init__(self, platform: Platform) -> None:
        super().__init__(platform, workers=0)
        self._machine = platform
        self.took: list[float] = []

    def ask(self, run: int, recordings: Sequence[Recording], guesses: Array) -> None:
        """Fit, and note how long it took."""
        future: Future[MomentFit] = Future()
        start = time.perf_counter()
        future.set_result(fit_moment(recordings, self._machine, guesses))
        self.took.append(time.perf_counter() - start)
        self._waiting[run] = future


class TurnsClock(SimulatedClock):
    """Every so many ticks bare physics has its turn; both are timed."""

    def __init__(self, other: Callable[[int], None], fits: Sequence[float]) -> None:
        super().__init__()
        self.loop: list[float] = []
        """Seconds a tick, without what fits took."""
        self.bare: list[float] = []
        """Seconds a tick."""
        self._other = other
        self._fits = fits

    def ticks(self, period: float, duration: float) -> Iterator[float]:
        """As the simulated clock's."""
        start, fitted = time.perf_counter(), sum(self._fits)
        for number, tick in enumerate(super().ticks(period, duration)):
            if number and number % BLOCK == 0:
                thought = sum(self._fits) - fitted
                self.loop.append((time.perf_counter() - start - thought) / BLOCK)
                self.bare.append(seconds(partial(self._other, BARE)) / BARE)
                start, fitted = time.perf_counter(), sum(self._fits)
                self._mark = start
            yield tick


def balanced() -> None:
    """Print the table."""
    cores = len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(cores, mp_context=get_context("spawn")) as processes:
        without, fitted = (
            [item.result() for item in [processes.submit(_balanced, n, core, fits)
                                      for core in range(cores)]]
            for n, fits in ((RUNS, False), (max(FITTED // cores, 2), True))
        )  # fmt: skip
    turns = [item.bare / tick for item in without for tick in item.flown]
    bare = median([item.bare for item in without])
    loop = median([tick for item in without for tick in item.flown])
    fits = [took for item in fitted for took in item.fits]
    count = len(fits) / sum(item.runs for item in fitted)
    ticks = float(np.mean([item.ticks for item in fitted]))
    whole = loop + 1e6 * float(np.mean(fits)) * count / ticks
    runs, done = sum(item.runs for item in without), sum(item.done for item in without)
    print(
        f"balancing {MACHINE}, direct: {runs} runs in {cores} processes with fits answered from\n"
        f"the truth ({done} of them balanced), and {sum(item.runs for item in fitted)} with fits "
        f"as they are: {count:.1f} a run, {median(fits):.2f} s each\n"
        f"({min(fits):.2f} to {max(fits):.2f}), in {ticks:.0f} ticks.\n"
    )
    table(
        ("balancing", "bare", "flown", "bare / flown", "target"),
        (
            ("all phases, fits answered", f"{bare:.1f}", f"{loop:.1f}", spread(turns, ".2f"), ""),
            ("and its fits", f"{bare:.1f}", f"{whole:.0f}", f"{bare / whole:.3f}", ">= 0.70"),
        ),
    )


def _balanced(n: int, core: int, fit: bool) -> Balanced:
    platform = load_platform(MACHINE)
    target = usual_target(platform)
    runs = range(core * n, (core + 1) * n)
    offsets = random_offsets(platform, SEED, runs.stop)[list(runs)]
    fits = Timed(platform) if fit else Answered(platform, offsets, target)
    procedure = _with(balancing(platform, n, way="direct", target=target, workers=0), fits)
    clock = TurnsClock(bare_batch(platform, n, 1), fits.took if isinstance(fits, Timed) else ())
    initial = InitialState(center_of_mass_offset=offsets)
    with SimulatedPlant(platform, runs=runs, seed=SEED, initial=initial, threads=1) as plant:
        fly(
            plant,
            load_estimator(usual_estimator(platform)),
            procedure,
            Hold(),
            clock,
            duration=CAP,
            observers=[procedure.lab.logbook],
        )
    per = 1e6 / n
    return Balanced(
        bare=median(clock.bare) * per,
        flown=[tick * per for tick in clock.loop],
        runs=n,
        ticks=clock.timing.ticks,
        fits=fits.took if isinstance(fits, Timed) else (),
        done=sum(run.phase.name == "done" for run in procedure.lab.notes.runs),
    )


def _with(procedure: Balancing, fits: Fits) -> Balancing:
    lab = procedure.lab
    return replace(procedure, lab=Lab(lab.logbook, fits, lab.notes))
