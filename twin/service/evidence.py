"""What was seen of a push: the turn of the body, and the actuator's own reading, as shares of what
was predicted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.service.push import OWN, Applied, own_gain, pushes, turned
from twin.service.sense import Motion, Sense, motion, rows, senses, shares, slid
from twin.service.session import MOVE, POSITION, Session
from twin.service.stages import in_mm, tolerance
from twin.signals import stream_named

Array = NDArray[np.float64]

LATE = 0.2
"""A stage's reading follows its move by no more [s]."""

_DULL = 0.1
"""With a share known so well (1 sigma), nothing seen means that nothing happened."""

Actuator = tuple[str, int]
"""Command stream and column."""


@dataclass(frozen=True)
class Evidence:
    """One prediction and what was seen of it."""

    predicted: str
    """In words."""
    where: str
    """The sensor."""
    share: Sense

    def words(self) -> str:
        """All of it."""
        told = f"predicted {self.predicted}, {self.where} showed {self.share.words()} of it"
        return told if self.share.seen else f"{told}, which does not tell the sign"

    @property
    def refused(self) -> str:
        """What is wrong; empty: nothing, or it cannot be told."""
        if self.share.seen:
            return "" if self.share.share > 0.0 else "it acts the wrong way round"
        return "it does nothing" if self.share.deviation < _DULL else ""


def body_evidence(session: Session, pushed: Sequence[Actuator], begun: float) -> Evidence | None:
    """What the gyro saw of the last of those that have pushed.

    Args:
        session: with all that was read and applied since before the first push.
        pushed: all of them, in their order: each has left its turn.
        begun: when the last one began [s].

    Returns:
        None where nothing is predicted, or too little was read.
    """
    platform = session.platform
    seen = motion(platform, session.readings)
    if seen is None:
        return None
    predicted = [_turn(session, seen, *each) for each in pushed]
    last = predicted[-1]
    if last is None or not np.any(last):
        return None
    known = [each for each in predicted if each is not None and np.any(each)]
    found = senses(platform, seen, known)
    return None if found is None else Evidence(_peak(seen, last, begun), "the gyro", found[-1])


def own_evidence(session: Session, stream: str, column: int) -> Evidence | None:
    """What the actuator shows itself; None where it shows nothing, or was told nothing."""
    platform, applied = session.platform, session.applied
    source = own_stream(stream)
    read = rows(session.readings, source) if source else None
    if read is None:
        return None
    times, values = read
    if stream == MOVE:
        told = _held(applied, times, column)
        part, most = platform.stages[column], in_mm(float(np.ptp(told)))
        # only where it has had the time to get there
        takes = float(np.ptp(told)) / part.speed + part.speed / part.acceleration
        there = told == _held(applied, times - takes - part.response - LATE, column)
        times, values, told = times[there], values[there], told[there]
        noise = float(tolerance(platform)[column])
    else:
        told = pushes(applied, times, stream, column)
        told = told * own_gain(platform, stream, column)
        sensor = platform.sensors[source]
        noise = float(np.max(sensor.noise)) + sensor.resolution
        unit = stream_named(source).unit
        most = f"{float(np.ptp(told)):.3g} {unit}"
    share = _fitted(times, values[:, column], told, max(noise, 1e-12))
    return None if share is None else Evidence(f"a change of {most}", source, share)


def own_stream(stream: str) -> str:
    """What shows what such an actuator does; empty: nothing does."""
    return POSITION if stream == MOVE else OWN.get(stream, "")


def _turn(session: Session, seen: Motion, stream: str, column: int) -> Array | None:
    platform = session.platform
    if stream == MOVE:
        return slid(platform, seen, column) if seen.places.size else None
    return turned(platform, session.readings, session.applied, seen, stream, column)


def _peak(seen: Motion, predicted: Array, begun: float) -> str:
    """The largest change of the rate since then, in words."""
    during = predicted[seen.times >= begun]
    change = during - during[0] if len(during) else predicted
    row, axis = np.unravel_index(int(np.argmax(np.abs(change))), change.shape)
    return f"a turn of {np.degrees(change[row, axis]):+.3g} deg/s about {'xyz'[int(axis)]}"


def _held(applied: Applied, times: Array, column: int) -> Array:
    """(m,) position [m] that a stage was told to hold at each time."""
    begun = np.array([time for time, _ in applied])
    told = np.array([command[MOVE][0, column] for _, command in applied])
    return told[np.maximum(np.searchsorted(begun, times, side="right") - 1, 0)]


def _fitted(times: Array, values: Array, told: Array, noise: float) -> Sense | None:
    """Share of `told` in values that also drift at a steady pace; None: nothing was told."""
    if np.ptp(told) == 0.0 or len(times) < 5:
        return None
    design = np.stack([np.ones_like(times), times - times[0], told], axis=1)
    return shares(design / noise, values / noise, len(times))[-1]
