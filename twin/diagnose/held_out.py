"""What causes gain on time that took no part in fitting them, block by block.

The segments of each log are cut into blocks, one after the other, and the first ones of all logs
are one block, and so on: each log has biases of its own, which nothing tells where all of it is
held out. For each block base, biases and causes are fitted to the others, where the whole fit is
linearised; the block's own innovations, each predicted from the samples before it, then tell how
likely it was, with the causes and without. What the others leave open of the fitted numbers counts
as noise of the block: else the true model of a short log would seem to miss it.
"""

from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.explanation import Explanation
from twin.diagnose.rows import Rows
from twin.identify.prediction_error import NORMAL

Array = NDArray[np.float64]

BLOCKS = 5
FLOOR = 1e-10
"""Share of the best known direction below which the other blocks tell nothing of one: it stays
where it is."""


@dataclass(frozen=True)
class HeldOut:
    """All blocks together; NaN where each log is one segment, of which nothing can be held out."""

    log_likelihood: float
    """Gained by the causes."""
    before: float
    """Chi-square of the innovations a sample, without the causes."""
    after: float
    low: float
    high: float
    """A true model stays between these 95 times in 100."""


def held_out(found: Explanation) -> HeldOut:
    """Measure it."""
    now, (bare, _) = found.rows, found.without()
    cut = [body.grid.segments > 1 for body in found.bodies]
    bodies = list(compress(found.bodies, cut))
    block = np.concatenate([_blocks(body.grid.segments) for body in found.bodies])
    (before, open_before), (after, open_after) = (_missed(block, one) for one in (bare, now))
    samples = sum(body.samples for body in bodies)
    spread = sum(
        2.0
        * output.slot.size
        * (1.0 if output.stated else float(np.mean(1.0 / output.worth - 1.0)))
        for body in bodies
        for output in body.outputs
        if output.scatters
    )
    half = NORMAL * float(np.sqrt(spread)) / samples if samples else np.nan
    states = sum(start.width for start in compress(found.at.starts, cut))
    free = max(samples - states, 1)
    return HeldOut(
        0.5 * (before + open_before - after - open_after),
        before / free,
        after / free,
        1.0 - half,
        1.0 + half,
    )


def _blocks(segments: int) -> NDArray[np.intp]:
    """(segments,) of one log; -1 of one that cannot be cut."""
    if segments < 2:
        return np.full(segments, -1)
    return np.arange(segments) * min(BLOCKS, segments) // segments


def _missed(block: NDArray[np.intp], rows: Rows) -> tuple[float, float]:
    """Chi-square and log-determinant of all blocks (segments,), each predicted by what the others
    fit.

    A block's residual has the covariance I + D D^T, D its columns times a root of the covariance
    that the others leave; both are had from I + D^T D (Woodbury), which is small.
    """
    if block.max(initial=-1) < 0:
        return np.nan, np.nan
    size = np.maximum(np.linalg.norm(rows.columns, axis=0), 1e-300)
    columns = rows.columns / size
    of_rows = np.where(rows.cluster < 0, -1, block[rows.cluster])
    chi2, logarithm = 0.0, 0.0
    for b in range(block.max() + 1):
        out = of_rows == b
        u, told, v = np.linalg.svd(columns[~out], full_matrices=False)
        shown = told > FLOOR * told[0]
        open_by = v[shown].T / told[shown]
        left = rows.residual[out] - columns[out] @ (open_by @ (u.T @ rows.residual[~out])[shown])
        doubt = columns[out] @ open_by
        spread = np.eye(doubt.shape[1]) + doubt.T @ doubt
        among = doubt.T @ left
        chi2 += float(left @ left - among @ np.linalg.solve(spread, among))
        logarithm += float(np.linalg.slogdet(spread)[1])
    return chi2, logarithm
