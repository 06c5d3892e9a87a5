"""A prediction and what it depends on, as arrays over segments."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Linearised:
    """A prediction and what it depends on: S segments of N rows, x the state at each start.

    residual + state x + shared u is white noise of variance 1 in a row that holds a sample; the
    other rows are zero. The start of a segment is that of the one before it carried on:

        x_{s+1} = jump + transition x_s + jump_shared u + noise of covariance `spread`

    Columns stand one after the other in memory: they are the largest arrays of a diagnosis, and
    are formed, joined and factored column by column.
    """

    residual: Array
    """(S, N)."""
    state: Array
    """(S, N, x)."""
    shared: Array
    """(S, N, u)."""
    jump: Array
    """(S - 1, x)."""
    transition: Array
    """(S - 1, x, x)."""
    jump_shared: Array
    """(S - 1, x, u)."""
    spread: Array
    """(S - 1, x, x)."""
    known: Array
    """(x,) one over the standard deviation about 0 of the first segment's start; 0 of what nothing
    is known of beforehand."""

    def with_columns(self, columns: Array, jumps: Array | None = None) -> "Linearised":
        """With further shared unknowns.

        Args:
            columns: (S, N, c) d residual / d unknown.
            jumps: (S - 1, x, c) d end of a segment / d unknown; None: no motion depends on them.
        """
        if jumps is None:
            jumps = np.zeros((*self.jump_shared.shape[:2], columns.shape[-1]))
        return replace(
            self,
            shared=joined(self.shared, columns),
            jump_shared=joined(self.jump_shared, jumps),
        )

    def with_first(self, columns: Array, jumps: Array) -> "Linearised":
        """With other columns (S, N, c) and (S - 1, x, c) for the first of its shared unknowns."""
        count = columns.shape[-1]
        return replace(
            self,
            shared=joined(columns, self.shared[..., count:]),
            jump_shared=joined(jumps, self.jump_shared[..., count:]),
        )


def joined(*columns: Array) -> Array:
    """Columns (S, N, .) side by side, one after the other in memory."""
    return np.moveaxis(np.concatenate([np.moveaxis(one, -1, 0) for one in columns]), 0, -1)


def among(columns: Array, places: NDArray[np.bool_]) -> Array:
    """Columns (S, N, .) at these places (c,) of as many, which are zero elsewhere."""
    every = np.zeros((len(places), *columns.shape[:2]))
    every[places] = np.moveaxis(columns, -1, 0)
    return np.moveaxis(every, 0, -1)
