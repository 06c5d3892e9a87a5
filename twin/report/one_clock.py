"""Streams that are all late by the same time: one clock is off, and not each of theirs."""

from collections.abc import Sequence

import numpy as np

from twin.diagnosis import Cause, Diagnosis
from twin.units import listed, printed

LAG = "clock_lag"


def one_clock_sentences(found: Diagnosis) -> list[str]:
    """Which clock it is, theirs or that of all else; nothing where the lags differ."""
    late = [cause for cause in found.causes if cause.effect.name == LAG]
    if len(late) < 2 or not _equal(late):
        return []
    streams = [cause.effect.target for cause in late]
    lag = float(np.mean([cause.effect.values[0] for cause in late]))
    others = sorted(_in_use(found) - set(streams))
    if not others:
        return []
    way, other = ("late", "early") if lag > 0.0 else ("early", "late")
    size = printed(abs(lag), "s")
    return [
        f"{listed(streams)} are {way} by the same time, {size}: rather than {len(streams)} clocks "
        f"it is one that is off, theirs, or that of {listed(others)}, {other} by {size}."
    ]


def _equal(late: Sequence[Cause]) -> bool:
    """Whether their intervals have a time in common."""
    lags = np.array([cause.effect.values[0] for cause in late])
    halves = np.array([cause.half_widths[0] for cause in late])
    return bool((lags - halves).max() <= (lags + halves).min())


def _in_use(found: Diagnosis) -> set[str]:
    """What the logs are predicted with, and what of, that changes: else no clock shows."""
    return {
        name
        for body in found.explained.bodies
        for name in (*body.inputs.used, *(output.stream for output in body.outputs))
        if name in body.recording and np.ptp(body.recording[name].value, axis=0).any()
    }
