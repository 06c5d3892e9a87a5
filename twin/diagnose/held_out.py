"""What causes gain on time that took no part in fitting them, block by block.

The logs' segments are cut into blocks, one after the other. For each block base, biases and causes
are fitted to the others, where the whole fit is linearised; the block's own innovations, each
predicted from the samples before it, then tell how likely it was, with the causes and without.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.explanation import Explanation
from twin.identify.prediction_error import NORMAL

Array = NDArray[np.float64]

BLOCKS = 5


@dataclass(frozen=True)
class HeldOut:
    """All blocks together; NaN where the logs are one segment, of which nothing can be held out."""

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
    before = _chi2(bare.cluster, bare.residual, bare.columns)
    after = _chi2(now.cluster, now.residual, now.columns)
    samples = sum(body.samples for body in found.bodies)
    spread = sum(
        2.0
        * output.slot.size
        * (1.0 if output.stated else float(np.mean(1.0 / output.worth - 1.0)))
        for body in found.bodies
        for output in body.outputs
        if output.scatters
    )
    half = NORMAL * float(np.sqrt(spread)) / samples
    states = sum(start.width for start in found.at.starts)
    return HeldOut(
        0.5 * (before - after),
        before / (samples - states),
        after / (samples - states),
        1.0 - half,
        1.0 + half,
    )


def _chi2(cluster: NDArray[np.intp], residual: Array, columns: Array) -> float:
    """Of all blocks, each predicted by what the others fit."""
    segments = np.unique(cluster[cluster >= 0])
    if len(segments) < 2:
        return np.nan
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    block = np.full(len(cluster), -1)
    rank = np.searchsorted(segments, cluster[cluster >= 0])
    block[cluster >= 0] = rank * BLOCKS // len(segments)
    total = 0.0
    for b in range(BLOCKS):
        out = block == b
        step = np.linalg.lstsq(columns[~out] / size, -residual[~out], rcond=1e-10)[0]
        left = residual[out] + columns[out] @ (step / size)
        total += float(left @ left)
    return total
