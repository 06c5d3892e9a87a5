"""Frequencies at which what a model leaves stands out: where something may ring or push."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram
from scipy.stats import chi2, gamma

from twin.diagnose.explanation import Explanation
from twin.diagnose.remainder import beside, knots_of, torque_pieces_of

Array = NDArray[np.float64]

MOST = 3
"""Frequencies that are tried."""
FALSE_ALARM = 0.01
"""Chance that noise alone has a line."""
SPACING = 0.25
"""Of slow frequencies that are asked for, in turns over the log."""
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


def slow_line_of(found: Explanation) -> tuple[float, ...]:
    """The frequency at which a torque on the base gains most [Hz], if that is beyond chance.

    What a segment begins with is free, so that a torque slower than a segment leaves no line in
    what is measured. Here pieces of torque are made to follow it, and weighed as they do.
    """
    best, asked = (0.0, 0.0), 0
    for body in found.bodies:
        pieces, knots = torque_pieces_of(body), knots_of(body)
        weighing, own = beside(found, pieces), len(found.own)
        shown = np.stack([weighing.signature(own + i, np.ones(1)) for i in range(len(pieces))])
        left, span = weighing.left(found.own), knots[-1] - knots[0]
        for hertz in np.arange(1.0, 0.5 * (len(knots) - 1), SPACING) / span:
            turns = 2.0 * np.pi * hertz * (knots - knots[0])
            followed = np.stack([np.sin(turns), np.cos(turns)]) @ shown.reshape(
                -1, len(knots), shown.shape[1]
            )
            directions = np.linalg.qr(followed.reshape(-1, shown.shape[1]).T)[0]
            gain = float(np.sum(np.square(directions.T @ left)))
            best = min(best, (float(chi2.logsf(gain, directions.shape[1])), float(hertz)))
            asked += 1
    surprise, hertz = best
    # a log of a few seconds holds no turn of what is slow
    return (hertz,) if asked and surprise + np.log(asked) < np.log(FALSE_ALARM) else ()


def _between_bins(values: Array, rate: float, hertz: float) -> float:
    """Where near a bin (m, k) values are strongest: over a log, half a bin off is half a turn."""
    bin_width = rate / len(values)
    near = hertz + bin_width * np.linspace(-0.75, 0.75, 25)
    turns = np.exp(-2j * np.pi * np.outer(near, np.arange(len(values)) / rate))
    power = np.sum(np.square(np.abs(turns @ (values - values.mean(axis=0)))), axis=1)
    return float(near[np.argmax(power)])
