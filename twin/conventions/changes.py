"""The wrong conventions that a stream of each kind can have, each as a correction."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.conventions.axes import (
    LATE,
    MIRROR,
    ODD,
    SIMPLE,
    cost_of,
    quaternion_matrices,
    signed_permutations,
    words_for,
)
from twin.conventions.correction import Correction, as_tuple, stated
from twin.recording import Recording
from twin.units import listed, unit_named

Array = NDArray[np.float64]

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
