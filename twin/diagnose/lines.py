"""Frequencies at which what a model leaves stands out: where something may ring or push."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram
from scipy.stats import gamma

from twin.diagnose.explanation import Explanation

Array = NDArray[np.float64]

MOST = 3
"""Frequencies that are tried."""
FALSE_ALARM = 0.01
"""Chance that noise alone has a line."""
BROAD = 3.0
"""Of two frequencies closer than so many bins the weaker is a flank."""


def lines_of(found: Explanation) -> tuple[float, ...]:
    """The strongest lines beyond chance [Hz], of all streams and columns of each log together."""
    lines: list[tuple[float, float, Array, float]] = []
    for body, parts in zip(found.bodies, found.account.left, strict=True):
        for output, values in zip(body.outputs, parts, strict=True):
            # what a counter leaves repeats with its command, however small it is
            if len(values) < 8 or not output.scatters:
                continue
            rate = (len(output.time) - 1) / float(output.time[-1] - output.time[0])
            frequency, power = periodogram(values, rate, detrend="linear", axis=0)
            heights = power[1:].sum(axis=1) / np.maximum(np.median(power[1:].sum(axis=1)), 1e-300)
            # of white noise a bin of k columns is gamma with shape k, whose median is about k - 1/3
            k = values.shape[1]
            heights = heights * float(gamma.ppf(0.5, k))
            limit = float(gamma.isf(FALSE_ALARM / (len(heights) * len(parts)), k))
            out = np.flatnonzero(heights > limit)
            lines += [
                (float(heights[i]) / limit, float(frequency[1 + i]), values, rate) for i in out
            ]
    span = min(body.grid.length * body.grid.segments for body in found.bodies)
    chosen: list[float] = []
    for _, hertz, values, rate in sorted(lines, key=lambda line: -line[0]):
        if len(chosen) == MOST:
            break
        if all(abs(hertz - other) > BROAD / span for other in chosen):
            chosen.append(_between_bins(values, rate, hertz))
    return tuple(chosen)


def _between_bins(values: Array, rate: float, hertz: float) -> float:
    """Where near a bin (m, k) values are strongest: over a log, half a bin off is half a turn."""
    bin_width = rate / len(values)
    near = hertz + bin_width * np.linspace(-0.75, 0.75, 25)
    turns = np.exp(-2j * np.pi * np.outer(near, np.arange(len(values)) / rate))
    power = np.sum(np.square(np.abs(turns @ (values - values.mean(axis=0)))), axis=1)
    return float(near[np.argmax(power)])
