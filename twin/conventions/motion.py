"""Hypotheses about gyro, attitude and accelerometer: thousands, ranked by what they leave over."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.conventions.axes import LATE, signed_permutations
from twin.conventions.changes import (
    Frame,
    attitude_changes,
    axes_changes,
    frames_of,
    lag_change,
)
from twin.conventions.correction import Correction
from twin.conventions.euler import read_angles
from twin.conventions.gravity import Upright
from twin.conventions.hypothesis import AttitudeReading, Hypothesis
from twin.conventions.turning import NEAR, Turning, far_lags, vector_axes
from twin.recording import Recording

Array = NDArray[np.float64]

DEAREST = 20.0
"""No hypothesis whose axes cost more is looked at [nats]."""
ALIKE = 6.0
"""Other axes of an accelerometer within this of the best ones are looked at too [nats] ..."""
FORCES = 3
"""... so many in all."""

Axes = tuple[Array, Correction | None]
"""Axes of a stream before the frame is turned, and the correction to them."""
Orientation = tuple[Frame, Array, Correction | None]
"""A frame, what it and a correction before it make of the quaternion (4, 4), and the correction."""
Force = tuple[Array, Correction | None, float]
"""Total axes of an accelerometer, the correction before the frame, and their misfit [nats]."""

PLACE = {axes.tobytes(): index for index, axes in enumerate(signed_permutations(3))}


def motion_hypotheses(
    recording: Recording, turning: Turning, upright: Upright | None
) -> Iterator[Hypothesis]:
    """Every frame with every reading of the attitude and every axes of the gyro, each in step, and
    with the one or the other late; the log as read among them."""
    gyros = list(axes_changes(recording, "gyro"))
    felt = upright is not None and upright.has_accelerometer
    forces = list(axes_changes(recording, "accelerometer")) if felt else []
    options = list(orientations(recording)), gyros, forces
    for change, series in read_angles(recording):
        turned, up = turning, upright
        if change is not None:
            turned, up = turning.with_attitude(series), upright and upright.with_attitude(series)
        yield from _hypotheses(AttitudeReading(change, series, turned, up), *options)


def _hypotheses(
    reading: AttitudeReading,
    turns: Sequence[Orientation],
    gyros: Sequence[Axes],
    felt: Sequence[Axes],
) -> Iterator[Hypothesis]:
    turning, upright = reading.turning, reading.upright
    near, lags = turning.match(NEAR), far_lags(turning.grid.longest_lag)
    matches = [("", near)]
    if len(lags):
        far = turning.match(lags)
        matches += [("gyro", far), ("attitude", far)]
    for frame, attitude, attitude_change in turns:
        family, turned = vector_axes(attitude)
        lean = upright.penalty(attitude) if upright is not None else 0.0
        forces = _forces(upright, felt, frame, attitude)
        for axes, gyro_change in gyros:
            before = [reading.change, attitude_change, gyro_change]
            before = [change for change in before if change is not None]
            least = lean + frame.cost + sum(change.cost for change in before)
            if before and least > DEAREST:
                continue
            gyro = frame.vector @ axes
            index = family, place_of(turned.T @ gyro)
            for force, force_change, force_misfit in forces:
                own = before if force_change is None else [*before, force_change]
                cost = least if force_change is None else least + force_change.cost
                if own and cost > DEAREST:
                    continue
                for late, match in matches:
                    lag = float(match.lag[index])
                    lag = -lag if late == "attitude" else lag
                    clock = lag_change(late, lag) if late else None
                    yield Hypothesis(
                        corrections=(*own, *frame.corrections, *([clock] if clock else [])),
                        cost=cost + (LATE if late else 0.0),
                        misfit=0.5 * float(match.misfit[index]) + force_misfit,
                        reading=reading,
                        attitude=attitude,
                        gyro=gyro,
                        force=force,
                        gyro_lag=0.0 if late == "attitude" else lag,
                        attitude_lag=lag if late == "attitude" else 0.0,
                    )


def orientations(recording: Recording) -> Iterator[Orientation]:
    """Every frame with every reading of the attitude."""
    changes = list(attitude_changes(recording))
    for frame in frames_of(recording):
        for attitude, change in changes:
            yield frame, frame.attitude @ attitude + 0.0, change


def place_of(axes: Array) -> int:
    """Where a signed permutation (3, 3) stands among all of them."""
    return PLACE[(axes + 0.0).tobytes()]


def _forces(
    upright: Upright | None, read: Sequence[Axes], frame: Frame, attitude: Array
) -> list[Force]:
    """The accelerometer in no other axes than the frame's, and in its best axes beside that: those
    that fit alike."""
    if upright is None or not read:
        return [(frame.vector, None, 0.0)]
    misfit = 0.5 * upright.match(attitude)
    total = [(frame.vector @ axes, change) for axes, change in read]
    as_read, *others = [(axes, change, float(misfit[place_of(axes)])) for axes, change in total]
    scores = [force[2] + (force[1].cost if force[1] else 0.0) for force in others]
    near = min(scores) + ALIKE
    ranked = sorted(zip(scores, range(len(others)), strict=True))[:FORCES]
    return [as_read, *(others[k] for score, k in ranked if score < near)]
