"""m r from where the body hangs at several positions of its masses: for machines without wheels.

At rest gravity asks for no torque: (m r + d) x g = 0, g in body axes, d what the masses add. Known
moves of known masses set the scale, so all three components are seen. A body on air does not come
to rest, so g is its mean over pieces of the time in which the masses stand still.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.errors import UsageError
from twin.identification.linear.equations import Equations, gravity_rows
from twin.identification.linear.least_squares import BLOCK, Estimate, least_squares
from twin.identification.track import Track
from twin.predict.base import BaseParameters

Array = NDArray[np.float64]

STANDING = 1e-5
"""[kg m/s]: masses stand still while d changes no faster."""
APART = 1e-5
"""[kg m] between two places of the masses."""
SETTLING = 1.0
"""[s] left out after a move."""
FEWEST = 3
"""Places of the masses that tell m r."""


def equilibria(tracks: Sequence[Track], base: BaseParameters) -> Estimate:
    """Of all rests of all logs.

    Raises:
        UsageError: the masses stand still in too few places.
    """
    logs = [_hanging(track) for track in tracks]
    places = np.concatenate([moved for _, moved in logs])
    count = len(np.unique(np.round(places / APART), axis=0))
    if count < FEWEST:
        raise UsageError(
            f"the sliding masses stand still for {BLOCK + SETTLING:g} s in {count} places; "
            f"equilibria needs {FEWEST} or more, as far apart as the tilt allows: move a mass, let "
            "the swing die down, move on"
        )
    return least_squares([equations for equations, _ in logs], base)


def _hanging(track: Track) -> tuple[Equations, Array]:
    """A row of equations for each piece of standing masses, and where they stood, (m, 3) [kg m]."""
    changed = np.linalg.norm(np.diff(track.moved, axis=0), axis=1) > STANDING * track.step
    edges = np.concatenate([[0], np.flatnonzero(changed) + 1, [len(track.time)]])
    skip, size = round(SETTLING / track.step), round(BLOCK / track.step)
    pieces = [
        slice(first, first + size)
        for begin, end in zip(edges, edges[1:], strict=False)
        for first in range(begin + skip * (begin > 0), end - size + 1, size)
    ]
    gravity = np.array([track.gravity[piece].mean(axis=0) for piece in pieces]).reshape(-1, 3)
    moved = np.array([track.moved[piece].mean(axis=0) for piece in pieces]).reshape(-1, 3)
    rows = np.zeros((len(pieces), 3, 9))
    rows[:, :, 6:] = gravity_rows(gravity)
    # one piece is one block
    time = BLOCK * np.arange(len(pieces), dtype=np.float64)
    return Equations(time, rows, rotation.cross(moved, gravity)), moved
