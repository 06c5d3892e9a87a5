"""One line of a check: what was compared, with which result, and what to do when it is wrong."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

Value = float | str | list[float] | None

RELATIVE = 1e-9
"""Two numbers that mean the same agree within this: text holds 16 digits, compilers round."""
SMALLEST = 1e-3
"""Below this value the tolerance is absolute (RELATIVE * SMALLEST)."""


@dataclass(frozen=True)
class Finding:
    """Comparison of a value in platform.toml with the compiled MJCF."""

    check: str
    ok: bool
    stated: Value
    """None for a line without a comparison."""
    found: Value
    unit: str = ""
    sentence: str = ""
    """What is wrong and what would do; empty when ok."""


def compare(check: str, stated: ArrayLike, like: ArrayLike, unit: str, otherwise: str) -> Finding:
    """Numbers that must agree; `otherwise` is said when they do not."""
    want, have = np.asarray(stated, dtype=np.float64), np.asarray(like, dtype=np.float64)
    scale = max(float(np.max(np.abs(want), initial=0.0)), SMALLEST)
    difference = float(np.max(np.abs(want - have), initial=0.0))
    return judge(
        check, difference <= RELATIVE * scale, want.tolist(), have.tolist(), unit, otherwise
    )


def judge(check: str, ok: bool, stated: Value, result: Value, unit: str, otherwise: str) -> Finding:
    """A finding whose sentence is kept only when it is needed."""
    return Finding(check, ok, stated, result, unit, "" if ok else otherwise)


def choose(names: Sequence[str]) -> str:
    """The names in quotes, or a word for none."""
    return ", ".join(map(repr, names)) or "none"
