"""What a balancing remembers of its runs."""

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.procedures.kit import Kit
from twin.procedures.phases import OVER, Phase, among
from twin.signals import Command

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass
class Progress:
    """Arrays have a row a run."""

    phase: NDArray[np.int64]
    """(n,) of `Phase`."""
    since: Array
    """(n,) when it began [s]."""
    moving_until: Array
    """(n,) when the body was last seen to move too much for the next phase [s]."""
    swinging_until: Array
    """(n,) when it was last seen to swing [s]."""
    away_until: Array
    """(n,) when a mass was last seen away from its goal [s]."""
    rate: Array
    """(n, 3) of the body, smoothed [rad/s]."""
    goal: Array
    """(n, stages) where the masses are to be [m]."""
    smooth: Array
    """(n, stages) where the law of the level phase has them, its noise averaged out [m]."""
    rest: Array
    """(n, stages) where they go back to after a nudge [m]."""
    stiffness: Array
    """(n,) -g m r_z: of the hanging body, as far as it is known [N m/rad]."""
    amplitude: Array
    """(n,) swing that a nudge is to give [rad]."""
    watch: Array
    """(n,) how long the next swing is recorded [s]."""
    tries: NDArray[np.int64]
    """(n,) looks at the present offset."""
    rounds: NDArray[np.int64]
    """(n,) offsets identified."""
    base: Array
    """(n, 3) m r at stage position 0, as far as it is known [kg m]."""
    levelled: Mask
    """(n,) whether the law of the level phase has had its turn in this round."""
    log_start: Array
    """(n,) from when on the log is needed [s]; inf: not."""
    seen: Mask
    """(n,) whether the masses' first positions are known."""
    kit: Kit
    states: dict[str, Any]
    """Of the laws that act, by what they are for."""

    @classmethod
    def start(cls, kit: Kit, n: int, states: dict[str, Any]) -> "Progress":
        """Before the first tick."""
        stages = len(kit.platform.stages)
        return cls(
            phase=np.full(n, Phase.lower, dtype=np.int64),
            since=np.zeros(n),
            moving_until=np.zeros(n),
            swinging_until=np.zeros(n),
            away_until=np.zeros(n),
            rate=np.zeros((n, 3)),
            goal=np.zeros((n, stages)),
            smooth=np.zeros((n, stages)),
            rest=np.zeros((n, stages)),
            stiffness=np.zeros(n),
            amplitude=np.zeros(n),
            watch=np.zeros(n),
            tries=np.zeros(n, dtype=np.int64),
            rounds=np.zeros(n, dtype=np.int64),
            base=np.zeros((n, 3)),
            levelled=np.zeros(n, dtype=np.bool_),
            log_start=np.full(n, np.inf),
            seen=np.zeros(n, dtype=np.bool_),
            kit=kit,
            states=states,
        )

    def copied(self) -> "Progress":
        """Another that may be written to."""
        arrays = {
            f.name: getattr(self, f.name).copy()
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        return replace(self, **arrays, states=dict(self.states))

    def within(self, *phases: Phase) -> Mask:
        """(n,) the runs in one of these phases."""
        return among(self.phase, phases)

    def only(self, run: int) -> Mask:
        """(n,) that run alone."""
        one = np.zeros(len(self.phase), dtype=np.bool_)
        one[run] = True
        return one

    @property
    def finished(self) -> Mask:
        """(n,) the runs that are over."""
        return self.within(*OVER)


def renewed(state: Any, fresh: Any, rows: Mask) -> Any:
    """A law's state with some runs as they were before their first tick.

    What is no array with a row a run is the same in both, and stays.
    """
    if not is_dataclass(state) or isinstance(state, type):
        return state
    changes: dict[str, Any] = {}
    for entry in fields(state):
        old, new = getattr(state, entry.name), getattr(fresh, entry.name)
        if isinstance(old, np.ndarray) and old.shape[:1] == rows.shape:
            which = rows.reshape(-1, *[1] * (old.ndim - 1))
            changes[entry.name] = np.where(which, new, old)
    return replace(state, **changes)


def put(command: Command, part: Command, rows: Mask) -> None:
    """Write some runs' part of a law's command into a command that has all channels."""
    for name, value in part.items():
        command[name] = np.where(rows[:, None], value, command[name])
