"""Steps a second of every shipped machine, bare and in the closed loop, one run and 256.

Bare: `Batch.step` of the compiled model, as the plant steps it far from the stop; and near it, with
contacts. Loop: the shipped sensors passed through, a law of the machine, nothing recorded. They
take turns within one flight, a tick each. Others' work on the machine can only slow a tick down, so
the lower quartile of all ticks is printed; what is seldom, as noise drawn in blocks, is not in it.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from benchmarks.batch import bare_batch
from benchmarks.measure import seconds, table
from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.reference import Hold

LAWS = {
    "astros": "mass_pid",
    "astros:mode_c": "mass_pid",
    "cubesat": "mass_magnetic_pid",
    "sads": "quaternion_pd",
    "tas2": "cmg_pd",
    "whorl1": "quaternion_pd",
    "whorl2": "quaternion_pd",
}
KINDS = ("bare", "near the stop", "loop")
TICKS = {1: 1000, 256: 40}
"""Of one flight, by the number of runs."""


class TurnsClock(SimulatedClock):
    """Lets other work take turns with the loop, tick by tick, and times all of it."""

    def __init__(self, others: Sequence[Callable[[int], None]]) -> None:
        super().__init__()
        self.turns: list[list[float]] = []
        """Seconds of a tick: those of the others, then the loop's."""
        self._others = others

    def ticks(self, period: float, duration: float) -> Iterator[float]:
        """As the simulated clock's; between two ticks the others have theirs."""
        start = time.perf_counter()
        for tick in super().ticks(period, duration):
            loop = time.perf_counter() - start
            self._others[0](1)  # the loop's NumPy has had the caches
            self.turns.append([*(seconds(partial(other, 1)) for other in self._others), loop])
            start = self._mark = time.perf_counter()
            yield tick


def run() -> None:
    """Print one table."""
    rows: list[list[str]] = []
    for name, law in LAWS.items():
        platform = load_platform(name)
        row = [name, law, f"{platform.step * 1e3:g}"]
        for runs, ticks in TICKS.items():
            steps = platform.steps_per_tick * runs
            turns = np.array(_fly(platform, law, runs, ticks)[ticks // 10 :])
            row += [f"{steps / tick / 1e3:.1f}" for tick in np.percentile(turns, 25.0, axis=0)]
        rows.append(row)
    print("Thousand steps a second:\n")
    head = ("machine", "law", "step [ms]", *(f"{kind}, n = {n}" for n in TICKS for kind in KINDS))
    table(head, rows)


def _fly(platform: Platform, law: str, runs: int, ticks: int) -> list[list[float]]:
    """Seconds of each tick: bare, bare with contacts, in the loop."""
    clock = TurnsClock([bare_batch(platform, runs, 0, contacts=on) for on in (False, True)])
    with SimulatedPlant(platform, runs=range(runs)) as plant:
        estimator, controller = load_estimator("passthrough"), load_controller(law)
        fly(plant, estimator, controller, Hold(), clock, duration=ticks * platform.tick)
    return clock.turns
