"""Before a campaign: how many runs, how long, how much disk; measured on a short probe."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from twin.campaigns.distribution import Fixed
from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.rows import size_of, table_of
from twin.campaigns.spec import Spec

PROBE = 64
"""Runs of a probe."""
SHORT, LONG = 0.5, 2.5
"""Of its two flights, whose difference is the cost of flying [s]."""


@dataclass(frozen=True)
class Forecast:
    """What a campaign will take."""

    runs: int
    shards: int
    arms: int
    points: int
    """Combinations of arms and grids."""
    samples: int
    """Of each combination."""
    factors: tuple[str, ...]
    """With their distributions, in words."""
    fixed: tuple[str, ...]
    """What is the same in all runs, of what the specification gives."""
    seconds: float
    """On all workers together; of a balancing at most, and without its identifications."""
    at_most: bool
    bytes: int
    """Of the metrics. Recordings come on top."""


def forecast(spec: Spec, workers: int) -> Forecast:
    """Measure on this machine, in this process."""
    drawn = draw(spec, range(min(PROBE, spec.runs)))
    short, long = (replace(spec, duration=length, steady=length) for length in (SHORT, LONG))
    flown(short, drawn)  # compiled and imported
    took: list[float] = []
    for probe in (short, long):
        started = time.perf_counter()
        came = flown(probe, drawn)
        took.append(time.perf_counter() - started)
    a_second = max(took[1] - took[0], 0.0) / (LONG - SHORT)
    begin = max(took[0] - SHORT * a_second, 0.0)
    each = (begin + spec.duration * a_second) / len(drawn.runs)
    empty = size_of(table_of(spec, drawn.at([]), {}))
    size = size_of(table_of(spec, drawn, came)) - empty
    return Forecast(
        runs=spec.runs,
        shards=spec.shards,
        arms=len(spec.arms),
        points=spec.points,
        samples=spec.samples,
        factors=tuple(f"{f.name} [{f.unit}]: {f.distribution.words()}" for f in spec.factors),
        fixed=tuple(_fixed(spec)),
        seconds=each * spec.runs / min(workers, spec.shards),
        at_most=spec.procedure == "balance",
        bytes=round(size * spec.runs / len(drawn.runs)) + empty * spec.shards,
    )


def _fixed(spec: Spec) -> Iterator[str]:
    effects = [factor for effect in spec.arms[0].effects for factor in effect.factors]
    start = [factor for of in spec.initial.factors.values() for factor in of]
    for factor in (*spec.gains, *effects, *start):
        if isinstance(factor.distribution, Fixed):
            yield f"{factor.name} [{factor.unit}]: {factor.distribution.value:g}"
    for arm in spec.arms:
        if arm.reference:
            yield f"reference of {arm.name}, in degrees: {arm.reference}"
