"""`python -m benchmarks.balance`: machines with random offsets, balanced, and judged by the truth.

Writes docs/balance.md from docs/balance.jsonl, a run a line. Offsets and noise are drawn from a
seed that the page prints. What is there is not done again: it grows with each run.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twin.clock import SimulatedClock
from twin.estimators import load_estimator, usual_estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.procedures import balancing, random_offsets, usual_target
from twin.reference import Hold
from twin.units import printed, three_digits

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "balance.md"
ROWS = PAGE.with_suffix(".jsonl")
SEED = 20261122
CAP = 7200.0
"""In which a run must be balanced [s]."""
WAY = "direct"
TOGETHER = 5
"""Runs in one batch: what is lost when the work is broken off."""
RUNS = {"cubesat": 100, "tas2": 20, "astros": 20, "sads": 20, "whorl2": 20}


@dataclass(frozen=True)
class Balanced:
    """How one run came out."""

    machine: str
    run: int
    seconds: float
    """Of the machine's time."""
    reason: str
    """Why it was not balanced; empty where it was."""
    torque: float
    """g |m r|, true, at the end [N m]."""
    stated: tuple[float, float, float] | None
    """Value, low, high of it [N m]; None without a statement."""
    covered: tuple[bool, ...] | None
    """Whether x, y, z of the true m r are in their intervals."""


def balanced(name: str, runs: Sequence[int], workers: int) -> list[Balanced]:
    """Some runs of a machine as one batch."""
    platform = load_platform(name)
    offsets = random_offsets(platform, SEED, max(runs) + 1)[list(runs)]
    initial = InitialState(center_of_mass_offset=offsets)
    target = usual_target(platform)
    procedure = balancing(platform, len(runs), way=WAY, target=target, workers=workers)
    with (
        procedure.lab.fits,
        SimulatedPlant(platform, runs=runs, seed=SEED, initial=initial) as plant,
    ):
        fly(
            plant,
            load_estimator(usual_estimator(platform)),
            procedure,
            Hold(),
            SimulatedClock(),
            duration=CAP,
            observers=[procedure.lab.logbook],
        )
        truth = plant.truth()["truth_center_of_mass_offset"].value[:, 0]
    balanceds: list[Balanced] = []
    for row, notes in enumerate(procedure.lab.notes.runs):
        statement, over = notes.statement, notes.phase.name == "done"
        torque = None if statement is None else statement.residual_torque
        balanceds.append(
            Balanced(
                machine=name,
                run=runs[row],
                seconds=notes.since,
                reason="" if over else notes.reason or f"time ran out in {notes.phase.name}",
                torque=platform.gravity * float(np.linalg.norm(truth[row])),
                stated=None if torque is None else (torque.value, torque.low, torque.high),
                covered=None
                if statement is None
                else tuple(
                    axis.holds(float(value))
                    for axis, value in zip(statement.center_of_mass_offset, truth[row], strict=True)
                ),
            )
        )
    return balanceds


def kept(name: str) -> list[dict[str, Any]]:
    """The runs of a machine that were done."""
    lines = ROWS.read_text(encoding="utf-8").splitlines() if ROWS.is_file() else []
    rows = [row for row in map(json.loads, lines) if row["machine"] == name]
    return sorted(rows, key=lambda row: row["run"])


def grow(name: str, count: int, workers: int) -> None:
    """Do the runs of a machine that are missing."""
    there = {row["run"] for row in kept(name)}
    missing = [run for run in range(count) if run not in there]
    for first in range(0, len(missing), TOGETHER):
        runs = missing[first : first + TOGETHER]
        done = balanced(name, runs, workers)
        with ROWS.open("a", encoding="utf-8") as rows:
            rows.writelines(json.dumps(vars(item)) + "\n" for item in done)
        print(f"{name}: {count - len(missing) + first + len(runs)} of {count}", flush=True)


def line(name: str, rows: Sequence[dict[str, Any]]) -> str:
    """A machine's row of the table."""
    platform = load_platform(name)
    target = usual_target(platform)
    good = [row for row in rows if not row["reason"]]
    below = sum(row["torque"] <= target for row in good)
    left = np.array([row["torque"] for row in good]) if good else np.array([np.nan])
    stated = [row for row in rows if row["stated"] is not None]
    inside = sum(row["stated"][1] <= row["torque"] <= row["stated"][2] for row in stated)
    axes = [hit for row in stated for hit in row["covered"]]
    low, middle, high = (printed(float(np.percentile(left, p)), "N m") for p in (5, 50, 95))
    minutes = float(np.median([row["seconds"] for row in good])) / 60.0 if good else np.nan
    return (
        f"| {name} | {WAY} | {printed(target, 'N m')} | {below} of {len(rows)} | "
        f"{middle} ({low} to {high}) | {three_digits(minutes)} min | "
        f"{inside} of {len(stated)}; {sum(axes)} of {len(axes)} |"
    )


def page(results: dict[str, list[dict[str, Any]]]) -> str:
    """The page, and what did not come out."""
    lines = [
        "# Balancing",
        "",
        "Machines as shipped, their CM anywhere that the masses can undo within four fifths of",
        "their travel, from above the CR to far below it; each with its own noise, gyro bias and",
        f"effects. Seed {SEED}. `python -m benchmarks.balance` writes this page; `twin balance` is",
        "the same procedure. What is true decides, not what was stated.",
        "",
        "| machine | procedure | target | balanced | left at the worst attitude: median (5 to 95 %)"
        " | takes (median) | truth in the 95 % intervals: torque; m r by axis |",
        "|---|---|---|---|---|---|---|",
        *(line(name, rows) for name, rows in results.items() if rows),
        "",
        "## What did not come out",
        "",
    ]
    failed = [
        f"- {name}, run {row['run']}, after {row['seconds']:.0f} s: {row['reason']}."
        for name, rows in results.items()
        for row in rows
        if row["reason"]
    ]
    return "\n".join([*lines, *(failed or ["Nothing."]), ""])


def main() -> None:
    """Do what is missing; write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machines", nargs="*", default=list(RUNS))
    parser.add_argument("--runs", type=int, help="of each machine; 0 only writes the page")
    parser.add_argument("--workers", type=int, default=1, help="processes that identify")
    arguments = parser.parse_args()
    for name in arguments.machines:
        grow(name, RUNS[name] if arguments.runs is None else arguments.runs, arguments.workers)
    results = {name: kept(name) for name in RUNS}
    PAGE.write_text(page(results), encoding="utf-8")
    print(page(results))


if __name__ == "__main__":
    main()
