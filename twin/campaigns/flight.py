"""Runs of one arm, flown as one batch; what came of each of them."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.campaigns.draw import Drawn, effects_of_runs, start_of_runs
from twin.campaigns.laws import batches, law_of
from twin.campaigns.merit import Merits, selected
from twin.campaigns.spec import Arm, Spec
from twin.clock import SimulatedClock
from twin.controller import AnyController
from twin.errors import ControllerError, FileError, TwinError
from twin.estimators import load_estimator
from twin.loop import Ended, Observer, fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.procedures import Notes, Phase, balancing
from twin.reference import Hold, Reference, parse_reference
from twin.stop import Stopped

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Came:
    """What came of one run."""

    ended: str
    """`done`, `stopped` (by its procedure) or `failed`."""
    reason: str
    """A sentence; empty when all went to its end."""
    duration: float
    """Flown [s]."""
    metrics: dict[str, float]
    """NaN where there is none."""


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
        own = drawn.at(rows)
        gains = _gains(spec, own)
        for batch in batches(arm, gains, len(rows)):
            came |= _flown_together(spec, arm, own.at(batch), observers, threads)
    return came


def _flown_together(
    spec: Spec, arm: Arm, drawn: Drawn, observers: Sequence[Observer], threads: int
) -> dict[int, Came]:
    """One batch; runs whose machine cannot be are left out of it and told."""
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
        seen: list[Observer] = [*observers]
        if spec.procedure == "balance":
            procedure = balancing(arm.known, n, way=arm.controller, target=arm.target, workers=0)
            stack.enter_context(procedure.lab.fits)
            notes = procedure.lab.notes
            seen.append(procedure.lab.logbook)
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
                observers=[*seen, merits],
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
    told = notes.runs[row]
    if told.phase is Phase.done:
        return "done", "", told.since
    if told.phase is Phase.stopped:
        return "stopped", told.reason, told.since
    late = f"not balanced within {spec.duration:g} s; it was in phase {told.phase.name}"
    return "stopped", late, spec.duration
