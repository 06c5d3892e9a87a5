"""One bounded move of one stage, read back; on a floating table, whether it turned as predicted."""

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench
from twin.errors import SafetyError, UsageError
from twin.service.sense import ObservedShare, sense
from twin.service.session import MOVE, Session
from twin.service.stages import carried, in_mm, move, stage_named

Array = NDArray[np.float64]

_BEFORE, _AFTER, _LONGEST = 1.0, 1.0, 15.0
"""A floating table is watched so long before a move, and after it until what it does can be told,
within the longest [s]."""

_FIRST = 1e-3
"""A captured stage goes so far at first, and on only if it went the right way [m]."""


def jog(bench: Bench, name: str, distance: float) -> list[str]:
    """Move one stage by `distance` [m] and tell what came of it.

    Args:
        bench: entered; opened as floating or as captured.
        name: of the stage.
        distance: along its axis, plus or minus [m].

    Raises:
        UnknownName: no such stage.
        UsageError: no way at all, or nothing that moves it.
        SafetyError: more than is allowed, or it did not do what it was told.
        DeviceError: a device refuses.
    """
    stage = stage_named(bench.platform, name)
    if distance == 0.0 or not np.isfinite(distance):
        raise UsageError(f"jog {name} by {in_mm(distance)}; give a distance that is not zero")
    carried(bench, MOVE, f"jog {name}")
    session = Session(bench)
    floating = bench.guard.floating
    start = session.places
    goal = start.copy()
    goal[stage] += distance
    _allow(bench, stage, start[stage], distance, floating=floating)
    if floating:
        session.watch({MOVE: start[None]}, _BEFORE)
    else:
        first = start.copy()
        first[stage] += np.clip(distance, -_FIRST, _FIRST)
        move(session, first)
    move(session, goal)
    result = _watched(session, stage, goal[None]) if floating else None
    end = session.places[stage]
    told = (
        f"{name} was sent from {in_mm(start[stage])} to {in_mm(goal[stage])} and reads {in_mm(end)}"
    )
    if not floating:
        return [told, "captured: whether it turns the table the right way was not to be seen"]
    if result is not None and result.sign_known and result.share < 0.0:
        raise SafetyError(
            f"{told}, but the table turned the wrong way: {result.words()} of what the model "
            "predicts",
            "correct the sign of the stage's scale, or of the sensors, in [hardware], before "
            "anything flies",
        )
    return [told, _sign_sentence(result)]


def _watched(session: Session, stage: int, goal: Array) -> ObservedShare | None:
    """What the table shows of the move, as soon as it is sure."""
    share: ObservedShare | None = None
    for _ in range(round(_LONGEST / _AFTER)):
        session.watch({MOVE: goal}, _AFTER)
        share = sense(session.platform, session.readings, stage)
        if share is None or share.sign_known:
            break
    return share


def _allow(bench: Bench, stage: int, start: float, distance: float, *, floating: bool) -> None:
    """A jog that the rules would cut short is refused before it begins."""
    part, settings = bench.platform.stages[stage], bench.guard.settings
    goal, margin = start + distance, settings.stroke_margin
    if not part.travel[0] + margin <= goal <= part.travel[1] - margin:
        raise SafetyError(
            f"jog refused: {part.name} would go from {in_mm(start)} to {in_mm(goal)}; its travel "
            f"is {in_mm(part.travel[0] + margin)} to {in_mm(part.travel[1] - margin)}",
            "give a shorter way",
        )
    weight = bench.platform.gravity * part.mass
    most = settings.max_balance_step / weight
    if floating and abs(distance) > most:
        raise SafetyError(
            f"jog refused: while it floats a move changes m g r by at most "
            f"{1e3 * settings.max_balance_step:.3g} mN m (max_balance_step), and {part.name} by "
            f"{in_mm(distance)} by {1e3 * weight * abs(distance):.3g} mN m",
            f"go {in_mm(most)} at most, or capture it and say --captured",
        )


def _sign_sentence(share: ObservedShare | None) -> str:
    if share is None:
        return "whether it turned the table the right way could not be seen: no gyro, or no tilt"
    if not share.sign_known:
        return (
            f"the table showed {share.words()} of the turn that the model predicts, which does not "
            "tell the sign: jog further, or a stage that lies across the vertical"
        )
    return f"the table turned the right way: {share.words()} of what the model predicts"
