"""Frames of a whole log: one convention that turns attitude, gyro and accelerometer together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.conventions.axes import SIMPLE, listed
from twin.conventions.correction import Correction, as_tuple
from twin.recording import Recording

Array = NDArray[np.float64]

TURNED = ("attitude", "gyro", "accelerometer", "magnetometer")
"""Streams that a frame turns, where the log has them. Wheels, stages and commands are numbered by
the platform and keep their signs."""
Z_DOWN = np.diag([1.0, -1.0, -1.0])
"""Half a turn about x: from north-east-down and front-right-down to axes with z up."""


@dataclass(frozen=True)
class Frame:
    """World and body axes of a log: right vector = vector @ read, right attitude = attitude @ read.

    The streams' own mistakes are mended before the frame is turned.
    """

    vector: Array
    """(3, 3), of rates, forces and fields in body axes."""
    attitude: Array
    """(4, 4), of the quaternion: the turn is made on both of its sides."""
    corrections: tuple[Correction, ...]
    """One a stream; the first one has the words for all of them."""
    cost: float
    """How unusual the frame is [nats]: one mistake, however many streams it turns."""


def frames_of(recording: Recording) -> list[Frame]:
    """The frame as read, and z down (NED, FRD), in which every autopilot logs."""
    as_read = Frame(np.eye(3), np.eye(4), (), 0.0)
    if "attitude" not in recording:
        return [as_read]
    present = [name for name in TURNED if name in recording]
    present = [n for n in present if recording[n].columns in (("x", "y", "z"), tuple("wxyz"))]
    attitude = np.diag([1.0, *np.diag(Z_DOWN)])
    verb = "is" if len(present) == 1 else "are"
    words = f"{listed(present)} {verb} in axes with z down (NED, FRD)"
    corrections = tuple(
        Correction(
            name,
            "frame",
            words if name == present[0] else "",
            cost=SIMPLE if name == present[0] else 0.0,
            axes=as_tuple(attitude if name == "attitude" else Z_DOWN),
        )
        for name in present
    )
    return [as_read, Frame(Z_DOWN, attitude, corrections, SIMPLE)]
