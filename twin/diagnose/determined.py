"""Which components of effects the logs show at all, beside base and the other components."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.weighing import KNOWN, SLIGHT
from twin.effects import Effect
from twin.predict.body import Body
from twin.predict.effects.columns import amplitudes, strengths_of
from twin.predict.effects.perturbation import Perturbation
from twin.predict.parameters.base import BaseParameters
from twin.predict.whitening.innovations import Problem
from twin.predict.whitening.unknowns import Unknowns

BLURRED = 1e-2
"""A component of which less than this share is left beside base and the others stays as it is."""


def determined(
    bodies: Sequence[Body],
    base: BaseParameters,
    effects: tuple[Effect, ...],
    every: Sequence[Sequence[Perturbation]],
    start: Unknowns,
) -> tuple[NDArray[np.bool_], ...]:
    """Which components logs show beside base and the components before them, amplitudes first.

    Of amplitudes those come first that do most: where a thruster is turned already, a turn about
    its own axis does a little, and all of it the others do too.

    Args:
        bodies: the logs.
        base: what is fitted of the machine.
        effects: at the values where their columns are formed.
        every: their perturbations, one a component.
        start: where the base, the biases and the states stand; its strengths are not used.

    Returns:
        (p,) of each effect.
    """
    free = [np.ones(len(parts), dtype=bool) for parts in every]
    doubtful = [i for i, parts in enumerate(every) if len(parts) > 1]
    if not doubtful:
        return tuple(free)
    problem = Problem(bodies, base, [part for parts in every for part in parts])
    strengths = np.concatenate([np.zeros(0), *(strengths_of(effect) for effect in effects)])
    now = problem.innovations(replace(start, strengths=strengths))
    whole = np.linalg.norm(now.columns, axis=0)
    columns = now.columns / np.maximum(whole, 1e-300)
    kept = columns.shape[1] - len(strengths)
    reach = [high - low for low, high in (effect.bounds() for effect in effects)]
    felt = whole[kept:] > SLIGHT / np.concatenate([np.zeros(0), *reach])
    basis = np.linalg.qr(columns[:, :kept])[0]
    first = kept
    for i, effect in enumerate(effects):
        least = KNOWN if effect.exact else BLURRED
        amplitude, does = amplitudes(effect), whole[first : first + len(every[i])]
        order = np.lexsort((np.where(amplitude, -does, 0.0), ~amplitude))
        for j in order.tolist():
            column = columns[:, first + j]
            for _ in range(2):
                column = column - basis @ (basis.T @ column)
            size = float(np.linalg.norm(column))
            if size < least or not felt[first - kept + j]:
                free[i][j] = False
            else:
                basis = np.column_stack([basis, column / size])
        first += len(every[i])
    return tuple(free)
