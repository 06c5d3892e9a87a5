"""Detection of pushes from outside: a hand, a cable that catches, a door.

A push acts once, for a moment, and is no property of the machine; a fit that includes it names
false causes. The logs are predicted in independent segments, each weighted by its own scatter, so
that a push affects one segment only. Within that segment, the push is the interval for which one
motion fits the samples before it and another one those after it. A push at the boundary of two
segments may be invisible in both, so the logs are also cut half a segment later."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.explanation import Explanation
from twin.errors import TwinError
from twin.platform import Platform
from twin.predict.independent_segments import IndependentSegments
from twin.recording import Recording
from twin.recording.pauses import SHORTEST, part_of

Array = NDArray[np.float64]

SPOILED = 1.5
"""Mean squared residual of a pushed segment, relative to the usual one, at least."""
SIGMAS = 8.0
"""Standard deviations by which it must exceed noise."""
MOST = 3
"""Pushes of all logs, at most: what acts more often is no push."""
SHARE = 0.2
"""Share of all time that pushes last, at most."""
LOST = 2.0
"""Usual mean squared residual above which the model fits no segment."""
TRIES = 6
"""Iterations: one push may take two."""
NEAR = 1.0
"""Time between two pushes that count as one [s]."""
FEW = 4
"""Number of segments up to which one push may bias the base of all."""
LASTS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Durations of a push that are tried [s]."""
STEP = 0.05
"""Step of its start [s]."""
MARGIN = 0.1
"""Time that is also excluded before and after [s]."""
SHOWN = 1e-10
"""Share of the largest singular value below which a direction of a state is not fitted."""
WORTH = 3.0
"""Squared residual of a sample above which it is better excluded."""


@dataclass(frozen=True)
class PushInterval:
    """Interval of a push; its samples are excluded."""

    log: int
    """Number of the log."""
    source: str
    """Name of the log."""
    start: float
    """[s]."""
    stop: float


def pushes_of(logs: Sequence[Recording], platform: Platform) -> tuple[PushInterval, ...]:
    """Pushes without which logs follow the model; none where they do not.

    The residual of a segment is compared with that of all segments; of a few segments, whose common
    base a push biases, it is compared with noise.
    """
    try:
        whole = list(_looks(list(enumerate(logs)), platform))
    except TwinError:  # there is too little
        return ()
    return _beyond(_usual, whole, logs, platform) or _beyond(_noise, whole, logs, platform)


def _beyond(
    usual: Callable[[Explanation], float],
    whole: Sequence[tuple[list[int], Explanation]],
    logs: Sequence[Recording],
    platform: Platform,
) -> tuple[PushInterval, ...]:
    """Exclude the largest push and fit again, until no segment exceeds the limit."""
    pushes: list[PushInterval] = []
    for _ in range(TRIES):
        try:
            seen = list(_looks(_parts(pushes, logs), platform)) if pushes else whole
        except TwinError:  # too little is left
            break
        # in a short log, one push between two segments affects half of all segments
        if min(usual(segments) for _, segments in seen) > LOST:
            break
        looks = [
            (_worst(segments, usual(segments)), of_logs, segments) for of_logs, segments in seen
        ]
        # where no segment is near noise, the push has led the base astray, and any may be the worst
        worst, of_logs, segments = max(
            looks, key=lambda look: look[0].excess / float(_scatter(look[2]).min())
        )
        if worst.excess <= 1.0:
            return tuple(pushes)
        log = of_logs[worst.place]
        start, stop = _span(segments, worst)
        within = max(start, logs[log].start), min(stop, logs[log].stop)
        pushes = _merged([*pushes, PushInterval(log, logs[log].source, *within)])
        left_out = sum(push.stop - push.start for push in pushes)
        if len(pushes) > MOST or left_out > SHARE * sum(log.stop - log.start for log in logs):
            break
    return ()


def pushed_look(logs: Sequence[Recording], platform: Platform) -> Explanation | None:
    """The segmentation of whole logs in which a push is largest; None where there is none."""
    looks = [segments for _, segments in _looks(list(enumerate(logs)), platform)]
    best = max(looks, key=_excess)
    return best if pushed(best) else None


def but_for(pushes: Sequence[PushInterval], logs: Sequence[Recording]) -> list[Recording]:
    """Parts of logs between their pushes that are long enough to be logs."""
    return [part for _, part in _parts(pushes, logs)]


def _parts(
    pushes: Sequence[PushInterval], logs: Sequence[Recording]
) -> list[tuple[int, Recording]]:
    """Each part with the number of its log."""
    result: list[tuple[int, Recording]] = []
    for log, recording in enumerate(logs):
        own = [push for push in pushes if push.log == log]
        starts = [recording.start, *(push.stop for push in own)]
        stops = [*(push.start for push in own), recording.stop]
        result += [
            (log, part_of(recording, start, stop) if own else recording)
            for start, stop in zip(starts, stops, strict=True)
            if stop - start >= SHORTEST or not own
        ]
    return result


def _looks(
    parts: Sequence[tuple[int, Recording]], platform: Platform
) -> Iterator[tuple[list[int], Explanation]]:
    """Two segmentations of parts of logs, with the numbers of their logs: from their starts, and
    from the middle of their first segments."""
    segments = baseline_of([part for _, part in parts], platform, follows=False)
    yield [log for log, _ in parts], segments
    later = [
        (log, part, part.start + 0.5 * body.grid.length)
        for (log, part), body in zip(parts, segments.bodies, strict=True)
    ]
    later = [item for item in later if item[1].stop - item[2] >= SHORTEST]
    if later:
        cut = [part_of(part, start, part.stop) for _, part, start in later]
        with suppress(TwinError):  # too little is left for a second look
            yield [log for log, _, _ in later], baseline_of(cut, platform, follows=False)


def pushed(segments: Explanation) -> bool:
    """Whether a segment contains a push."""
    return _excess(segments) > 1.0


def _excess(segments: Explanation) -> float:
    """Residual of the worst segment, relative to the limit."""
    return max(_worst(segments, usual(segments)).excess for usual in (_usual, _noise))


@dataclass(frozen=True)
class _Worst:
    """The segment of the largest residual."""

    place: int
    """Number of its log."""
    segment: int
    excess: float
    """Residual relative to the limit."""


def _worst(segments: Explanation, usual: float) -> _Worst:
    assert isinstance(segments.prediction, IndependentSegments)
    places = [
        (log, s) for log, body in enumerate(segments.bodies) for s in range(body.grid.segments)
    ]
    few = 2.0 / np.maximum(segments.prediction.counts, 1.0)
    limit = usual * np.maximum(SPOILED, 1.0 + SIGMAS * np.sqrt(few))
    excess = _scatter(segments) / limit
    worst = int(np.argmax(excess))
    return _Worst(*places[worst], float(excess[worst]))


def _usual(segments: Explanation) -> float:
    return float(np.median(_scatter(segments)))


def _noise(segments: Explanation) -> float:
    """Usual residual of a right model; infinite where there are enough segments for a median."""
    return 1.0 if len(_scatter(segments)) <= FEW else np.inf


def _scatter(segments: Explanation) -> Array:
    """(segments,) mean squared residual, at least 1, of all logs."""
    assert isinstance(segments.prediction, IndependentSegments)
    return 1.0 / segments.prediction.weights


def _span(segments: Explanation, at: _Worst) -> tuple[float, float]:
    """Interval of a segment whose exclusion leaves the smallest residual to one motion before and
    another one after it."""
    body = segments.bodies[at.place]
    begin = float(body.grid.starts[at.segment])
    end = begin + body.grid.length
    time, rows = _rows_of(segments, at.place, at.segment)
    squares = np.cumsum(np.einsum("ni,nj->nij", rows, rows), axis=0)
    squares = np.concatenate([np.zeros_like(squares[:1]), squares])
    lasts, starts = np.meshgrid(LASTS, np.arange(begin - 0.5 * LASTS[-1], end, STEP))
    inside = (starts + 0.5 * lasts > begin) & (starts + 0.5 * lasts < end)
    starts, stops = starts[inside], (starts + lasts)[inside]
    first, last = np.searchsorted(time, starts), np.searchsorted(time, stops, side="right")
    before, after = squares[first], squares[-1] - squares[last]
    cost = _left(before) + _left(after) + WORTH * (last - first)
    best = int(np.argmin(cost))
    return float(starts[best]) - MARGIN, float(stops[best]) + MARGIN


def _rows_of(segments: Explanation, log: int, segment: int) -> tuple[Array, Array]:
    """Times (n,) of a segment's samples, and (n, x + 1) their columns of the initial state and
    their residual."""
    body, state = segments.bodies[log], segments.prediction.exact[log].linear.state
    size = np.maximum(np.linalg.norm(state, axis=1, keepdims=True), 1e-300)
    columns = [body.cells.gather(column) for column in np.moveaxis(state / size, -1, 0)]
    times: list[Array] = []
    rows: list[Array] = []
    for place, (output, left) in enumerate(
        zip(body.outputs, segments.account.left[log], strict=True)
    ):
        own = output.segment == segment
        if output.scatters and own.any():
            parts = [*(column[place][own] for column in columns), left[own]]
            times.append(np.repeat(output.time[own], left.shape[1]))
            rows.append(np.stack([part.ravel() for part in parts], axis=1))
    time, every = np.concatenate(times), np.concatenate(rows)
    order = np.argsort(time, kind="stable")
    return time[order], every[order]


def _left(squares: Array) -> Array:
    """(w,) least-squares residual of (w, x + 1, x + 1) products of columns and residual."""
    inverse = np.linalg.pinv(squares[:, :-1, :-1], rcond=SHOWN, hermitian=True)
    across = squares[:, :-1, -1]
    return squares[:, -1, -1] - np.einsum("wi,wij,wj->w", across, inverse, across)


def _merged(pushes: list[PushInterval]) -> list[PushInterval]:
    """Pushes with those that overlap, or nearly so, joined."""
    intervals: list[PushInterval] = []
    for push in sorted(pushes, key=lambda item: (item.log, item.start)):
        last = intervals[-1] if intervals else None
        if last and last.log == push.log and push.start <= last.stop + NEAR:
            intervals[-1] = replace(last, stop=max(last.stop, push.stop))
        else:
            intervals.append(push)
    return intervals
