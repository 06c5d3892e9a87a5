"""The closed loop of n runs against bare `Batch.step` of the same model.

A loop and the bare batch take turns inside one flight: some ticks of the loop, as many calls of
`Batch.step`. Where there are sensors and recorders, a block holds whole chunks of the recorder and
(but for one tick) whole draws of the gyro's noise, so that the median does not miss what is seldom.
"""

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from mujoco.batch import Batch

from benchmarks.measure import median, seconds, spread, table
from benchmarks.sensors import perfect
from twin.clock import PHASES, SimulatedClock
from twin.controller import load_controller
from twin.estimators import Estimator, load_estimator
from twin.loop import Observer, Outcome, fly
from twin.model import compile_model, untouched
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.reference import Multisine
from twin.stream.provenance import provenance
from twin.stream.recorder import FileRecorder, MemoryRecorder

LEAD = 55
"""Ticks before the first pair; half a chunk off, so that the writer is idle when a block ends."""


@dataclass(frozen=True)
class Case:
    """One line of the table."""

    runs: int
    threads: int
    """0: all cores."""
    loop: Literal["law", "full", "filed"]
    """The law only; with shipped sensors, filter and every run in memory; run 0 in a file, too."""
    pairs: int
    block: int
    """Ticks of each side of a pair; 10 are a chunk of the recorder, 51.2 a draw of the gyro."""
    target: str = ""


CASES = (
    Case(1, 0, loop="law", pairs=45, block=100),
    Case(16, 0, loop="law", pairs=45, block=30),
    Case(256, 0, loop="law", pairs=45, block=10, target=">= 0.95"),
    Case(1024, 0, loop="law", pairs=15, block=10),
    Case(1, 0, loop="full", pairs=15, block=500),
    Case(16, 0, loop="full", pairs=15, block=100),
    Case(256, 0, loop="full", pairs=9, block=50, target=">= 0.85"),
    Case(1024, 0, loop="full", pairs=3, block=50),
    Case(256, 0, loop="filed", pairs=9, block=50),
    Case(256, 1, loop="law", pairs=25, block=10),
    Case(256, 1, loop="full", pairs=5, block=50),
)


def run() -> None:
    """Print both tables: the ratios, and where a tick's time goes."""
    platform = load_platform("sads")
    _print_contacts(platform)
    ratios: list[list[str]] = []
    phases: list[list[str]] = []
    for case in CASES:
        clock, outcome = _measure(platform, case)
        ticks = clock.block * case.runs * 1e-6  # from seconds a block to us a run and tick
        name = [case.loop, f"{case.runs}", f"{case.threads or 'all'}"]
        ratio = [bare / loop for loop, bare in clock.pairs]
        loop, bare = (median(side) / ticks for side in zip(*clock.pairs, strict=True))
        count = f"{case.pairs} x {clock.block} ticks"
        ratios.append(
            [*name, f"{bare:.1f}", f"{loop:.1f}", spread(ratio, ".2f"), case.target, count]
        )
        spent = outcome.timing.seconds
        each = [spent[phase] / (outcome.timing.ticks * case.runs) * 1e6 for phase in PHASES]
        phases.append([*name, *(f"{value:.1f}" for value in each)])
    head = ("loop", "n", "threads")
    print(
        "law: a perfect gyro and attitude at 20 Hz, passed through; quaternion_pd on a multisine.\n"
        "full: shipped sensors, attitude filter, every run kept in memory.\n"
        "filed: run 0 is recorded into a file, too, by a process of its own.\n"
        "us a run and tick (5 steps of 10 ms); ratio: bare / loop, median of pairs (lowest to\n"
        "highest).\n"
    )
    table((*head, "bare", "loop", "ratio", "target", "pairs"), ratios)
    print("\nWhere the loop's time goes, us a run and tick (read holds the physics):\n")
    table((*head, *PHASES), phases)


def _print_contacts(platform: Platform) -> None:
    """What the tilt stop costs, which the loop leaves out while it is far off, as bare does."""
    work = [bare_batch(platform, 256, 0, contacts=contacts) for contacts in (False, True)]
    times = [[seconds(partial(step, 10)) for step in work] for _ in range(6)][1:]
    off, on = (median(side) / (10 * 256) * 1e6 for side in zip(*times, strict=True))
    print(
        f"bare Batch.step(nstep=5) at n = 256: {off:.1f} us a run and tick with the tilt stop's\n"
        f"contact off, {on:.1f} with it on (medians of 5 pairs). The simulated plant switches it\n"
        "on within 5 deg of the stop only; both sides of the ratios below have it off.\n"
    )


def bare_batch(
    platform: Platform, runs: int, threads: int, *, contacts: bool = False
) -> Callable[[int], None]:
    """What advances a bare batch by a number of ticks."""
    model = compile_model(platform).model
    batch = Batch(model, runs, 1 if runs == 1 else threads)
    if not contacts:
        flags = batch.expand("opt.disableflags")
        flags |= untouched(model)

    def advance(ticks: int) -> None:
        for _ in range(ticks):
            batch.step(nstep=platform.steps_per_tick)

    return advance


class PairedClock(SimulatedClock):
    """Lets another work take turns with the loop, and times both."""

    def __init__(self, other: Callable[[int], None], block: int) -> None:
        super().__init__()
        self.block = block
        """Ticks."""
        self.pairs: list[tuple[float, float]] = []
        """Seconds of a block: the loop's, the other's."""
        self._other = other

    def ticks(self, period: float, duration: float) -> Iterator[float]:
        """As the simulated clock's; between two blocks the other has its turn."""
        start = time.perf_counter()
        for number, tick in enumerate(super().ticks(period, duration)):
            if number >= LEAD and (number - LEAD) % self.block == 0:
                loop = time.perf_counter() - start
                bare = seconds(partial(self._other, self.block))
                if number > LEAD:
                    self.pairs.append((loop, bare))
                start = self._mark = time.perf_counter()
            yield tick


def _measure(platform: Platform, case: Case) -> tuple[PairedClock, Outcome]:
    machine = perfect(platform) if case.loop == "law" else platform
    estimator = load_estimator("passthrough" if case.loop == "law" else "filter")
    bare = bare_batch(machine, case.runs, case.threads)
    clock = PairedClock(bare, case.block)
    duration = (LEAD + case.pairs * clock.block) * machine.tick
    with ExitStack() as stack:
        observers: list[Observer] = []
        if case.loop != "law":
            observers.append(MemoryRecorder(machine))
        if case.loop == "filed":
            folder = stack.enter_context(tempfile.TemporaryDirectory())
            observers.append(_file(stack, machine, Path(folder)))
        outcome = _fly(machine, case, estimator, clock, duration, observers)
    return clock, outcome


def _file(stack: ExitStack, platform: Platform, folder: Path) -> Observer:
    file = stack.enter_context(FileRecorder(folder / "flight.rrd"))
    file.start(platform, provenance(platform, seed=0))
    time.sleep(3.0)  # its process imports Rerun, which is no part of a tick
    return file


def _fly(
    platform: Platform,
    case: Case,
    estimator: Estimator,
    clock: PairedClock,
    duration: float,
    observers: Sequence[Observer],
) -> Outcome:
    with SimulatedPlant(platform, runs=range(case.runs), threads=case.threads) as plant:
        law = load_controller("quaternion_pd")
        return fly(
            plant, estimator, law, Multisine(), clock, duration=duration, observers=observers
        )
