"""Where a mass was that was only seen, and how fast: a rate that adds up to where it rested."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from twin.platform import Sensor
from twin.predict.motion import smoothed_series
from twin.recording import Series

Array = NDArray[np.float64]


def travelled(series: Series, sensor: Sensor | None, time: Array) -> tuple[Series, Series]:
    """A position, smoothed where that takes no more than noise away, and its rate.

    A mass that stays 1 um off after a move turns a table, so the position is what the rate's
    trapezoids add up to: where the mass rests, that of the data, since what trapezoids of equal
    length leave of a spline is a change of its second derivative (Euler and Maclaurin).

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
    slope = CubicSpline(place.time, place.value, bc_type="natural")(time, 1)
    slope[(time < place.time[0]) | (time > place.time[-1])] = 0.0
    travel = cumulative_trapezoid(slope, time, axis=0, initial=0.0)
    rate = Series(time, slope, place.columns, f"{place.unit}/s")
    # the readings may begin within a move
    away = place.value - Series(time, travel, place.columns, place.unit).interpolated_at(place.time)
    return replace(place, time=time, value=travel + np.median(away, axis=0)), rate
