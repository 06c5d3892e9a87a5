"""Tests of an explanation's residual: unknown torques, spectral lines, and prediction of held-out
time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import compress

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram
from scipy.stats import chi2, gamma, norm

from twin.diagnosis.explanation import Explanation, WhitenedRows
from twin.diagnosis.screen import LinearScreen, Trace
from twin.identification.prediction_error import NORMAL
from twin.predict.body import Body
from twin.predict.forces import Perturbation, middles, on_grid

Array = NDArray[np.float64]
PIECE = 2.5
"""Width of a basis function of the unknown torque [s]."""
MOST = 60
"""Basis functions of a log, at most; those of longer logs are wider."""
DOUBTFUL = 0.01
"""Probability of a residual below which the search goes on."""
LINES = 3
"""Spectral lines, at most."""
FALSE_ALARM = 0.01
"""Probability of a line in noise."""
SPACING = 0.25
"""Spacing of low frequencies, in cycles over the log."""
BROAD = 3.0
"""Bins within which the weaker of two lines belongs to the stronger."""
BLOCKS = 5
FLOOR = 1e-10
"""Share of the largest singular value below which the other blocks do not determine a direction: it
is not fitted."""


@dataclass(frozen=True)
class ResidualTest:
    """Residual of an explanation, tested against noise."""

    torque_gain: float
    """Fall of -2 log L by an unknown torque."""
    freedom: float
    """Degrees of freedom of that gain."""
    torque_chance: float
    """Probability that noise gains as much."""
    noise_chance: float
    """Probability that noise leaves as large a residual in any column."""
    where: str
    """Stream and column of the largest residual."""
    chi2: float
    """Mean squared residual of all columns, in units of the noise."""
    lines: tuple[float, ...]
    """Significant spectral lines of the residual [Hz]. What rings in a few bins hardly changes the
    mean squares."""

    @property
    def chance(self) -> float:
        """Probability of the rarer of both in noise."""
        return min(1.0, 2.0 * min(self.torque_chance, self.noise_chance))

    @property
    def doubtful(self) -> bool:
        """Whether the residual may be more than noise, so that a search goes on."""
        return self.chance < DOUBTFUL or bool(self.lines)


def residual_test(explanation: Explanation) -> ResidualTest:
    """Test the residual of an explanation."""
    pieces = [piece for body in explanation.bodies for piece in torque_pieces_of(body)]
    own = len(explanation.own)
    screen = beside(explanation, pieces)
    gain, freedom = screen.beyond(explanation.own, range(own, own + len(pieces)))
    parts = explanation.account.misfits
    worst = max(parts, key=lambda part: part.sigmas)
    single = float(norm.sf(worst.sigmas))
    return ResidualTest(
        gain,
        freedom,
        float(chi2.sf(gain, freedom)),
        float(-np.expm1(len(parts) * np.log1p(-min(single, 1.0 - 1e-16)))),
        f"{worst.stream} {worst.column}",
        float(np.average([part.chi2 for part in parts], weights=[part.samples for part in parts])),
        lines_of(explanation),
    )


def beside(explanation: Explanation, pieces: Sequence[Perturbation]) -> LinearScreen:
    """Linear screen of an explanation's own causes, then of basis functions of any size."""
    free = np.full(1, np.inf)
    traces = [Trace(piece.name, -free, free) for piece in pieces]
    return explanation.weigh([(piece,) for piece in pieces], traces)


def knots_of(body: Body) -> Array:
    """Peaks of a log's basis functions [s]."""
    begin, end = float(body.motion.time[0]), float(body.motion.time[-1])
    return np.linspace(begin, end, int(np.clip((end - begin) / PIECE, 2, MOST)))


@lru_cache(maxsize=8)
def torque_pieces_of(body: Body) -> tuple[Perturbation, ...]:
    """Triangular basis functions of an unknown torque over one log, about each axis of the base."""
    knots = knots_of(body)
    dofs = range(body.machine.base_dof.start, body.machine.base_dof.stop)
    return tuple(_piece(body, knots, place, dof) for dof in dofs for place in range(len(knots)))


def _piece(own: Body, knots: Array, place: int, dof: int) -> Perturbation:
    def force(body: Body) -> Array:
        torque = np.zeros((body.grid.segments * body.grid.steps, body.machine.model.nv))
        if body.recording is own.recording:
            hat = np.zeros(len(knots))
            hat[place] = 1.0
            torque[:, dof] = np.interp(middles(body), knots, hat)
        return on_grid(torque, body)

    return Perturbation(f"piece {place} of {dof}", "N m", force=force)


def lines_of(explanation: Explanation) -> tuple[float, ...]:
    """The strongest significant spectral lines of the residual [Hz], over all streams of all
    logs."""
    lines: list[tuple[float, float, Array, float]] = []
    for body, parts in zip(explanation.bodies, explanation.account.left, strict=True):
        for output, values in zip(body.outputs, parts, strict=True):
            # the residual of a counter is periodic with its command
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
    span = min(body.grid.length * body.grid.segments for body in explanation.bodies)
    chosen: list[float] = []
    for _, hertz, values, rate in sorted(lines, key=lambda line: -line[0]):
        if len(chosen) == LINES:
            break
        if all(abs(hertz - other) > BROAD / span for other in chosen):
            chosen.append(_between_bins(values, rate, hertz))
    return tuple(chosen)


def slow_line_of(explanation: Explanation) -> tuple[float, ...]:
    """Frequency of the periodic torque of the largest gain [Hz], if it is significant.

    The state at the start of each segment is free, so that a torque slower than a segment leaves no
    line in the residual. Its gain follows from that of the basis functions.
    """
    best, asked = (0.0, 0.0), 0
    for body in explanation.bodies:
        pieces, knots = torque_pieces_of(body), knots_of(body)
        screen, own = beside(explanation, pieces), len(explanation.own)
        kept = np.stack([screen.signature(own + i, np.ones(1)) for i in range(len(pieces))])
        left, span = screen.left(explanation.own), knots[-1] - knots[0]
        for hertz in np.arange(1.0, 0.5 * (len(knots) - 1), SPACING) / span:
            turns = 2.0 * np.pi * hertz * (knots - knots[0])
            followed = np.stack([np.sin(turns), np.cos(turns)]) @ kept.reshape(
                -1, len(knots), kept.shape[1]
            )
            directions = np.linalg.qr(followed.reshape(-1, kept.shape[1]).T)[0]
            gain = float(np.sum(np.square(directions.T @ left)))
            best = min(best, (float(chi2.logsf(gain, directions.shape[1])), float(hertz)))
            asked += 1
    surprise, hertz = best
    # a log of a few seconds holds no turn of what is slow
    return (hertz,) if asked and surprise + np.log(asked) < np.log(FALSE_ALARM) else ()


def _between_bins(values: Array, rate: float, hertz: float) -> float:
    """Frequency near a bin at which (m, k) values are strongest."""
    bin_width = rate / len(values)
    near = hertz + bin_width * np.linspace(-0.75, 0.75, 25)
    turns = np.exp(-2j * np.pi * np.outer(near, np.arange(len(values)) / rate))
    power = np.sum(np.square(np.abs(turns @ (values - values.mean(axis=0)))), axis=1)
    return float(near[np.argmax(power)])


@dataclass(frozen=True)
class HeldOut:
    """Prediction of held-out blocks of time; NaN where each log has one segment only."""

    log_likelihood: float
    """Gain of log-likelihood by the causes."""
    before: float
    """Chi-square a sample without the causes."""
    after: float
    low: float
    high: float
    """Bounds of the 95 % band of a true model."""


def held_out(result: Explanation) -> HeldOut:
    """Predict each block of segments from a fit of the others, with and without the causes."""
    explanation, (bare, _) = result.rows, result.without()
    cut = [body.grid.segments > 1 for body in result.bodies]
    bodies = list(compress(result.bodies, cut))
    block = np.concatenate([_blocks(body.grid.segments) for body in result.bodies])
    (before, open_before), (after, open_after) = (
        _missed(block, item) for item in (bare, explanation)
    )
    samples = sum(body.samples for body in bodies)
    spread = sum(
        2.0
        * output.slot.size
        * (1.0 if output.stated else float(np.mean(1.0 / output.worth - 1.0)))
        for body in bodies
        for output in body.outputs
        if output.scatters
    )
    half = NORMAL * float(np.sqrt(spread)) / samples if samples else np.nan
    states = sum(start.width for start in compress(result.at.starts, cut))
    free = max(samples - states, 1)
    return HeldOut(
        0.5 * (before + open_before - after - open_after),
        before / free,
        after / free,
        1.0 - half,
        1.0 + half,
    )


def _blocks(segments: int) -> NDArray[np.intp]:
    """(segments,) block of each segment of a log; -1 of a log of one segment."""
    if segments < 2:
        return np.full(segments, -1)
    return np.arange(segments) * min(BLOCKS, segments) // segments


def _missed(block: NDArray[np.intp], rows: WhitenedRows) -> tuple[float, float]:
    """Chi-square and log-determinant of all blocks (segments,), each predicted by what the others
    fit.

    A block's residual has the covariance I + D D^T, D its columns times a root of the covariance
    that the others leave; both are had from I + D^T D (Woodbury), which is small.
    """
    if block.max(initial=-1) < 0:
        return np.nan, np.nan
    size = np.maximum(np.linalg.norm(rows.columns, axis=0), 1e-300)
    columns = rows.columns / size
    of_rows = np.where(rows.cluster < 0, -1, block[rows.cluster])
    chi2, logarithm = 0.0, 0.0
    for b in range(block.max() + 1):
        out = of_rows == b
        u, singular, v = np.linalg.svd(columns[~out], full_matrices=False)
        kept = singular > FLOOR * singular.max(initial=0.0)
        open_by = v[kept].T / singular[kept]
        left = rows.residual[out] - columns[out] @ (open_by @ (u.T @ rows.residual[~out])[kept])
        doubt = columns[out] @ open_by
        spread = np.eye(doubt.shape[1]) + doubt.T @ doubt
        among = doubt.T @ left
        chi2 += float(left @ left - among @ np.linalg.solve(spread, among))
        logarithm += float(np.linalg.slogdet(spread)[1])
    return chi2, logarithm
