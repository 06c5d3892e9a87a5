"""Whether a floating body answers its actuators as the platform predicts, while a law flies it.

The last seconds of a flight are fitted as those of a first use (`twin.service.sense`): which share
of what the commands of one channel should have turned the body by, the gyro shows. The mass moment
and a torque that is straight over a window are free in the fit, so that neither gravity nor a
steady draught is taken for an actuator. A share of minus one, again and again, is an actuator wired
the wrong way round: that ends the flight. One of zero is a dead actuator, or a law that works
against a draught: that is said.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Self

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench
from twin.plant.guard.guarded import GuardPhase
from twin.platform import Platform
from twin.service.first_use import Applied, turned
from twin.service.sense import ObservedShare, motion, senses, slid
from twin.service.session import MOVE
from twin.signals import Command, Reading, Tick

Array = NDArray[np.float64]

WINDOW = 15.0
"""Over which an answer is fitted [s]; one window after the other."""

WINDOWS = 3
"""So many in a row must say so."""

_EXPLAINED = 2.0
"""A window counts where its fit leaves no more than this, over the gyro's noise: else something
else moves the body."""

_KNOWN = 0.25
"""And where a share is known so well [1 sigma]."""

_APART = 3.0
"""Windows agree where each is so near to their mean [sigma]."""

_REVERSED = (-1.6, -0.5)
"""Shares between these act the wrong way round."""

_DEAD = (-0.25, 0.25)
"""Shares between these hardly act; or a law works against a draught, which looks the same."""


class AnswerRecord:
    """What the last windows say of one channel, together."""

    def __init__(self, stream: str) -> None:
        self._stream = stream
        self._shares = deque[ObservedShare](maxlen=WINDOWS)
        self.remark = ""
        """What may be wrong, but is no reason to stop, a sentence."""

    def add(self, share: ObservedShare) -> str:
        """Take one more window; what is wrong, a sentence, or nothing."""
        if share.misfit > _EXPLAINED or share.deviation > _KNOWN:
            self._shares.clear()
            return ""
        self._shares.append(share)
        if len(self._shares) < WINDOWS:
            return ""
        weight = np.array([item.deviation for item in self._shares]) ** -2.0
        mean = float(weight @ [item.share for item in self._shares] / weight.sum())
        if any(abs(item.share - mean) > _APART * item.deviation for item in self._shares):
            return ""
        words = ObservedShare(mean, float(weight.sum() ** -0.5)).words()
        shown = f"in {WINDOW * WINDOWS:g} s the gyro showed {words} of the turn that is predicted"
        if all(_REVERSED[0] < item.share < _REVERSED[1] for item in self._shares):
            return f"{self._stream} acts the wrong way round: {shown}"
        if all(_DEAD[0] < item.share < _DEAD[1] for item in self._shares):
            self.remark = f"{self._stream} does nothing, or works against a torque: {shown}"
        return ""


def answers(
    platform: Platform, readings: Sequence[Reading], applied: Applied
) -> Mapping[str, ObservedShare]:
    """Command stream -> what the body showed of it; of what it cannot have shown, nothing.

    Args:
        platform: a floating ball with a gyro and a sensor of the vertical.
        readings: of some seconds.
        applied: what was applied in them.
    """
    seen = motion(platform, readings)
    if seen is None or not np.isfinite(seen.rate).all():
        return {}
    predicted: dict[str, Array] = {}
    for stream, width in platform.commands.items():
        each = [
            (slid(platform, seen, column) if seen.places.size else None)
            if stream == MOVE
            else turned(platform, readings, applied, seen, stream, column)
            for column in range(width)
        ]
        known = [item for item in each if item is not None]
        total = np.sum(known, axis=0) if known else np.zeros(1)
        if np.any(total) and np.isfinite(total).all():
            predicted[stream] = total
    shares = senses(platform, seen, list(predicted.values()), knots=WINDOW) if predicted else None
    if shares is None:
        return {}
    return dict(zip(predicted, shares, strict=True))


class BodyAnswer:
    """Observer of an armed flight that stops it when the body does not answer a channel."""

    def __init__(self, bench: Bench) -> None:
        """Nothing has been seen."""
        self._bench, self._platform = bench, bench.platform
        self._ticks = deque[tuple[Reading, Command]]()
        self._next = WINDOW
        self._records = {stream: AnswerRecord(stream) for stream in self._platform.commands}
        self._pool = ThreadPoolExecutor(1, "answer")
        self._fit: Future[Mapping[str, ObservedShare]] | None = None
        self._able = self._platform.base.kind == "ball" and "gyro" in self._platform.sensors

    def collect(self, tick: Tick) -> None:
        """One tick."""
        guard, now = self._bench.guard, tick.reading.time
        if not self._able or guard.phase is not GuardPhase.armed or not guard.floating:
            return
        self._ticks.append((tick.reading, tick.applied))
        while self._ticks[0][0].time < now - WINDOW:
            self._ticks.popleft()
        if self._fit is not None and self._fit.done():
            self._judge(self._fit.result())
            self._fit = None
        if now >= self._next and self._fit is None:
            self._next = now + WINDOW
            readings = [reading for reading, _ in self._ticks]
            applied = [(reading.time, command) for reading, command in self._ticks]
            if self._bench.in_lockstep:
                self._judge(answers(self._platform, readings, applied))
            else:
                self._fit = self._pool.submit(answers, self._platform, readings, applied)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *ended: object) -> None:
        """No fit is waited for."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _judge(self, shares: Mapping[str, ObservedShare]) -> None:
        for stream, share in shares.items():
            record = self._records[stream]
            if wrong := record.add(share):
                self._bench.stop(wrong)
            elif record.remark:
                self._bench.remark(record.remark)
                record.remark = ""
