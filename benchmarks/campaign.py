"""A shard of a campaign against bare `Batch.step`, and what dispersions cost.

Every core has a process with one thread, as a campaign has them, and all work at once. A shard is
flown for a short and a long time; their difference is what a tick costs, what is left over is what
a run costs before its first tick: its draw, its model where an effect changes it, its row.
"""

import os
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from benchmarks.batch import bare_batch
from benchmarks.measure import median, seconds, spread, table
from benchmarks.procedure import balanced
from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.read import read_spec
from twin.campaigns.spec import Spec
from twin.stream.recorder import MemoryRecorder

RUNS = 256
SHORT, LONG = 1.0, 11.25
"""[s]; between them are four draws of a gyro's noise, which are 51.2 ticks apart."""
ROUNDS = 5

SPEC = """
platform = "{platform}"
controller = "{controller}"
estimator = "{estimator}"
runs = {runs}
duration = {long}
seed = 1
shard = {runs}
sampling = "sobol"
{rest}
"""

OFFSET = """
[initial]
center_of_mass_offset = {{ uniform = [[{0}, {0}, {1}], [{2}, {2}, {1}]] }}
"""


@dataclass(frozen=True)
class Case:
    """One line of the table."""

    name: str
    platform: str
    controller: str
    estimator: str
    rest: str = ""
    recorded: bool = False
    """Whether every run is kept in memory, too."""
    target: str = ""


@dataclass(frozen=True)
class Side:
    """One turn in one process."""

    bare: float
    """[us a run and tick]."""
    flown: float
    """[us a run and tick]."""
    before: float
    """A run's time before its first tick [ms]."""


SADS = ("sads", "quaternion_pd")
CUBESAT = ("cubesat", "mass_magnetic_pid")
SADS_OFFSET = OFFSET.format(-1e-3, -2.85e-2, 1e-3)
CUBESAT_OFFSET = OFFSET.format(-2e-5, -1.2e-4, 2e-5)

CASES = (
    Case("law, sensors passed through", *SADS, "passthrough", target=">= 0.90"),
    Case("with the attitude filter", *SADS, "filter"),
    Case("and every run recorded", *SADS, "filter", recorded=True, target=">= 0.85"),
    Case("CM and gains dispersed", *SADS, "filter",
         "[gains]\nderivative = { uniform = [6.0, 10.0] }\n" + SADS_OFFSET),
    Case("a sensor's effect, too", *SADS, "filter", SADS_OFFSET + "[effects.gyro_bias]\n"),
    Case("an effect on the model, too", *SADS, "filter",
         SADS_OFFSET + "[effects.bearing_viscous_friction]\n"),
    Case("a torque law, too", *SADS, "filter", SADS_OFFSET + "[effects.structural_sag]\n"),
    Case("masses and coils", *CUBESAT, "passthrough", CUBESAT_OFFSET),
)  # fmt: skip


def run() -> None:
    """Print both tables."""
    cores = len(os.sched_getaffinity(0))
    print(
        f"{cores} processes at once, each {RUNS} runs and one thread; us a run and tick (5 steps\n"
        "of 10 ms), ms a run before them. Metrics are taken in all. Ratio: median of\n"
        f"{ROUNDS} turns of each process (lowest to highest).\n"
    )
    rows: list[list[str]] = []
    with ProcessPoolExecutor(cores, mp_context=get_context("spawn")) as processes:
        for case in CASES:
            asked = [processes.submit(sides, case) for _ in range(cores)]
            rows.append(_row(case, [side for turns in asked for side in turns.result()]))
    table(("campaign", "machine", "bare", "flown", "bare / flown", "target", "before, ms"), rows)
    print()
    balanced()


def sides(case: Case, runs: int = RUNS) -> list[Side]:
    """Turns of a case in this process."""
    spec = spec_of(case, runs, LONG)
    platform = spec.arms[0].platform
    bare = bare_batch(platform, runs, 1)
    drawn = draw(spec, range(runs))
    ticks = round((LONG - SHORT) / platform.tick)
    per = 1e6 / (ticks * runs)
    turns: list[Side] = []
    for turn in range(ROUNDS + 1):
        took: list[float] = []
        for duration in (SHORT, LONG):
            probe = replace(spec, duration=duration, steady=duration)
            watched = [MemoryRecorder(platform)] if case.recorded else []
            took.append(seconds(partial(flown, probe, drawn, observers=watched)))
        short, long = took
        stepped = seconds(partial(bare, ticks))
        if turn:  # the first one imports and compiles
            before = short - (long - short) * SHORT / (LONG - SHORT)
            turns.append(Side(stepped * per, (long - short) * per, before / runs * 1e3))
    return turns


def _row(case: Case, turns: Sequence[Side]) -> list[str]:
    return [
        case.name,
        case.platform,
        f"{median([turn.bare for turn in turns]):.1f}",
        f"{median([turn.flown for turn in turns]):.1f}",
        spread([turn.bare / turn.flown for turn in turns], ".2f"),
        case.target,
        f"{median([turn.before for turn in turns]):.2f}",
    ]


def spec_of(case: Case, runs: int, duration: float) -> Spec:
    """The campaign of a case, its runs of one duration [s] in one shard."""
    text = SPEC.format(
        platform=case.platform,
        controller=case.controller,
        estimator=case.estimator,
        runs=runs,
        long=duration,
        rest="{rest}",
    ).replace("{rest}", case.rest)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "spec.toml"
        path.write_text(text, encoding="utf-8")
        return read_spec(path)
