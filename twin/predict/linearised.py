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
            shared=np.concatenate([self.shared, columns], axis=-1),
            jump_shared=np.concatenate([self.jump_shared, jumps], axis=-1),
        )

    def with_first(self, columns: Array, jumps: Array) -> "Linearised":
        """With other columns (S, N, c) and (S - 1, x, c) for the first of its shared unknowns."""
        count = columns.shape[-1]
        return replace(
            self,
            shared=np.concatenate([columns, self.shared[..., count:]], axis=-1),
            jump_shared=np.concatenate([jumps, self.jump_shared[..., count:]], axis=-1),
        )
