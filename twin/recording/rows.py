"""Rows in the order of their times, quaternions and wrapped angles: mended, or refused."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.recording.formats import NumberFile

Array = NDArray[np.float64]

LATE_ROWS = 10
"""A row later than this many sampling periods was not delayed: the clock was set back."""

MOSTLY = 0.25
"""Share of rows beyond which those that are late are the rule."""
SQUEEZED = 1.5
"""A late row that finds its place free stands two periods between its neighbours; where it has less
room than this [periods], others were there already."""


@dataclass(frozen=True)
class TimedRows:
    """Rows of one stream."""

    time: Array
    """(m,) [s]"""
    value: Array
    """(m, k), all finite."""
    origin: NDArray[np.intp]
    """(m,) the row of the file (from 0) that each was."""
    repairs: tuple[str, ...]
    """A sentence for each kind of repair."""

    def only(self, keep: NDArray[np.bool_] | NDArray[np.intp], repair: str) -> "TimedRows":
        """Some of the rows, or all in another order, and the sentence that says so."""
        repairs = (*self.repairs, repair)
        return TimedRows(self.time[keep], self.value[keep], self.origin[keep], repairs)


def writable(value: Array) -> Array | None:
    """The array, where nobody else holds it and a result may be written over it; else None.

    A log's numbers may fill half of the memory, so no step holds them twice without need.
    """
    return value if value.flags.writeable else None


def mended(
    time: Array,
    value: Array,
    file: NumberFile,
    names: Sequence[str],
    clock: str | None,
    where: str,
    origin: NDArray[np.intp],
) -> TimedRows:
    """Leave out rows without a number, sort late ones, drop repeated ones; say each.

    Args:
        time: (m,) [s].
        value: (m, k); NaN where the file has nothing.
        file: for the errors, where the rows are from.
        names: k columns of the file.
        clock: the column of the file that the times are from; None without one.
        where: how the sentences call the stream.
        origin: (m,) the row of the file (from 0) that each is.

    Raises:
        LogError: a number is missing or not finite, a column has none, the clock was set back or
            is none, or one time stands on two different rows.
    """
    rows = TimedRows(time, value, origin, file.repairs)
    return _once(_in_order(_filled(rows, file, names, clock, where), file, where), file, where)


def _filled(
    rows: TimedRows, file: NumberFile, names: Sequence[str], clock: str | None, where: str
) -> TimedRows:
    finite = np.isfinite(rows.value)
    if finite.all() and np.isfinite(rows.time).all():
        return rows
    blank: NDArray[np.bool_] = np.logical_and.reduce(np.isnan(rows.value), axis=1)
    if blank.all():
        raise file.fault(f"has no number in {', '.join(names)}", "name other `columns`")
    none: NDArray[np.bool_] = np.logical_and.reduce(np.isnan(rows.value), axis=0)
    if none.any():
        empty = ", ".join(repr(name) for name, void in zip(names, none, strict=True) if void)
        raise file.fault(
            f"has nothing in column {empty}", "list the others in `columns`, and in `axes`"
        )
    wrong = ~finite & ~blank[:, None]
    if wrong.any():
        row, column = (int(index) for index in np.argwhere(wrong)[0])
        number = float(rows.value[row, column])
        raise file.not_finite(int(rows.origin[row]), names[column], number)
    stampless = ~np.isfinite(rows.time) & ~blank
    if stampless.any():
        row = int(np.argmax(stampless))
        raise file.not_finite(int(rows.origin[row]), clock or file.time, float(rows.time[row]))
    if not blank.any():
        return rows
    return rows.only(~blank, f"{where}: {_rows(blank)} without a number left out")


def steps_back(time: Array) -> NDArray[np.bool_]:
    """(m - 1,) where a clock (m,) [s] was set back: by more than rows are late."""
    gaps = np.diff(time)
    if not (gaps < 0.0).any():
        return np.zeros(len(gaps), dtype=bool)
    return gaps < -LATE_ROWS * float(np.median(np.abs(gaps)))


def _in_order(rows: TimedRows, file: NumberFile, where: str) -> TimedRows:
    gaps = np.diff(rows.time)
    if not (gaps < 0.0).any():
        return rows
    period = float(np.median(np.abs(gaps)))
    behind = np.maximum.accumulate(rows.time) - rows.time
    back = behind > LATE_ROWS * period
    if back.any():
        worst = int(np.argmax(back))
        raise file.fault(
            f"time goes back from {rows.time[worst - 1]:.6g} s to {rows.time[worst]:.6g} s",
            "split the file there, or take a part on one side of it with `start` and `stop`",
            int(rows.origin[worst]),
        )
    late = behind > 0.0
    if np.count_nonzero(late) > MOSTLY * len(late) > 1.0:
        raise file.fault(
            f"time goes back to {_rows(late)} of {len(late)}: it is no clock",
            "name the column of times as `time`, or give `rate`",
        )
    order = np.argsort(rows.time, kind="stable")
    if _squeezed(rows.time[order], np.isin(order, np.flatnonzero(late))):
        first = int(np.argmax(late))
        raise file.fault(
            f"time goes back from {rows.time[first - 1]:.6g} s to {rows.time[first]:.6g} s, where "
            "no row was missing",
            "its clock was set back: split the file there",
            int(rows.origin[first]),
        )
    return rows.only(order, f"{where}: {_rows(late)} out of order sorted by time")


def _squeezed(time: Array, moved: NDArray[np.bool_]) -> bool:
    """Whether rows that were sorted to an earlier place fill no holes there."""
    gaps = np.diff(time)
    inner = np.flatnonzero(moved[1:-1]) + 1
    before, after = gaps[inner - 1], gaps[inner]
    twice = (before == 0.0) | (after == 0.0)  # of one row again
    room = (before + after)[~twice]
    return bool(room.size) and float(np.median(room)) < SQUEEZED * float(np.median(gaps))


def _once(rows: TimedRows, file: NumberFile, where: str) -> TimedRows:
    same_time = np.diff(rows.time) == 0.0
    if not same_time.any():
        return rows
    same_row = same_time & (np.diff(rows.value, axis=0) == 0.0).all(axis=1)
    differing = np.flatnonzero(same_time & ~same_row)
    if differing.size:
        second = differing[0] + 1
        raise file.fault(
            f"time {rows.time[second]:.9g} s stands on two rows with different values",
            "correct the time, or delete one",
            int(rows.origin[second]),
        )
    dropped = f"{where}: {_rows(same_row)} that repeat the one before dropped"
    return rows.only(np.concatenate([[True], ~same_row]), dropped)


def _rows(which: NDArray[np.bool_]) -> str:
    count = int(np.count_nonzero(which))
    return f"{count} row" if count == 1 else f"{count} rows"


SEQUENCES = ("zyx", "xyz", "zxy", "yxz", "yzx", "xzy", "zyz", "zxz")
"""Axes of intrinsic rotations, the first one first; backwards they are extrinsic ones."""
LAYOUTS = (
    *("wxyz", "xyzw"),
    *(f"euler_{axes}" for axes in SEQUENCES),
    *("rotation_vector", "matrix", "heading"),
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
    if layout == "heading":
        return ("heading",)
    if layout == "matrix":
        return tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
    return ("first", "second", "third")


def started(rows: TimedRows, where: str) -> TimedRows:
    """Without the zeros that a sensor of attitude gives before it starts."""
    zero = _lengths(rows.value) == 0.0
    if not zero[:1].any() or zero.all():
        return rows
    first = int(np.argmin(zero))
    ahead = "1 row" if first == 1 else f"{first} rows"
    repair = f"{where}: {ahead} of zeros before the sensor started left out"
    return rows.only(np.arange(first, len(zero)), repair)


def attitude(
    rows: TimedRows, layout: str, world_to_body: bool, file: NumberFile, where: str
) -> tuple[Array, tuple[str, ...]]:
    """Quaternions (m, 4), and a sentence where their length had to be mended.

    Args:
        rows: with values as `layout` has them; angles and rotation vectors in rad, a matrix row by
            row, its columns the body's axes in the world, a heading about the world's z.
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
    elif layout == "heading":
        quaternion = _by_blocks(
            lambda angle: rotation.from_rotation_vector(angle * [0.0, 0.0, 1.0]), rows.value
        )
    else:
        quaternion = rows.value
        if layout == "xyzw":
            quaternion = _by_blocks(lambda q: q[:, [3, 0, 1, 2]], quaternion, writable(quaternion))
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
            quaternion = _by_blocks(rotation.normalized, quaternion, writable(quaternion))
    if world_to_body:
        quaternion = _by_blocks(rotation.conjugate, quaternion, writable(quaternion))
    return rotation.continuous(quaternion, out=writable(quaternion)), repairs


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


def _of_matrices(rows: TimedRows, file: NumberFile) -> Array:
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
