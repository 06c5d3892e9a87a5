"""The wrong conventions that a stream can have, each as a correction of values and stamps."""

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.recording import Recording, Series
from twin.recording.rows import columns_of
from twin.units import listed, unit_named

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Correction:
    """right value = factor * axes @ value read, true at time_factor * stamp - lag."""

    stream: str
    kind: str
    """`unit`, `axes`, `frame`, `order`, `direction`, `angles`, `time_unit`, `clock_lag`
    or `no_fit`, which corrects nothing."""
    words: str
    """What is wrong, without a capital or a full stop: "gyro looks like deg/s, read as rad/s".
    Empty for the further streams of a frame, which the first one's words name."""
    keys: tuple[tuple[str, str], ...] = ()
    """Keys of [streams.<stream>] in log.toml with the right text. Columns, rate and clock_lag
    depend on what stands there; `advice.py` works them out."""
    cost: float = 0.0
    """How unusual the mistake is [nats]."""
    factor: float = 1.0
    axes: tuple[tuple[float, ...], ...] = ()
    """Square, as wide as the stream; empty: as they are."""
    time_factor: float = 1.0
    lag: float = 0.0
    """[s], positive: stamped late."""
    sequence: str = ""
    """Of Euler angles ("ZYX"), whose file has them: `axes` (3, 3) are of these angles then."""
    world_to_body: bool = False
    """Whether these angles turn world components into body components."""

    def apply(self, series: Series) -> Series:
        """The stream as it should have been read."""
        value = series.value
        if self.sequence:
            backwards = self.world_to_body
            angles = angles_of(value, self.sequence, world_to_body=backwards)
            angles = right_angles(angles, np.array(self.axes), self.sequence)
            value = attitude_of(angles, self.sequence, world_to_body=backwards)
        elif self.axes:
            value = value @ np.array(self.axes).T
        if self.factor != 1.0:
            value = value * self.factor
        return replace(series, time=series.time * self.time_factor - self.lag, value=value)


def apply_all(recording: Recording, corrections: Iterable[Correction]) -> Recording:
    """The recording with every named stream corrected, in the order given."""
    streams: dict[str, Series] = dict(recording.streams)
    for correction in corrections:
        if correction.stream in streams:
            streams[correction.stream] = correction.apply(streams[correction.stream])
    return replace(recording, streams=streams)


def stated(recording: Recording, stream: str) -> Mapping[str, object]:
    """What log.toml says of a stream; empty for a recording of our own."""
    streams = recording.provenance.get("streams") or {}
    return streams.get(stream) or {}


def as_tuple(axes: Array) -> tuple[tuple[float, ...], ...]:
    """A matrix that a frozen dataclass can hold."""
    return tuple(tuple(float(entry) for entry in row) for row in axes)


def angles_of(value: Array, sequence: str, *, world_to_body: bool) -> Array:
    """(n, 3) [rad] that stand in the file for attitudes (n, 4), which turn body to world."""
    from scipy.spatial.transform import Rotation

    turned = rotation.conjugate(value) if world_to_body else value
    with warnings.catch_warnings():
        # a gimbal lock: one of the angles is free there, and taken as 0
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(Rotation.from_quat(turned, scalar_first=True).as_euler(sequence))


def right_angles(angles: Array, axes: Array, sequence: str) -> Array:
    """(n, 3) [rad] that are `axes` (3, 3) times those of the file.

    Two triples give each attitude, and `angles` (n, 3) are the one whose middle angle is the
    smaller. The file has that of the two whose right middle angle is in its range, for it was
    written in the right order: angles in a wrong one may well have a middle angle beyond 90 deg.
    """
    same_ends = sequence[0] == sequence[2]
    mirrored = -angles[:, 1] if same_ends else np.pi - angles[:, 1]
    other = np.column_stack([angles[:, 0] + np.pi, mirrored, angles[:, 2] + np.pi])
    right, turned = angles @ axes.T, other @ axes.T
    # between 0 and 180 deg where the first and the last axis are one, else within 90 deg of 0
    within = np.sin(right[:, 1]) >= 0.0 if same_ends else np.cos(right[:, 1]) >= 0.0
    return np.where(within[:, None], right, turned)


def attitude_of(angles: Array, sequence: str, *, world_to_body: bool) -> Array:
    """(n, 4) body to world of angles (n, 3) [rad] as they stand in the file."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler(sequence, angles).as_quat(scalar_first=True)
    return rotation.continuous(rotation.conjugate(turned) if world_to_body else turned)


SIMPLE = 6.0
"""What one plain mistake costs a hypothesis [nats]: one in four hundred logs has it."""
LATE = 9.0
"""What a clock that is off costs, a plain mistake too: beside a latency there are twenty times as
many lags that may fit by chance, and one of a whole period does as well as none."""
ODD = 12.0
"""What a rarer one costs, as much as two plain ones."""

MIRROR = 3.5
"""What a left-handed sensor of three axes costs beside that: nobody builds one, so that it is named
only where nothing right-handed fits, or with what fits as well."""


@cache
def signed_permutations(size: int) -> Array:
    """(count, size, size) matrices S: right = S read. The identity stands first.

    All 48 of three axes. Of more than three (wheels), those that swap two or flip one or all.
    """
    identity = np.eye(size)
    if size <= 3:
        orders, signs = permutations(range(size)), list(product((1.0, -1.0), repeat=size))
        return np.array([np.diag(s) @ identity[list(o)] for o in orders for s in signs]) + 0.0
    flips = [identity - 2.0 * np.diag(row) for row in identity]
    swaps = [identity[_swapped(size, i, j)] for i in range(size) for j in range(i)]
    return np.array([identity, -identity, *flips, *swaps])


def _swapped(size: int, i: int, j: int) -> list[int]:
    order = list(range(size))
    order[i], order[j] = j, i
    return order


def cost_of(axes: Array) -> float:
    """How unusual a mistake is [nats]: one axis flipped or two swapped are the plain ones."""
    source = np.argmax(np.abs(axes), axis=1)
    moved = int(np.sum(source != np.arange(len(axes))))
    flipped = int(np.sum(axes < 0.0))
    if moved == 0:
        return {0: 0.0, len(axes): SIMPLE + 1.0, 1: SIMPLE}.get(flipped, SIMPLE + 2.0)
    if flipped == 0:
        return SIMPLE if moved == 2 else SIMPLE + 2.0
    quarter_turn = moved == 2 and flipped == 1
    return SIMPLE + 2.0 if quarter_turn else ODD


def words_for(stream: str, axes: Array, names: Sequence[str]) -> str:
    """What is wrong with a stream whose right values are `axes` times those read."""
    source = np.argmax(np.abs(axes), axis=1)
    moved = [i for i, j in enumerate(source) if i != j]
    flipped = [i for i, row in enumerate(axes) if row.min() < 0.0]
    if not moved:
        if len(flipped) == len(axes) > 1:
            return f"every axis of {stream} points the other way"
        if len(axes) == 1:
            return f"{stream} has the wrong sign"
        which = listed([names[i] for i in flipped])
        if len(flipped) == 1:
            return f"{stream}'s {which} axis points the other way"
        return f"{stream}'s {which} axes point the other way"
    if not flipped and len(moved) == 2:
        return f"{stream}'s {listed([names[i] for i in moved])} axes are swapped"
    return f"{stream}'s axes are turned: " + ", ".join(
        f"{name} is read as {entry}"
        for name, entry in zip(names, entries(axes, names), strict=True)
        if name != entry
    )


def entries(axes: Array, names: Sequence[str]) -> list[str]:
    """Which column, and with which sign, is each axis: ["y", "-x", "z"]."""
    return ["-" * int(row.min() < 0.0) + names[int(np.argmax(np.abs(row)))] for row in axes]


def quaternion_matrices() -> Iterator[tuple[str, Array]]:
    """(name, 4 x 4) ways in which a quaternion can be misread: right = A read, up to its sign.

    `xyzw`: its scalar stands last and was read as first; `wxyz`: the reverse; `inverse`: it turns
    the other way; `axes`: its vector part is in other axes.
    """
    scalar_last = np.eye(4)[[3, 0, 1, 2]]
    inverse = np.diag([1.0, -1.0, -1.0, -1.0])
    yield "", np.eye(4)
    yield "xyzw", scalar_last
    yield "wxyz", scalar_last.T
    yield "inverse", inverse
    yield "xyzw inverse", inverse @ scalar_last
    yield "wxyz inverse", inverse @ scalar_last.T
    for axes in signed_permutations(3)[1:]:
        if (axes != -np.eye(3)).any():
            yield "axes", np.block([[np.ones((1, 1)), np.zeros((1, 3))], [np.zeros((3, 1)), axes]])


UNITS = {
    "rad": ("rad", "deg", "mrad", "rev"),
    "rad/s": ("rad/s", "deg/s", "rpm", "mrad/s", "rev/s", "mdeg/s"),
    "m/s^2": ("m/s^2", "g", "mg"),
    "T": ("T", "uT", "G", "mG", "nT"),
}
"""What a stream may really be in, by its SI unit."""

TRIADS = ("gyro", "accelerometer", "magnetometer")
"""Streams of one sensor with three axes."""

TOLD = 0.2
"""A smaller lag is a latency or a filter's; a diagnosis may find it, here it is not told [s]."""
CLOSE = 0.35
"""A factor fits a unit when the logarithm of their ratio is below this: 1.4 either way."""

TURNED = ("attitude", "gyro", "accelerometer", "magnetometer")
"""Streams that a frame turns, where the log has them. Wheels, stages and commands are numbered by
the platform and keep their signs."""
Z_DOWN = np.diag([1.0, -1.0, -1.0])
"""Half a turn about x: from north-east-down and front-right-down to axes with z up."""


@dataclass(frozen=True)
class FrameCorrection:
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


def unit_changes(recording: Recording, stream: str) -> list[Correction]:
    """Every other unit that a stream may really be in."""
    text = stated(recording, stream).get("unit")
    read = unit_named(str(text) if text else recording[stream].unit)
    return [
        Correction(
            stream,
            "unit",
            f"{stream} looks like {name}, read as {text or recording[stream].unit}",
            (("unit", name),),
            SIMPLE,
            factor=unit_named(name).factor / read.factor,
        )
        for name in UNITS.get(read.si, ())
        if unit_named(name).factor != read.factor
    ]


def unit_change(recording: Recording, stream: str, factor: float) -> Correction | None:
    """The unit by which values read must be multiplied by about `factor` to be right in SI.

    None where no unit of the stream's kind is near, or none nearer than the one that was read.
    """
    options = unit_changes(recording, stream)
    off = [abs(float(np.log(option.factor / factor))) for option in options]
    best = int(np.argmin(off)) if off else 0
    near = bool(off) and off[best] < min(CLOSE, abs(float(np.log(factor))))
    return options[best] if near else None


def axes_changes(recording: Recording, stream: str) -> Iterator[tuple[Array, Correction | None]]:
    """Every signed permutation of a stream's axes; None for the identity."""
    names = recording[stream].columns
    for axes in signed_permutations(len(names)):
        yield axes, axes_change(stream, axes, names)


def axes_change(stream: str, axes: Array, names: Sequence[str]) -> Correction | None:
    """The correction whose right values are `axes` times those read; None where it changes none."""
    if (axes == np.eye(len(axes))).all():
        return None
    words = words_for(stream, axes, names)
    cost = cost_of(axes)
    # gravity in the place of specific force turns every axis of an accelerometer
    gravity = stream == "accelerometer" and bool((axes == -np.eye(len(axes))).all())
    if stream in TRIADS and np.linalg.det(axes) < 0.0 and not gravity:
        cost += MIRROR
    return Correction(stream, "axes", words, cost=cost, axes=as_tuple(axes))


def attitude_changes(recording: Recording) -> Iterator[tuple[Array, Correction | None]]:
    """(4 x 4, correction) every way in which the attitude may have been misread."""
    facts = stated(recording, "attitude")
    layout = facts.get("format")
    backwards = facts.get("direction") == "world_to_body"
    wrong = ("world-to-body", "body-to-world")[backwards]
    direction = ("direction", wrong.replace("-", "_"))
    # a stated direction was applied after the order, so the order is mended before it
    undo = np.diag([1.0, -1.0, -1.0, -1.0]) if backwards else np.eye(4)
    for name, matrix in quaternion_matrices():
        order = name.split()[0] if name else ""
        if order in ("xyzw", "wxyz"):
            if layout == order or layout not in (None, "wxyz", "xyzw"):
                continue
            right = undo @ matrix @ undo
            words = f"the attitude's scalar stands {'last' if order == 'xyzw' else 'first'}"
            keys = (("format", order),)
            cost = SIMPLE + (order == "wxyz" and layout != "xyzw") * 2.0
            if name.endswith("inverse"):
                words += f", and it is {wrong}"
                keys, cost = (*keys, direction), cost + SIMPLE
            yield right, Correction("attitude", "order", words, keys, cost, axes=as_tuple(right))
        elif name == "inverse":
            words = f"attitude is {wrong}"
            yield (
                matrix,
                Correction(
                    "attitude", "direction", words, (direction,), SIMPLE, axes=as_tuple(matrix)
                ),
            )
        elif name == "axes":
            if str(layout).startswith("euler"):
                continue  # angles have signs and an order of their own
            axes = matrix[1:, 1:]
            yield (
                matrix,
                Correction(
                    "attitude",
                    "axes",
                    words_for("attitude", axes, ("x", "y", "z")),
                    cost=min(cost_of(axes), ODD),
                    axes=as_tuple(matrix),
                ),
            )
        else:
            yield matrix, None


def lag_change(stream: str, lag: float, half_width: float = 0.0) -> Correction | None:
    """A clock that is off by `lag` [s], known to +- `half_width`; positive: its stamps are late.
    None where a latency may be behind it."""
    if abs(lag) < TOLD:
        return None
    size = f"{abs(lag):.2f} s"
    if half_width and np.isfinite(half_width):
        # rounded up: an interval of no width would be none
        size = f"{abs(lag):.2f} +- {np.ceil(100.0 * half_width) / 100.0:.2f} s"
    where = f"{size} {'behind' if lag > 0.0 else 'ahead of'} the other streams"
    return Correction(
        stream,
        "clock_lag",
        f"{stream} {'lags' if lag > 0.0 else 'runs'} {where}",
        cost=LATE,
        lag=lag,
    )


def frames_of(recording: Recording) -> list[FrameCorrection]:
    """The frame as read, and z down (NED, FRD), in which every autopilot logs."""
    as_read = FrameCorrection(np.eye(3), np.eye(4), (), 0.0)
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
    return [as_read, FrameCorrection(Z_DOWN, attitude, corrections, SIMPLE)]


def angle_changes(recording: Recording) -> Iterator[Correction]:
    """Every other sign and order of the three angles of the attitude; none of a quaternion."""
    facts = stated(recording, "attitude")
    layout = str(facts.get("format") or "")
    if not layout.startswith("euler_") or "attitude" not in recording:
        return
    names = columns_of(layout)
    columns = facts.get("columns")
    if names[0] == "first" and isinstance(columns, list) and len(columns) == 3:
        names = [str(name).removeprefix("-") for name in columns]
    for axes in signed_permutations(3)[1:]:
        yield Correction(
            "attitude",
            "angles",
            _words(axes, names),
            cost=_cost(axes),
            axes=as_tuple(axes),
            sequence=layout.removeprefix("euler_").upper(),
            world_to_body=facts.get("direction") == "world_to_body",
        )


def read_angles(recording: Recording) -> Iterator[tuple[Correction | None, Series]]:
    """The attitude as read, and with every change of its angles, worked out once."""
    series, changes = recording["attitude"], list(angle_changes(recording))
    yield None, series
    if not changes:
        return
    sequence, backwards = changes[0].sequence, changes[0].world_to_body
    angles = angles_of(series.value, sequence, world_to_body=backwards)
    for change in changes:
        turned = right_angles(angles, np.array(change.axes), sequence)
        value = attitude_of(turned, sequence, world_to_body=backwards)
        yield change, replace(series, value=value)


def _cost(axes: Array) -> float:
    """One angle, or all of them, turn the other way; two columns are swapped: plain mistakes."""
    moved = int(np.sum(np.argmax(np.abs(axes), axis=1) != np.arange(3)))
    negated = int(np.sum(axes < 0.0))
    signs = {0: 0.0, 2: SIMPLE + 1.0}.get(negated, SIMPLE)
    order = {0: 0.0, 2: SIMPLE}.get(moved, SIMPLE + 2.0)
    return min(signs + order, ODD + 2.0)


def _words(axes: Array, names: tuple[str, ...] | list[str]) -> str:
    source = np.argmax(np.abs(axes), axis=1)
    moved = [names[i] for i, j in enumerate(source) if i != j]
    negated = [names[i] for i, row in enumerate(axes) if row.min() < 0.0]
    if len(negated) == 3 and not moved:
        return f"the attitude's {listed(names)} turn clockwise, read as counterclockwise"
    if not moved:
        sign = "have the wrong signs" if len(negated) > 1 else "has the wrong sign"
        return f"the attitude's {listed(negated)} {sign}"
    if not negated and len(moved) == 2:
        return f"the attitude's {listed(moved)} are swapped"
    return "the attitude's angles stand in another order: " + ", ".join(
        f"{name} is read as {entry}"
        for name, entry in zip(names, entries(axes, names), strict=True)
        if name != entry
    )
