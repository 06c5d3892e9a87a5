"""Least squares over rows that are linear in the base, with intervals from blocks of time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from twin.errors import UsageError
from twin.identification.linear.equations import Equations
from twin.predict.base import BaseParameters

Array = NDArray[np.float64]

BLOCK = 10.0
"""[s]."""
HELD = 1e-6
"""Weight with which what does not show is held where it was stated."""
UNSURE = 10.0
"""1 sigma of what does not show, in parts of its scale."""


@dataclass(frozen=True)
class Estimate:
    """The base, as a method has it."""

    theta: Array
    """(p,) base parameters."""
    covariance: Array
    """(p, p)."""
    quantile: float
    """Half a 95 % interval is this many standard deviations."""

    @property
    def half_widths(self) -> Array:
        """(p,) half the 95 % intervals."""
        return self.quantile * np.sqrt(np.diag(self.covariance))


def least_squares(
    logs: Sequence[Equations], base: BaseParameters, constants: int = 0, block: float = BLOCK
) -> Estimate:
    """Fit logs together.

    The covariance is that of the blocks' own gradients (sandwich estimate): it knows that what is
    left is not white, not that noise in the rows biases the answer.

    Args:
        logs: the equations of each.
        base: the parameters sought.
        constants: of each log, that were fitted and taken out beforehand.
        block: what is left is taken for independent between blocks of this length [s].

    Raises:
        UsageError: nothing that could be sought shows in the logs, be they too short or still.
    """
    if not len(base.as_stated):
        return Estimate(base.as_stated, np.zeros((0, 0)), 1.96)
    parts = [based(log, base) for log in logs]
    columns = np.concatenate([rows for rows, _ in parts])
    target = np.concatenate([value for _, value in parts])
    places = _blocks(logs, block)
    if not np.any(columns):
        raise UsageError(
            f"the logs are too short to tell anything of the motion of {base.machine.platform.name}"
            ", or nothing moves in them; record some ten seconds of motion"
        )
    weak = np.diag(HELD * np.linalg.norm(columns * base.scale, axis=0).max() / base.scale)
    stacked = np.concatenate([columns, weak])
    right = np.concatenate([target - columns @ base.as_stated, np.zeros(len(weak))])
    change = np.linalg.lstsq(stacked * base.scale, right, rcond=None)[0] * base.scale
    left = right[: len(target)] - columns @ change
    scaled = stacked * base.scale
    inverse = np.linalg.inv(scaled.T @ scaled) * np.outer(base.scale, base.scale)
    scores = np.zeros((int(places[-1]) + 1, len(change)))
    np.add.at(scores, places, columns * left[:, None])
    freedom = max(len(scores) - len(change) - constants * len(logs), 1)
    # what only the weak rows hold is as unsure as they are
    unsure = np.diag(np.square(np.square(np.diag(weak)) * UNSURE * base.scale))
    covariance = inverse @ (scores.T @ scores * len(scores) / freedom + unsure) @ inverse
    return Estimate(base.as_stated + change, covariance, float(student.ppf(0.975, freedom)))


def based(equations: Equations, base: BaseParameters) -> tuple[Array, Array]:
    """Rows (m k, p) for theta, and the target (m k,): entries = stated + map (theta - stated)."""
    rest = base.entries(base.as_stated) - base.map @ base.as_stated
    target = equations.target - equations.rows @ rest
    return (equations.rows @ base.map).reshape(-1, base.map.shape[1]), target.ravel()


def _blocks(logs: Sequence[Equations], block: float) -> NDArray[np.intp]:
    """(rows,) to which block of which log each belongs."""
    blocks, first = list[NDArray[np.intp]](), 0
    for log in logs:
        own = ((log.time - log.time[0]) / block).astype(np.intp) + first
        blocks.append(np.repeat(own, log.target.shape[1]))
        first = int(own[-1]) + 1
    return np.concatenate(blocks)
