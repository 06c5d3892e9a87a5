"""What a prediction of logs depends on, and how it moves.

Shared by all logs: the base, and the strengths of what was added to the model. A log's own: its
sensors' constant errors, held by the spread that platform.toml states of them, where a stated
spring rests that pulls the machine back to where it began, and its states, of which nothing is
known beforehand.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.predict.path.states import States

Array = NDArray[np.float64]


class Eliminated(Protocol):
    """A log whose states are gone."""

    @property
    def rows(self) -> Array:
        """(m, 1 + u) residual and columns."""
        ...

    @property
    def segment(self) -> NDArray[np.intp]:
        """(m,) the segment that each row comes from."""
        ...

    def states(self, change: Array) -> Array:
        """(S, x) best starts for a change (u,) of the shared unknowns, then what else wanders."""
        ...


@dataclass(frozen=True)
class Unknowns:
    """Where a prediction stands."""

    theta: Array
    """(p,) base parameters."""
    biases: tuple[Array, ...]
    """(b,) of each log: of its sensors, then turns of springs that rest where it began."""
    starts: tuple[States, ...]
    """(segments, .) of each log."""
    strengths: Array
    """(a,) of the perturbations."""

    def moved(self, change: Array, links: Sequence[Eliminated]) -> "Unknowns":
        """After a change of theta, biases and strengths, the states at their best for it."""
        p, a = len(self.theta), len(self.strengths)
        edges = p + np.cumsum([0, *map(len, self.biases)])
        own = [change[i:j] for i, j in zip(edges, edges[1:], strict=False)]
        added = change[edges[-1] : edges[-1] + a]
        return Unknowns(
            self.theta + change[:p],
            tuple(b + d for b, d in zip(self.biases, own, strict=True)),
            tuple(
                start.moved(link.states(np.concatenate([change[:p], d, added]))[:, : start.width])
                for start, link, d in zip(self.starts, links, own, strict=True)
            ),
            self.strengths + added,
        )
