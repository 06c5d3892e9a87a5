"""Whether an explanation leaves anything: torques of no law at all, and the noise it was given.

Pieces of torque, each a few seconds long and free in size, soak up whatever smooth torque a model
lacks, by whatever law. What they gain beyond chance is unexplained.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from twin.diagnose.explanation import Explanation
from twin.diagnose.weighing import Trace, Weighing
from twin.predict.body import Body
from twin.predict.effects.forces import middles, on_grid
from twin.predict.effects.perturbation import Perturbation

Array = NDArray[np.float64]

PIECE = 2.5
"""Length of a piece [s]: torques that change as fast as a platform turns are seen."""
MOST = 60
"""Pieces of a log; longer logs have longer pieces."""
DOUBTFUL = 0.01
"""Chance of noise below which what is left is looked into."""


@dataclass(frozen=True)
class Remainder:
    """What is left when all causes are in."""

    torque_gain: float
    """Fall of -2 log L by pieces of torque."""
    freedom: float
    """Directions in which they do, as chi-square counts them."""
    torque_chance: float
    """That noise gains as much."""
    noise_chance: float
    """That noise alone leaves as much in the column that leaves most, of all columns together."""
    where: str
    """The stream and column that leave most."""
    chi2: float
    """Mean squared residual of all columns, in units of the noise."""

    @property
    def chance(self) -> float:
        """Of the rarer of both."""
        return min(1.0, 2.0 * min(self.torque_chance, self.noise_chance))

    @property
    def doubtful(self) -> bool:
        """Whether that is so rare that it is looked into."""
        return self.chance < DOUBTFUL


def remainder(found: Explanation) -> Remainder:
    """Of an explanation, where its fit stands."""
    pieces = [piece for body in found.bodies for piece in torque_pieces_of(body)]
    own = len(found.own)
    weighing = beside(found, pieces)
    gain, freedom = weighing.beyond(found.own, range(own, own + len(pieces)))
    parts = found.account.misfits
    worst = max(parts, key=lambda part: part.sigmas)
    single = float(norm.sf(worst.sigmas))
    return Remainder(
        gain,
        freedom,
        float(chi2.sf(gain, freedom)),
        float(-np.expm1(len(parts) * np.log1p(-min(single, 1.0 - 1e-16)))),
        f"{worst.stream} {worst.column}",
        float(np.average([part.chi2 for part in parts], weights=[part.samples for part in parts])),
    )


def beside(found: Explanation, pieces: Sequence[Perturbation]) -> Weighing:
    """An explanation's own parts, then pieces of any size."""
    free = np.full(1, np.inf)
    traces = [Trace(piece.name, -free, free) for piece in pieces]
    return found.weigh([(piece,) for piece in pieces], traces)


def knots_of(body: Body) -> Array:
    """Where the pieces of one log have their peaks [s]."""
    begin, end = float(body.motion.time[0]), float(body.motion.time[-1])
    return np.linspace(begin, end, int(np.clip((end - begin) / PIECE, 2, MOST)))


@lru_cache(maxsize=8)
def torque_pieces_of(body: Body) -> tuple[Perturbation, ...]:
    """Hats side by side over one log, about one axis of the base after the other."""
    knots = knots_of(body)
    dofs = range(body.machine.base_dof.start, body.machine.base_dof.stop)
    return tuple(_piece(body, knots, place, dof) for dof in dofs for place in range(len(knots)))


def _piece(own: Body, knots: Array, place: int, dof: int) -> Perturbation:
    def force(body: Body) -> Array:
        torque = np.zeros((body.grid.segments * body.grid.steps, body.machine.model.nv))
        if body.recording is own.recording:
            hat = np.zeros(len(knots))
            hat[place] = 1.0
            torque[:, dof] = np.interp(middles(body), knots, hat)
        return on_grid(torque, body)

    return Perturbation(f"piece {place} of {dof}", "N m", force=force)
