"""Other ways to name a cause, on the same logs."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from twin.diagnosis import Diagnosis
from twin.diagnosis.residual_test import held_out
from twin.diagnosis.screen import TIED, price
from twin.effects import Effect
from twin.errors import TwinError


def named_by_others(found: Diagnosis, truth: str, alike: Sequence[str]) -> dict[str, Any]:
    """By label: an oracle's answer, and two simple methods'.

    - oracle: it knows that the cause is the truth or what nobody could tell from it, and takes all
      of those within a tie of the best;
    - correlation: the one column that the residual of the fitted base is most along;
    - all free: every amplitude of the catalogue fitted at once, which is what a solver with all
      parameters free does where the problem is linear; the one that is most standard deviations
      from 0.
    """
    asked = found.asked
    screen = found.baseline.screen(asked)
    shown = [index for index in range(len(asked)) if screen.identifiable(index)]
    evidence: dict[str, float] = {}
    for index in shown:
        gain = max(screen.weigh((index,)).gain, 0.0)
        worth = gain - price(gain, screen.information(index))
        label = screen.traces[index].label
        evidence[label] = max(worth, evidence.get(label, -np.inf))
    known = {label: evidence[label] for label in (truth, *alike) if label in evidence}
    best = max(known.values(), default=0.0)
    residual = screen.left(())
    columns, owners = [], []
    for index in shown:
        for unit in np.eye(len(asked[index].perturbations)):
            column = screen.signature(index, unit)
            size = float(np.linalg.norm(column))
            if size > 0.0:
                columns.append(column / size)
                owners.append(asked[index].label)
    matrix = np.column_stack(columns)
    along = np.abs(matrix.T @ residual)
    inverse = np.linalg.pinv(matrix, rcond=1e-10)
    z = np.abs(inverse @ residual) / np.linalg.norm(inverse, axis=1)
    return {
        "oracle": [label for label, worth in known.items() if best - worth < TIED],
        "correlation": owners[int(np.argmax(along))],
        "all free": owners[int(np.argmax(z))],
    }


def oracle_gain(found: Diagnosis, effects: Sequence[Effect]) -> float | None:
    """Held-out gain of the hidden effects themselves, fitted; None where that fails."""
    try:
        return held_out(found.baseline.instead(effects)).log_likelihood
    except TwinError:
        return None
