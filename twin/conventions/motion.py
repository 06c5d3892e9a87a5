"""Hypotheses about gyro, attitude and accelerometer: thousands, ranked by what they leave over."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.conventions.axes import SIMPLE, signed_permutations
from twin.conventions.changes import attitude_changes, axes_changes, lag_change
from twin.conventions.correction import Correction
from twin.conventions.gravity import Upright
from twin.conventions.hypothesis import Hypothesis
from twin.conventions.turning import NEAR, Turning, far_lags, vector_axes
from twin.recording import Recording

Array = NDArray[np.float64]

DEAREST = 20.0
"""No hypothesis whose axes cost more is looked at [nats]."""

Force = tuple[Array, Correction | None, float]
"""Axes of an accelerometer, the correction to them, and their misfit [nats]."""


def motion_hypotheses(
    recording: Recording, turning: Turning, upright: Upright | None
) -> Iterator[Hypothesis]:
    """Every reading of the attitude with every axes of the gyro, each in step, and with the one or
    the other late; the log as read among them."""
    place = {axes.tobytes(): index for index, axes in enumerate(signed_permutations(3))}
    near, lags = turning.match(NEAR), far_lags(turning.grid.longest_lag)
    matches = [("", near)]
    if len(lags):
        far = turning.match(lags)
        matches += [("gyro", far), ("attitude", far)]
    gyros = list(axes_changes(recording, "gyro"))
    felt = upright if upright is not None and upright.has_accelerometer else None
    read = list(axes_changes(recording, "accelerometer")) if felt is not None else []
    for attitude, attitude_change in attitude_changes(recording):
        family, turned = vector_axes(attitude)
        lean = upright.penalty(attitude) if upright is not None else 0.0
        forces = _forces(felt, read, attitude)
        for gyro, gyro_change in gyros:
            index = family, place[(turned.T @ gyro + 0.0).tobytes()]
            for force, force_change, force_misfit in forces:
                axes = [c for c in (attitude_change, gyro_change, force_change) if c is not None]
                cost = lean + sum(change.cost for change in axes)
                if axes and cost > DEAREST:
                    continue
                for late, match in matches:
                    lag = float(match.lag[index])
                    own = -lag if late == "attitude" else lag
                    clock = lag_change(late, own) if late else None
                    yield Hypothesis(
                        corrections=(*axes, *([clock] if clock else [])),
                        cost=cost + (SIMPLE if late else 0.0),
                        misfit=0.5 * float(match.misfit[index]) + force_misfit,
                        attitude=attitude,
                        gyro=gyro,
                        force=force,
                        gyro_lag=0.0 if late == "attitude" else own,
                        attitude_lag=own if late == "attitude" else 0.0,
                    )


def _forces(
    upright: Upright | None, read: Sequence[tuple[Array, Correction | None]], attitude: Array
) -> list[Force]:
    """The accelerometer as read, and in its best axes for an attitude."""
    if upright is None:
        return [(np.eye(3), None, 0.0)]
    misfit = 0.5 * upright.match(attitude)
    as_read, *others = [
        (axes, change, float(left)) for (axes, change), left in zip(read, misfit, strict=True)
    ]
    best = min(others, key=lambda force: force[2] + (force[1].cost if force[1] else 0.0))
    return [as_read, best]
