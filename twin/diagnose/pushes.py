"""Pushes from outside: a hand, a cable that caught, a door. Each acts once, for a moment, and says
nothing of the machine; what it does to a fit looks like causes that are none.

The logs are predicted in segments, each from a start of its own and by its own scatter, so that a
push spoils the segment that it falls into and no other. There it lies where one motion of the
machine fits what was read before, another one what was read after, and none both. One that falls
between two segments may spoil neither enough to be seen, and half of all in a short log: so logs
are looked at once more, cut half a segment later.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.baseline import baseline_of
from twin.diagnose.explanation import Explanation
from twin.errors import TwinError
from twin.platform import Platform
from twin.predict.independent_segments import IndependentSegments
from twin.recording import Recording
from twin.recording.pauses import SHORTEST, part_of

Array = NDArray[np.float64]

SPOILED = 1.5
"""Times the usual mean squared residual from where on a segment may have been pushed."""
SIGMAS = 8.0
"""By which that must be more than noise."""
MOST = 3
"""Pushes of all logs; what acts oftener is at work all the time."""
SHARE = 0.2
"""Of all time, likewise."""
LOST = 2.0
"""Usual mean squared residual beyond which the model is not this machine's at any time."""
TRIES = 6
"""Times that the next one is looked for: one may take two, the second beside the first."""
NEAR = 1.0
"""Between two that are one [s]."""
FEW = 4
"""Segments of all logs, so many that one push may bend the base for all."""
LASTS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""How long a push may be, its ends included [s]."""
STEP = 0.05
"""By which its middle is sought [s]."""
MARGIN = 0.1
"""Left out besides, before and after [s]."""
SHOWN = 1e-10
"""Directions of a state that show less than this share of the best one are not fitted."""
WORTH = 3.0
"""Residual that a number must save, in units of its variance, to be left out."""


@dataclass(frozen=True)
class Push:
    """When it was; nothing of the log is used from start to stop."""

    log: int
    """Which one."""
    source: str
    """Its name."""
    start: float
    """[s]."""
    stop: float


def pushes_of(logs: Sequence[Recording], platform: Platform) -> tuple[Push, ...]:
    """When logs were pushed, if that so few times left out they follow the model; else none.

    A segment is held against what is usual for all; where there are so few that a push bends the
    base for all of them, and so what is usual, against noise.
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
) -> tuple[Push, ...]:
    """The worst push first: the base that is fitted beside it is bent, and so is what it leaves of
    the others."""
    pushes: list[Push] = []
    for _ in range(TRIES):
        try:
            seen = list(_looks(_parts(pushes, logs), platform)) if pushes else whole
        except TwinError:  # too little is left
            break
        # a push between two segments of a short log may spoil half of all in one look
        if min(usual(segments) for _, segments in seen) > LOST:
            break
        looks = [
            (_worst(segments, usual(segments)), of_logs, segments) for of_logs, segments in seen
        ]
        worst, of_logs, segments = max(looks, key=lambda look: look[0].excess)
        if worst.excess <= 1.0:
            return tuple(pushes)
        log = of_logs[worst.place]
        start, stop = _span(segments, worst)
        within = max(start, logs[log].start), min(stop, logs[log].stop)
        pushes = _merged([*pushes, Push(log, logs[log].source, *within)])
        left_out = sum(push.stop - push.start for push in pushes)
        if len(pushes) > MOST or left_out > SHARE * sum(log.stop - log.start for log in logs):
            break
    return ()


def pushed_look(logs: Sequence[Recording], platform: Platform) -> Explanation | None:
    """The look at whole logs that shows one best; None where neither does."""
    looks = [segments for _, segments in _looks(list(enumerate(logs)), platform)]
    best = max(looks, key=_excess)
    return best if pushed(best) else None


def but_for(pushes: Sequence[Push], logs: Sequence[Recording]) -> list[Recording]:
    """The parts of logs between their pushes, but those too short to be logs."""
    return [part for _, part in _parts(pushes, logs)]


def _parts(pushes: Sequence[Push], logs: Sequence[Recording]) -> list[tuple[int, Recording]]:
    """Each with the log that it is of."""
    found: list[tuple[int, Recording]] = []
    for log, recording in enumerate(logs):
        own = [push for push in pushes if push.log == log]
        starts = [recording.start, *(push.stop for push in own)]
        stops = [*(push.start for push in own), recording.stop]
        found += [
            (log, part_of(recording, start, stop) if own else recording)
            for start, stop in zip(starts, stops, strict=True)
            if stop - start >= SHORTEST or not own
        ]
    return found


def _looks(
    parts: Sequence[tuple[int, Recording]], platform: Platform
) -> Iterator[tuple[list[int], Explanation]]:
    """Parts of logs predicted in segments apart, and which logs they are of: from their starts, and
    from the middle of their first segments on."""
    segments = baseline_of([part for _, part in parts], platform, follows=False)
    yield [log for log, _ in parts], segments
    later = [
        (log, part, part.start + 0.5 * body.grid.length)
        for (log, part), body in zip(parts, segments.bodies, strict=True)
    ]
    later = [one for one in later if one[1].stop - one[2] >= SHORTEST]
    if later:
        cut = [part_of(part, start, part.stop) for _, part, start in later]
        with suppress(TwinError):  # too little is left for a second look
            yield [log for log, _, _ in later], baseline_of(cut, platform, follows=False)


def pushed(segments: Explanation) -> bool:
    """Whether a segment does not follow the model as the others do."""
    return _excess(segments) > 1.0


def _excess(segments: Explanation) -> float:
    """Of the worst segment, over what is usual by either reckoning."""
    return max(_worst(segments, usual(segments)).excess for usual in (_usual, _noise))


@dataclass(frozen=True)
class _Worst:
    """The segment that follows the model least."""

    place: int
    """Of its log among those that are explained."""
    segment: int
    excess: float
    """Its scatter over that which noise and the usual one allow."""


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
    """What is usual if nothing is wrong but a push; infinite where the others tell it better."""
    return 1.0 if len(_scatter(segments)) <= FEW else np.inf


def _scatter(segments: Explanation) -> Array:
    """(segments,) of all logs: mean squared residual, at least 1."""
    assert isinstance(segments.prediction, IndependentSegments)
    return 1.0 / segments.prediction.weights


def _span(segments: Explanation, at: _Worst) -> tuple[float, float]:
    """Which time of a segment, left out, leaves least to a motion before and another one after."""
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
    """Of a segment the times (n,), and (n, x + 1): what the states that it starts from do to each
    number that was read, and what is left of that."""
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
    """Of (w, x + 1, x + 1) products of columns and of what is left (w,) the least squares."""
    inverse = np.linalg.pinv(squares[:, :-1, :-1], rcond=SHOWN, hermitian=True)
    across = squares[:, :-1, -1]
    return squares[:, -1, -1] - np.einsum("wi,wij,wj->w", across, inverse, across)


def _merged(pushes: list[Push]) -> list[Push]:
    """Those that overlap, or nearly so, are one."""
    found: list[Push] = []
    for push in sorted(pushes, key=lambda one: (one.log, one.start)):
        last = found[-1] if found else None
        if last and last.log == push.log and push.start <= last.stop + NEAR:
            found[-1] = replace(last, stop=max(last.stop, push.stop))
        else:
            found.append(push)
    return found
