"""Runs of one arm, flown as one batch, and their outcomes.

Gains that differ from run to run: as columns of one law, where its code takes them.
A law computes with numbers, and most of them as well with columns (n, 1). Nobody declares it: a
trial holds the law with columns against each run's own, bit for bit. Runs of a law that fails it
fly in batches of their own, one for each set of gains.
"""

import copy
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.campaigns.draw import Drawn, effects_of_runs, start_of_runs
from twin.campaigns.merit import Merits, selected
from twin.campaigns.spec import Arm, Spec
from twin.clock import SimulatedClock
from twin.controller import AnyController, load_controller
from twin.controller.check import Broken, estimates, fly_rows, rows_of
from twin.errors import ControllerError, FileError, TwinError
from twin.estimators import load_estimator
from twin.loop import Ended, Observer, fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform
from twin.procedures import Notes, Phase, balancing
from twin.reference import Hold, Reference, parse_reference
from twin.stop import Stopped

Array = NDArray[np.float64]


_TRIALS = 5
_SIZES = np.linspace(0.7, 1.4, _TRIALS)


def law_of(arm: Arm, gains: Mapping[str, Array]) -> AnyController:
    """The law of runs whose gains (n,) differ, or of runs that share them.

    Args:
        arm: with the gains that all its runs share.
        gains: (n,) of each run, by name.
    """
    alike = {name: float(v[0]) for name, v in gains.items() if (v == v[0]).all()}
    law = load_controller(arm.controller, {**arm.gains, **alike})
    return _with_columns(law, {name: v for name, v in gains.items() if name not in alike})


def batches(arm: Arm, gains: Mapping[str, Array], n: int) -> list[list[int]]:
    """Rows that can fly together: all n, or those that share their gains."""
    if not gains:
        return [list(range(n))]
    if takes_columns(arm, tuple(gains)):
        return [list(range(n))]
    sets: dict[tuple[float, ...], list[int]] = {}
    for row in range(n):
        sets.setdefault(tuple(float(v[row]) for v in gains.values()), []).append(row)
    return list(sets.values())


def takes_columns(arm: Arm, names: Sequence[str]) -> bool:
    """Whether the law flies the same bits with these gains as columns as run by run."""
    law = load_controller(arm.controller, arm.gains)
    return _passes(law, arm.platform, names)


def _passes(law: AnyController, platform: Platform, names: Sequence[str]) -> bool:
    gains = {name: (getattr(law, name) or 1.0) * _SIZES for name in names}
    flight = estimates(platform, _TRIALS)
    loaded: Any = law
    try:
        with np.errstate(all="ignore"):
            whole = fly_rows(_with_columns(law, gains), platform, flight)
            for row in range(_TRIALS):
                # as a lone run has it: what a law makes of its gains at first is made anew
                law_of_run = replace(loaded, **{name: float(v[row]) for name, v in gains.items()})
                alone = fly_rows(law_of_run, platform, [rows_of(e, [row, row]) for e in flight])
                for together, single in zip(whole, alone, strict=True):
                    for name, value in together.items():
                        if value.shape[0] != _TRIALS or not np.array_equal(
                            value[row], single[name][0]
                        ):
                            return False
    except (Broken, TwinError, ValueError):
        return False
    return True


def _with_columns(law: AnyController, gains: Mapping[str, Array]) -> AnyController:
    changed = copy.copy(law)
    for name, value in gains.items():
        object.__setattr__(changed, name, value[:, None])
    return changed


@dataclass(frozen=True)
class Came:
    """What came of one run."""

    ended: str
    """`done`, `stopped` (by its procedure) or `failed`."""
    reason: str
    """Why the run ended early, a sentence; empty if it did not."""
    duration: float
    """Flown [s]."""
    metrics: dict[str, float]
    """By name; NaN where the run has none."""


def flown(
    spec: Spec, drawn: Drawn, *, observers: Sequence[Observer] = (), threads: int = 1
) -> dict[int, Came]:
    """Fly runs of a campaign, arm by arm; what came of each, by its number.

    Args:
        spec: the campaign.
        drawn: the runs.
        observers: see every tick of every batch.
        threads: of the physics.
    """
    came: dict[int, Came] = {}
    for number, arm in enumerate(spec.arms):
        rows = np.flatnonzero(drawn.arms == number).tolist()
        if not rows:
            continue
        of_arm = drawn.at(rows)
        gains = _gains(spec, of_arm)
        for batch in batches(arm, gains, len(rows)):
            came |= _flown_together(spec, arm, of_arm.at(batch), observers, threads)
    return came


def _flown_together(
    spec: Spec, arm: Arm, drawn: Drawn, observers: Sequence[Observer], threads: int
) -> dict[int, Came]:
    """One batch, without the runs whose machine is impossible; these are reported as failed."""
    try:
        return _batch(spec, arm, drawn, observers, threads)
    except TwinError:
        pass  # of which runs, shows when each of their machines is made
    came: dict[int, Came] = {}
    able: list[int] = []
    for row, run in enumerate(drawn.runs):
        try:
            _plant(spec, arm, drawn.at([row]), threads)
        except TwinError as problem:
            nothing = dict.fromkeys(spec.metrics, np.nan)
            # where a file lies is the computer's business
            path = f"{problem.path}: " if isinstance(problem, FileError) else ""
            came[run] = Came("failed", str(problem).removeprefix(path), 0.0, nothing)
        else:
            able.append(row)
    if len(able) == len(drawn.runs):
        return _batch(spec, arm, drawn, observers, threads)  # it was something else: let it be told
    if able:
        came |= _batch(spec, arm, drawn.at(able), observers, threads)
    return came


def _batch(
    spec: Spec, arm: Arm, drawn: Drawn, observers: Sequence[Observer], threads: int
) -> dict[int, Came]:
    runs = drawn.runs
    if len(runs) == 1:
        drawn = drawn.at([0, 0])  # a lone row would have other last bits than in company
    n = len(drawn.runs)
    with ExitStack() as stack:
        plant = stack.enter_context(_plant(spec, arm, drawn, threads))
        notes: Notes | None = None
        watching: list[Observer] = [*observers]
        if spec.procedure == "balance":
            procedure = balancing(arm.known, n, way=arm.controller, target=arm.target, workers=0)
            stack.enter_context(procedure.lab.fits)
            notes = procedure.lab.notes
            watching.append(procedure.lab.logbook)
            law: AnyController = procedure
        else:
            law = law_of(arm, _gains(spec, drawn))
        merits = Merits(arm.platform, n, spec.duration - spec.steady, notes)
        with np.errstate(over="ignore", invalid="ignore"):  # of runs on their way out of physics
            outcome = fly(
                plant,
                load_estimator(arm.estimator),
                law,
                _reference(spec, arm, law),
                SimulatedClock(),
                duration=spec.duration,
                observers=[*watching, merits],
            )
    if outcome.asked:
        raise Stopped(outcome.asked)  # runs that were cut short are no results
    if outcome.ended is Ended.safe_stop:
        raise ControllerError(f"{arm.name}: {outcome.reason} at {outcome.duration:g} s")
    rows = selected(merits.rows(), spec.metrics, n)
    came: dict[int, Came] = {}
    for row, run in enumerate(runs):
        ended, reason, lasted = "done", "", outcome.duration
        if notes is not None:
            ended, reason, lasted = _of_notes(notes, row, spec)
        if row in outcome.stopped and ended != "stopped":
            ended, reason = "failed", outcome.stopped[row]
            lasted = plant.stopped_at[row]
        lost = ended == "failed" and row in outcome.stopped
        values = {name: np.nan if lost else float(v[row]) for name, v in rows.items()}
        came[run] = Came(ended, reason, lasted, values)
    return came


def _plant(spec: Spec, arm: Arm, drawn: Drawn, threads: int) -> SimulatedPlant:
    start: InitialState = start_of_runs(spec.initial, arm, drawn)
    return SimulatedPlant(
        arm.platform,
        runs=drawn.runs,
        seed=spec.seed,
        initial=start,
        effects=effects_of_runs(arm, drawn),
        threads=threads,
    )


def _gains(spec: Spec, drawn: Drawn) -> dict[str, Array]:
    """(n,) of each gain that the specification gives."""
    n = len(drawn.runs)
    return {
        factor.name.removeprefix("gains."): drawn.values.get(
            factor.name, np.full(n, factor.distribution.middle)
        )
        for factor in spec.gains
    }


def _reference(spec: Spec, arm: Arm, law: AnyController) -> Reference:
    if spec.procedure == "balance":
        return Hold()
    return parse_reference(arm.reference or law.reference)


def _of_notes(notes: Notes, row: int, spec: Spec) -> tuple[str, str, float]:
    note = notes.runs[row]
    if note.phase is Phase.done:
        return "done", "", note.since
    if note.phase is Phase.stopped:
        return "stopped", note.reason, note.since
    late = f"not balanced within {spec.duration:g} s; it was in phase {note.phase.name}"
    return "stopped", late, spec.duration
