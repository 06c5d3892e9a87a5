"""Attitudes as labs write them -> ours: scalar first, unit, body to world, no jumps of sign."""

from collections.abc import Callable

import numpy as np

from twin import rotation
from twin.recording.formats import NumberFile
from twin.recording.rows import Array, Rows, own

SEQUENCES = ("zyx", "xyz", "zxy", "yxz", "yzx", "xzy", "zyz", "zxz")
"""Axes of intrinsic rotations, the first one first; backwards they are extrinsic ones."""
LAYOUTS = (
    *("wxyz", "xyzw"),
    *(f"euler_{axes}" for axes in SEQUENCES),
    *("rotation_vector", "matrix"),
)
DIRECTIONS = ("body_to_world", "world_to_body")

ROUNDING = 1e-12
"""Quaternions whose length is off by less stay as they are, to the last bit."""
STEEPEST = 0.5 * np.pi + 1e-2
"""No pitch of a yaw-pitch-roll triple is steeper [rad]."""
NOT_SQUARE = 0.02
"""Rows of a matrix that are further from square and from length 1 are of no rotation."""
OFF_LENGTH = 1e-3
"""Those whose length is off by more are worth a word."""
BLOCK = 1 << 16
"""Rows that are turned into quaternions at once, so that what is computed on the way is small."""


def columns_of(layout: str) -> tuple[str, ...]:
    """Names of the columns of an attitude that is no quaternion, in their order."""
    if layout == "euler_zyx":
        return ("yaw", "pitch", "roll")
    if layout == "euler_xyz":
        return ("roll", "pitch", "yaw")
    if layout == "rotation_vector":
        return ("x", "y", "z")
    if layout == "matrix":
        return tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
    return ("first", "second", "third")


def started(rows: Rows, where: str) -> Rows:
    """Without the zeros that a sensor of attitude gives before it starts."""
    zero = _lengths(rows.value) == 0.0
    if not zero[:1].any() or zero.all():
        return rows
    first = int(np.argmin(zero))
    ahead = "1 row" if first == 1 else f"{first} rows"
    repair = f"{where}: {ahead} of zeros before the sensor started left out"
    return rows.only(np.arange(first, len(zero)), repair)


def attitude(
    rows: Rows, layout: str, world_to_body: bool, file: NumberFile, where: str
) -> tuple[Array, tuple[str, ...]]:
    """Quaternions (m, 4), and a sentence where their length had to be mended.

    Args:
        rows: with values as `layout` has them; angles and rotation vectors in rad, a matrix row by
            row, its columns the body's axes in the world.
        layout: one of LAYOUTS.
        world_to_body: whether they turn world components into body components.
        file: for the error, where the rows are from.
        where: how the sentences call the stream.

    Raises:
        LogError: a quaternion without length, a matrix that is no rotation.
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
        quaternion = _by_blocks(lambda angles: rotation.from_euler_zyx(*angles.T), rows.value)
    elif layout.startswith("euler"):
        from scipy.spatial.transform import Rotation

        axes = layout.removeprefix("euler_").upper()
        quaternion = _by_blocks(
            lambda angles: Rotation.from_euler(axes, angles).as_quat(scalar_first=True), rows.value
        )
    elif layout == "rotation_vector":
        from scipy.spatial.transform import Rotation

        quaternion = _by_blocks(
            lambda turns: Rotation.from_rotvec(turns).as_quat(scalar_first=True), rows.value
        )
    elif layout == "matrix":
        quaternion = _of_matrices(rows, file)
    else:
        quaternion = rows.value
        if layout == "xyzw":
            quaternion = _by_blocks(lambda q: q[:, [3, 0, 1, 2]], quaternion, own(quaternion))
        length = _lengths(quaternion)
        row = int(np.argmin(length))
        if length[row] >= 0.1:
            row = int(np.argmax(length))
        if not 0.1 <= length[row] < np.inf:
            raise file.fault(
                f"attitude has a quaternion of length {length[row]:.3g}",
                "check `format` and `columns`, or delete the row",
                int(rows.origin[row]),
            )
        off = np.abs(np.subtract(length, 1.0, out=length), out=length)
        worst = int(np.argmax(off))
        if off[worst] > OFF_LENGTH:
            repairs = (
                f"{where}: {np.count_nonzero(off > OFF_LENGTH)} of {len(off)} quaternions scaled "
                f"to length 1, the worst was {_lengths(quaternion[worst : worst + 1])[0]:.4g}",
            )
        scaled = off[worst] > ROUNDING
        del length, off
        if scaled:
            quaternion = _by_blocks(rotation.normalized, quaternion, own(quaternion))
    if world_to_body:
        quaternion = _by_blocks(rotation.conjugate, quaternion, own(quaternion))
    return rotation.continuous(quaternion, out=own(quaternion)), repairs


def _lengths(value: Array) -> Array:
    """Of each row (m,); infinite where a square is."""
    with np.errstate(over="ignore"):
        return _by_blocks(lambda rows: np.linalg.norm(rows, axis=1), value)


def _by_blocks(function: Callable[[Array], Array], value: Array, out: Array | None = None) -> Array:
    """A function of each row by itself, of some rows (m, k) after the others.

    Args:
        function: of rows.
        value: all rows.
        out: where the results go, which may be `value` itself; a new array by default.
    """
    first = function(value[:BLOCK])
    if out is None:
        out = np.empty((len(value), *first.shape[1:]))
    out[: len(first)] = first
    for start in range(len(first), len(value), BLOCK):
        out[start : start + BLOCK] = function(value[start : start + BLOCK])
    return out


def _of_matrices(rows: Rows, file: NumberFile) -> Array:
    from scipy.spatial.transform import Rotation

    matrix = rows.value.reshape(-1, 3, 3)
    off = np.abs(matrix @ matrix.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    mirrored = np.linalg.det(matrix) < 0.0
    if off.max() > NOT_SQUARE or mirrored.any():
        row = int(np.argmax(np.where(mirrored, np.inf, off)))
        raise file.fault(
            "attitude has a matrix that is no rotation"
            + (", but mirrors" if mirrored[row] else f": its rows are {off[row]:.2g} off square"),
            "check the order of `columns`: row by row",
            int(rows.origin[row]),
        )
    return Rotation.from_matrix(matrix).as_quat(scalar_first=True)
