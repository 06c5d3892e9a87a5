"""Angles of hinges and gimbals that a counter or an atan2 wraps at a full turn -> without jumps."""

import numpy as np

from twin.recording.rows import Array

CONTINUOUS = ("joint_angle", "gimbal_angle")
"""Streams whose angles count whole turns."""
TURN = 2.0 * np.pi
SLACK = 1e-3
"""Of a turn, by which what is wrapped may be wider than one: noise, and an encoder's step."""


def unwrapped(value: Array, where: str) -> tuple[Array, tuple[str, ...]]:
    """Angles (m, k) [rad] without the jumps of a turn, and a sentence that counts them.

    A column is taken for wrapped where it stays within one turn and jumps, and without the jumps
    moves by less than a quarter of a turn a row: anything else that jumps is left as it is.

    Args:
        value: as logged.
        where: how the sentence calls the stream.
    """
    steps = np.abs(np.diff(value, axis=0))
    smooth = np.unwrap(value, axis=0)
    wrapped = (
        (np.ptp(value, axis=0) < (1.0 + SLACK) * TURN)
        & (steps > 0.5 * TURN).any(axis=0)
        & (np.abs(np.diff(smooth, axis=0)) < 0.25 * TURN).all(axis=0)
    )
    if not wrapped.any():
        return value, ()
    jumps = int(np.count_nonzero(steps[:, wrapped] > 0.5 * TURN))
    said = f"{jumps} jump" if jumps == 1 else f"{jumps} jumps"
    return np.where(wrapped, smooth, value), (f"{where}: {said} of a whole turn taken out",)
