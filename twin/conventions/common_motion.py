"""A gyro and an attitude that have nothing to do with each other, in whatever way they are read."""

import numpy as np

from twin import rotation
from twin.conventions.euler import read_angles
from twin.conventions.finding import ConventionFinding, no_fit
from twin.conventions.turning import NEAR, Turning, far_lags
from twin.recording import Recording

COMMON = 0.5
"""Correlation above which gyro and attitude show the same motion."""
SPINNING = 1.0
"""No gyro has a bias as large as this [rad/s]."""
AMBIGUOUS = 1.0
"""A turn from sample to sample, or from cell to cell, up to which nothing is mistaken for the
shorter way round [rad]."""


def no_common_motion(recording: Recording, turning: Turning) -> ConventionFinding | None:
    """What to say where no reading of gyro and attitude fits; None where one may.

    Either the gyro turns throughout and the attitude does not, or both move clearly, and together
    at no lag, in no axes and in no direction.
    """
    spin, turn = _mean_rates(recording, turning)
    if max(spin, turn) / recording["attitude"].rate < AMBIGUOUS and abs(spin - turn) > SPINNING:
        means = f"{np.degrees(spin):.0f} and {np.degrees(turn):.0f} deg/s"
        return no_fit("gyro", f"gyro and attitude fits: they turn at {means} in the mean")
    fastest = float(np.linalg.norm(turning.gyro(0.0), axis=1).max())
    if fastest * turning.grid.cell > AMBIGUOUS:
        return None
    lags = np.concatenate([NEAR, far_lags(turning.grid.longest_lag)])
    for tried in (NEAR[::5], lags):
        shared = turning.correlation(tried)
        if shared is None or shared > COMMON:
            return None
    for change, series in read_angles(recording):
        other = None if change is None else turning.with_attitude(series).correlation(lags)
        if other is not None and other > COMMON:
            return None
    return no_fit("gyro", "gyro and attitude fits: both move, and not together")


def _mean_rates(recording: Recording, turning: Turning) -> tuple[float, float]:
    """Length of the mean rate [rad/s] of the gyro, and of the attitude: of body or world axes,
    whichever is nearer."""
    edges = turning.grid.edges
    attitude = recording["attitude"].between(float(edges[0]), float(edges[-1]))
    q, duration = attitude.value, float(attitude.time[-1] - attitude.time[0])
    step = rotation.to_rotation_vector(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]))
    spin = float(np.linalg.norm(turning.gyro(0.0).mean(axis=0)))
    turns = [
        float(np.linalg.norm(steps.sum(axis=0))) / duration
        for steps in (step, rotation.rotate(q[:-1], step))
    ]
    return spin, min(turns, key=lambda turn: abs(turn - spin))
