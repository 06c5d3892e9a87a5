"""Where the numbers of a log stand among the rows of its prediction.

A segment has a row for each number that was sampled in it, in the order of the grid's instants, and
all segments have as many as the fullest: those that are left over stay zero. A machine with gimbals
is predicted in far more instants than it is sampled at.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.predict.sensors.outputs import Grid, Output

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class Cells:
    """S segments of N rows."""

    row: NDArray[np.int32]
    """(S, K, W) which of them each slot of each instant is; N where no sample stands."""
    count: int
    """N."""
    places: tuple[tuple[Index, NDArray[np.int32]], ...]
    """Of each output: segment (m, 1) and row (m, k) of its numbers."""

    @staticmethod
    def of(outputs: Sequence[Output], grid: Grid, width: int) -> "Cells":
        """Order the numbers.

        Args:
            outputs: whose slots are among `width` an instant.
            grid: of the prediction.
            width: W.
        """
        held = np.zeros((grid.segments, grid.steps + 1, width), dtype=np.bool_)
        for output in outputs:
            held[output.segment[:, None], output.instant[:, None], output.slot] = True
        rank = np.cumsum(held.reshape(grid.segments, -1), axis=1, dtype=np.int32)
        count = int(rank[:, -1].max(initial=0))
        row = np.where(held, rank.reshape(held.shape) - 1, count).astype(np.int32)
        places = tuple(
            (o.segment[:, None], row[o.segment[:, None], o.instant[:, None], o.slot])
            for o in outputs
        )
        return Cells(row, count, places)

    def scatter(self, parts: Sequence[Array]) -> Array:
        """Numbers of each output (v, m, k) to their rows (v, S, N)."""
        rows = np.zeros((len(parts[0]), len(self.row), self.count))
        for (segment, row), part in zip(self.places, parts, strict=True):
            rows[:, segment, row] = part
        return rows

    def gather(self, rows: Array) -> list[Array]:
        """Numbers in rows (S, N) back to their outputs, each (m, k)."""
        return [rows[place] for place in self.places]
