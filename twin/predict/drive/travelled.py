"""Where a mass was that was only seen, and how fast: a rate that adds up to where it rested."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from twin.platform import Sensor
from twin.predict.log.motion import smoothed_series
from twin.recording import Series

Array = NDArray[np.float64]


def travelled(series: Series, sensor: Sensor | None, time: Array) -> tuple[Series, Series]:
    """A position, smoothed where that takes no more than noise away, and its rate.

    A mass that stays 1 um off after a move turns a table, so the rate's trapezoids add up to the
    position: both are had from a spline half a step before and half a step after, of which the sums
    leave no more than the ends.

    Args:
        series: readings, their stamps as they come.
        sensor: that took them.
        time: (m,) at which both are given, a physics step apart [s].
    """
    smooth = smoothed_series(series)[0]
    lost = np.sqrt(np.mean(np.square(series.value - smooth.interpolated_at(series.time)), axis=0))
    # A counter's noise cannot be told from its moves: that of a command is none.
    noise = 0.0 if sensor is None else np.hypot(sensor.noise, sensor.resolution / np.sqrt(12.0))
    place = smooth if np.all(lost <= 3.0 * noise) else series
    spline = CubicSpline(place.time, place.value, bc_type="natural")
    step = float(time[1] - time[0])
    edges = np.append(time - 0.5 * step, time[-1] + 0.5 * step)
    there = spline(np.clip(edges, place.time[0], place.time[-1]))
    value, rate = 0.5 * (there[1:] + there[:-1]), np.diff(there, axis=0) / step
    return (
        Series(time, value, place.columns, place.unit),
        Series(time, rate, place.columns, f"{place.unit}/s"),
    )
