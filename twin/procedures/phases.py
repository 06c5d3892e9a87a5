"""The phases of a balancing, as a person would tell them."""

from enum import IntEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray


class Phase(IntEnum):
    """What a run is doing; the numbers stand in the procedure's state, (n,)."""

    lower = 0
    settle = 1
    level = 2
    nudge = 3
    back = 4
    swing = 5
    identify = 6
    move = 7
    verify = 8
    judge = 9
    done = 10
    stopped = 11


WORDS: dict[Phase, str] = {
    Phase.lower: "the vertical mass goes to its lower end, so that the body hangs",
    Phase.settle: "away from the stop and at rest",
    Phase.level: "the law brings the CM under the CR",
    Phase.nudge: "masses aside, to make it swing",
    Phase.back: "and back",
    Phase.swing: "swinging, hardly damped; recorded",
    Phase.identify: "held while J and m r are identified",
    Phase.move: "masses go to where the CM should be",
    Phase.verify: "floating free; recorded",
    Phase.judge: "held while what is left is identified",
    Phase.done: "balanced",
    Phase.stopped: "stopped: masses hold, nothing else acts",
}

OVER = (Phase.done, Phase.stopped)
"""A run leaves these no more."""


def among(now: NDArray[np.int64], phases: tuple[Phase, ...]) -> NDArray[np.bool_]:
    """(n,) which of some runs' phases are of these; asked of every tick."""
    return _is_one(phases)[now]


@cache
def _is_one(phases: tuple[Phase, ...]) -> NDArray[np.bool_]:
    return np.isin(np.arange(len(Phase)), phases)
