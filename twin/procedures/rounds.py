"""What follows from an identification: a move, a better look, free float, or the end."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.procedures.fits import Found
from twin.procedures.lab import Lab
from twin.procedures.phases import Phase
from twin.procedures.plan import MARGIN, Aim
from twin.procedures.state import Progress
from twin.procedures.statement import observed_torque, state

Array = NDArray[np.float64]

TRIES = 4
"""Looks at one offset, one after the other, before giving up."""
ROUNDS = 40
"""Offsets identified before giving up."""
SHORTEST = 30.0
"""That a swing is recorded [s]."""
PERIODS = 0.6
"""Of the swing that are recorded."""
LONGEST = 120.0
"""That a swing is recorded at first [s]; each further look at the same offset takes twice as long.
"""


@dataclass(frozen=True)
class Next:
    """Of one run."""

    phase: Phase
    words: str = ""
    """Why, where it is not as it should be."""
    goal: Array | None = None
    """(stages,) where its masses go [m]."""


def conclude(
    lab: Lab,
    aim: Aim,
    now: Progress,
    run: int,
    found: Found,
    positions: Array,
    *,
    in_plane: bool,
    time: float,
) -> Next:
    """What a run does next; how it swings from now on is written into `now`.

    Args:
        lab: of the procedure.
        aim: of the procedure.
        now: of all runs.
        run: that was identified.
        found: what was.
        positions: (stages,) where its masses stand [m].
        in_plane: whether the masses move the CM in the plane, rather than a law.
        time: [s].
    """
    if found.failure:
        now.watch[run] *= 2.0
        return Next(Phase.settle, found.failure)
    kit = now.kit
    moment = found.moment + kit.reach.moment(positions[None])[0]
    now.rounds[run] += 1
    now.base[run] = found.moment
    _tell(lab, now, run, moment, found, time)
    if now.phase[run] == Phase.judge:
        platform, (_, floated) = kit.platform, lab.logs[run]
        observed = observed_torque(floated, platform, found.inertia)
        lab.notes.runs[run].statement = state(
            platform, moment, found.covariance, found.quantile, observed, positions, found.misfit
        )
    kept = aim.is_kept(moment, found.covariance, found.quantile)
    change = aim.change(moment, found.covariance, in_plane=in_plane)
    goal = positions + kit.reach.masses.positions(change[None])[0]
    beyond = kit.reach.beyond(goal)
    last = now.rounds[run] >= ROUNDS
    if kept and (beyond or last or not aim.is_worth(change)):
        return Next(Phase.done if now.phase[run] == Phase.judge else Phase.verify)
    if not aim.is_known(moment, found.covariance):
        now.watch[run] *= 2.0
        return Next(Phase.settle, "the swing does not tell the offset well enough")
    if last:
        return Next(Phase.stopped, f"the target was not reached in {ROUNDS} rounds")
    if beyond:
        return Next(Phase.stopped, f"the offset is beyond the masses' reach: {beyond}")
    hanging = max(-float(moment[2] + change[2]), MARGIN * aim.moment)
    now.stiffness[run] = kit.platform.gravity * hanging
    period = 2.0 * np.pi / float(kit.frequency(now.stiffness)[run])
    now.watch[run] = np.clip(PERIODS * period, SHORTEST, LONGEST)
    now.tries[run] = 0
    return Next(Phase.move, goal=goal)


def _tell(lab: Lab, now: Progress, run: int, moment: Array, found: Found, time: float) -> None:
    platform = now.kit.platform
    offset, half = (
        v / platform.mass * 1e6
        for v in (moment, found.quantile * np.sqrt(np.diag(found.covariance)))
    )
    torque = platform.gravity * float(np.linalg.norm(moment))
    lab.notes.runs[run].identified += 1
    lab.notes.say(
        run,
        time,
        "the CM is ("
        + ", ".join(f"{o:.4g} +- {h:.2g}" for o, h in zip(offset, half, strict=True))
        + f") um from the CR, {torque:.3g} N m at worst",
    )
