"""Gains that differ from run to run: as columns of one law, where its code takes them.

A law computes with numbers, and most of them as well with columns (n, 1). Nobody declares it: a
trial holds the law with columns against each run's own, bit for bit. Runs of a law that fails it
fly in batches of their own, one for each set of gains.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.campaigns.spec import Arm
from twin.controller import AnyController, load_controller
from twin.controller.trial import Broken, estimates, fly, rows_of
from twin.errors import TwinError
from twin.platform import Platform

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
            whole = fly(_with_columns(law, gains), platform, flight)
            for row in range(_TRIALS):
                # as a lone run has it: what a law makes of its gains at first is made anew
                own = replace(loaded, **{name: float(v[row]) for name, v in gains.items()})
                alone = fly(own, platform, [rows_of(e, [row, row]) for e in flight])
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
