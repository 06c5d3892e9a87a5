"""Steps a second of every shipped machine, bare and in the closed loop, one run and 256.

Bare: `Batch.step` of the compiled model, as the plant steps it far from the stop; and near it, with
contacts. Loop: the shipped sensors passed through, a law of the machine, nothing recorded. They
take turns; what is printed is the median of five.
"""

from functools import partial

from benchmarks.batch import bare_batch
from benchmarks.measure import median, seconds, table
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
ROUNDS = 5
TICKS = {1: 400, 256: 10}
"""Of one measurement, by the number of runs."""


def run() -> None:
    """Print one table."""
    rows: list[list[str]] = []
    for name, law in LAWS.items():
        platform = load_platform(name)
        row = [name, law, f"{platform.step * 1e3:g}"]
        for runs, ticks in TICKS.items():
            steps = ticks * platform.steps_per_tick * runs
            bare = [
                partial(seconds, partial(bare_batch(platform, runs, 0, contacts=contacts), ticks))
                for contacts in (False, True)
            ]
            loop = partial(_fly, platform, law, runs, ticks)
            turns = [[work() for work in (*bare, loop)] for _ in range(ROUNDS + 1)][1:]
            row += [f"{steps / median(side) / 1e3:.1f}" for side in zip(*turns, strict=True)]
        rows.append(row)
    print("Thousand steps a second:\n")
    head = ("machine", "law", "step [ms]", *(f"{one}, n = {n}" for n in TICKS for one in KINDS))
    table(head, rows)


def _fly(platform: Platform, law: str, runs: int, ticks: int) -> float:
    """Wall time of a flight without what is made before it starts [s]."""
    with SimulatedPlant(platform, runs=range(runs)) as plant:
        estimator, controller = load_estimator("passthrough"), load_controller(law)
        clock = SimulatedClock()
        return seconds(
            lambda: fly(plant, estimator, controller, Hold(), clock, duration=ticks * platform.tick)
        )
