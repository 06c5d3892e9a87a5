"""Whether a log's streams are nearer to each other once it is put right."""

from collections.abc import Sequence

import numpy as np

from twin.conventions.correction import Correction, apply_all
from twin.conventions.turning import turning_of
from twin.conventions.vertical import vertical_of
from twin.recording import Recording

WORSE = 1.1
"""By which ratio two streams may be further apart: their grid shifts with their clocks."""
ALIKE = np.radians(1.0)
"""Angles off upright that differ by less are alike [rad]."""


def brings_together(
    recording: Recording, corrections: Sequence[Correction], gravity: float
) -> bool:
    """Whether no two streams are further apart with the corrections than without.

    Looked at on the corrected streams themselves: the gyro against the rate of the attitude, the
    accelerometer against upright. Wheels have no part in it.

    Args:
        recording: as read, in the right units.
        corrections: of a reading that is to be advised.
        gravity: [m/s^2].
    """
    mended = apply_all(recording, corrections)
    before, after = turning_of(recording), turning_of(mended)
    if before is not None and after is not None and after.strain > WORSE * before.strain:
        return False
    as_read, right = (vertical_of(log, gravity) for log in (recording, mended))
    if as_read is None or right is None:
        return True
    same = np.eye(4), np.eye(3)
    return right.angle(*same) <= max(WORSE * as_read.angle(*same), as_read.angle(*same) + ALIKE)
