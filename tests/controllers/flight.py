"""Runs of a law on a simulated machine, as what is true at each tick of them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin.clock import SimulatedClock
from twin.controller import AnyController
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform
from twin.reference import Hold, Reference
from twin.signals import Tick


@dataclass(frozen=True)
class Run:
    """Rows are ticks."""

    time: np.ndarray
    true: Mapping[str, np.ndarray]
    """`attitude`, `rate`, `stage_position`, ..., (m, k)."""
    applied: Mapping[str, np.ndarray]
    """By command stream, (m, k)."""


class _Rows:
    def __init__(self) -> None:
        self.time: list[float] = []
        self.true: dict[str, list[np.ndarray]] = {}
        self.applied: dict[str, list[np.ndarray]] = {}

    def collect(self, tick: Tick) -> None:
        self.time.append(tick.reading.time)
        for name, samples in tick.truth.items():
            row = samples.value[0, 0].copy()
            self.true.setdefault(name.removeprefix("truth_"), []).append(row)
        for name, value in tick.applied.items():
            self.applied.setdefault(name, []).append(value[0].copy())


def simulate(
    law: AnyController,
    platform: Platform,
    duration: float,
    *,
    start: InitialState | None = None,
    reference: Reference | None = None,
    estimator: str = "passthrough",
    seed: int = 0,
) -> Run:
    """One run; nothing may stop it."""
    plant = SimulatedPlant(platform, seed=seed, initial=start)
    rows = _Rows()
    fly(
        plant,
        load_estimator(estimator),
        law,
        reference or Hold(),
        SimulatedClock(),
        duration=duration,
        observers=(rows,),
    )
    assert not plant.stopped, plant.stopped
    return Run(
        np.array(rows.time),
        {name: np.array(values) for name, values in rows.true.items()},
        {name: np.array(values) for name, values in rows.applied.items()},
    )
