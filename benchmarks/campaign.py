"""A shard of a campaign against bare `Batch.step`, and what dispersions cost.

One process, one thread: a campaign has as many of them as there are cores. A shard is flown for a
short and a long time; their difference is what a tick costs, what is left over is what a run costs
before its first tick: its draw, its model where an effect changes it, its row.
"""

import tempfile
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from benchmarks.batch import bare_batch
from benchmarks.measure import median, seconds, spread, table
from twin.campaign.draw import draw
from twin.campaign.flight import flown
from twin.campaign.read import read_spec
from twin.campaign.spec import Spec

RUNS = 256
SHORT, LONG = 1.0, 5.0
"""[s]."""
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


SADS = ("sads", "quaternion_pd")
CUBESAT = ("cubesat", "mass_magnetic_pid")
SADS_OFFSET = OFFSET.format(-1e-3, -2.85e-2, 1e-3)
CUBESAT_OFFSET = OFFSET.format(-2e-5, -1.2e-4, 2e-5)

CASES = (
    Case("law, sensors passed through", *SADS, "passthrough"),
    Case("with the attitude filter", *SADS, "filter"),
    Case("CM and gains dispersed", *SADS, "filter",
         "[gains]\nderivative = { uniform = [6.0, 10.0] }\n" + SADS_OFFSET),
    Case("a sensor's effect, too", *SADS, "filter", SADS_OFFSET + "[effects.gyro_bias]\n"),
    Case("an effect on the model, too", *SADS, "filter",
         SADS_OFFSET + "[effects.bearing_viscous_friction]\n"),
    Case("a torque law, too", *SADS, "filter", SADS_OFFSET + "[effects.structural_sag]\n"),
    Case("masses and coils", *CUBESAT, "passthrough", CUBESAT_OFFSET),
)  # fmt: skip


def run() -> None:
    """Print the table."""
    rows = [_row(case) for case in CASES]
    print(f"n = {RUNS}, one thread; us a run and tick (5 steps of 10 ms), ms a run before them.\n")
    table(("campaign", "machine", "bare", "flown", "bare / flown", "before, ms"), rows)


def _row(case: Case) -> list[str]:
    spec = _spec(case)
    platform = spec.arms[0].platform
    bare = bare_batch(platform, RUNS, 1)
    drawn = draw(spec, range(RUNS))
    ticks = round((LONG - SHORT) / platform.tick)
    per = 1e6 / (ticks * RUNS)
    sides: list[tuple[float, float, float]] = []
    for turn in range(ROUNDS + 1):
        short, long = (
            seconds(partial(flown, replace(spec, duration=d, steady=d), drawn))
            for d in (SHORT, LONG)
        )
        stepped = seconds(partial(bare, ticks))
        if turn:
            before = short - (long - short) * SHORT / (LONG - SHORT)
            sides.append((stepped * per, (long - short) * per, before / RUNS * 1e3))
    stepped, loop, before = (median(side) for side in zip(*sides, strict=True))
    ratio = spread([bare_side / loop_side for bare_side, loop_side, _ in sides], ".2f")
    return [case.name, case.platform, f"{stepped:.1f}", f"{loop:.1f}", ratio, f"{before:.2f}"]


def _spec(case: Case) -> Spec:
    text = SPEC.format(
        platform=case.platform,
        controller=case.controller,
        estimator=case.estimator,
        runs=RUNS,
        long=LONG,
        rest="{rest}",
    ).replace("{rest}", case.rest)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "spec.toml"
        path.write_text(text, encoding="utf-8")
        return read_spec(path)
