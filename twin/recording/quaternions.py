"""Attitudes as labs write them -> ours: scalar first, unit, body to world, no jumps of sign."""

import numpy as np

from twin import rotation
from twin.recording.formats import NumberFile
from twin.recording.rows import Array, Rows

LAYOUTS = ("wxyz", "xyzw", "euler_zyx")
DIRECTIONS = ("body_to_world", "world_to_body")

ROUNDING = 1e-12
"""Quaternions whose length is off by less stay as they are, to the last bit."""
STEEPEST = 0.5 * np.pi + 1e-2
"""No pitch of a yaw-pitch-roll triple is steeper [rad]."""
OFF_LENGTH = 1e-3
"""Those whose length is off by more are worth a word."""


def attitude(
    rows: Rows, layout: str, world_to_body: bool, file: NumberFile, where: str
) -> tuple[Array, tuple[str, ...]]:
    """Quaternions (m, 4), and a sentence where their length had to be mended.

    Args:
        rows: with values as `layout` has them; angles [rad]: yaw, pitch, roll.
        layout: one of LAYOUTS.
        world_to_body: whether they turn world components into body components.
        file: for the error, where the rows are from.
        where: how the sentences call the stream.

    Raises:
        LogError: a quaternion without length.
    """
    repairs: tuple[str, ...] = ()
    if layout == "euler_zyx":
        pitch = np.abs(rows.value[:, 1])
        if pitch.max() > STEEPEST:
            row = int(np.argmax(pitch))
            raise file.fault(
                f"attitude has a pitch of {pitch[row]:.4g} rad, and none is beyond pi / 2",
                'say unit = "deg" if that is what it is in, or check the order of `columns`',
                int(rows.origin[row]),
            )
        quaternion = rotation.from_euler_zyx(*rows.value.T)
    else:
        quaternion = rows.value[:, [3, 0, 1, 2]] if layout == "xyzw" else rows.value
        length = np.linalg.norm(quaternion, axis=1)
        if length.min() < 0.1:
            row = int(np.argmin(length))
            raise file.fault(
                f"attitude has a quaternion of length {length[row]:.3g}",
                "check `format` and `columns`, or delete the row",
                int(rows.origin[row]),
            )
        off = np.abs(length - 1.0)
        if off.max() > OFF_LENGTH:
            repairs = (
                f"{where}: {np.count_nonzero(off > OFF_LENGTH)} of {len(off)} quaternions scaled "
                f"to length 1, the worst was {length[np.argmax(off)]:.4g}",
            )
        if off.max() > ROUNDING:
            quaternion = rotation.normalized(quaternion)
    if world_to_body:
        quaternion = rotation.conjugate(quaternion)
    flips = np.einsum("ij,ij->i", quaternion[1:], quaternion[:-1]) < 0.0
    sign = np.where(np.concatenate([[0], np.cumsum(flips)]) % 2, -1.0, 1.0)
    return quaternion * sign[:, None], repairs
