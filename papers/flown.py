"""Runs through the one loop for a reproduction: a law on a machine, all seeds in one batch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.clock import SimulatedClock
from twin.controller import AnyController
from twin.errors import TwinError
from twin.estimators import load_estimator, usual_estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, Sensor
from twin.recording import Recording
from twin.reference import Hold, Reference
from twin.rotation import multiply
from twin.signals import Target, Tick
from twin.stream.recorder import MemoryRecorder

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flown:
    """Rows are ticks, then runs."""

    platform: Platform
    time: Array
    """(m,) [s]."""
    true: Mapping[str, Array]
    """`attitude`, `rate`, `stage_position`, ..., (m, n, k)."""
    estimated: Mapping[str, Array]
    """`attitude` and `rate` as estimated, (m, n, k)."""
    applied: Mapping[str, Array]
    """By command stream, (m, n, k)."""
    recordings: tuple[Recording, ...]
    """What a laboratory would have, run by run; empty unless asked for."""

    def end(self) -> InitialState:
        """Where the runs stand, for a flight that goes on from there."""
        last = {name: values[-1] for name, values in self.true.items()}
        return InitialState(
            attitude=last["attitude"],
            rate_body=last["rate"],
            wheel_speed=last.get("wheel_speed"),
            stage_position=last.get("stage_position", 0.0),
            gimbal_angle=last.get("gimbal_angle"),
        )

    def between(self, start: float, stop: float) -> "Flown":
        """The ticks with start <= time < stop [s]."""
        first, last = np.searchsorted(self.time, [start - 1e-9, stop - 1e-9])

        def cut(rows: Mapping[str, Array]) -> Mapping[str, Array]:
            return {name: values[first:last] for name, values in rows.items()}

        return replace(
            self,
            time=self.time[first:last],
            true=cut(self.true),
            estimated=cut(self.estimated),
            applied=cut(self.applied),
        )


def flown(
    platform: Platform,
    law: AnyController,
    duration: float,
    *,
    start: InitialState | None = None,
    reference: Reference | None = None,
    estimator: str | None = None,
    runs: Sequence[int] = (0,),
    seed: int = 0,
    record: bool = False,
) -> Flown:
    """Fly; every run to its end.

    Args:
        platform: the machine, with its effects.
        law: that flies it.
        duration: [s].
        start: at rest and level unless given.
        reference: level at rest unless given.
        estimator: the machine's usual one unless named.
        runs: numbers of the runs; each has its own noise.
        seed: of all random numbers.
        record: whether to keep recordings.

    Raises:
        TwinError: a run was stopped.
    """
    plant = SimulatedPlant(platform, runs=runs, seed=seed, initial=start, threads=1)
    rows = _Rows()
    facts = {"platform": platform.name, "source": f"{platform.name}, seed {seed}"}
    memory = MemoryRecorder(platform, facts)
    outcome = fly(
        plant,
        load_estimator(estimator or usual_estimator(platform)),
        law,
        reference or Hold(),
        SimulatedClock(),
        duration=duration,
        observers=(rows, memory) if record else (rows,),
    )
    if plant.stopped:
        raise TwinError(f"{platform.name}: {outcome.reason}")
    return Flown(
        platform,
        np.array(rows.time),
        {name: np.array(values) for name, values in rows.true.items()},
        {name: np.array(values) for name, values in rows.estimated.items()},
        {name: np.array(values) for name, values in rows.applied.items()},
        tuple(memory.recording(run).without_truth() for run in range(len(runs)) if record),
    )


def exact_sensors(platform: Platform) -> Platform:
    """The machine with sensors that show what is true at each tick."""

    def exact(sensor: Sensor) -> Sensor:
        none = np.zeros_like(sensor.noise)
        return Sensor(sensor.stream, platform.control_rate, none, none, site=sensor.site)

    return replace(
        platform, sensors={name: exact(sensor) for name, sensor in platform.sensors.items()}
    )


def perfect(platform: Platform) -> Platform:
    """The machine with exact sensors and without its effects."""
    return replace(exact_sensors(platform), effects=())


@dataclass(frozen=True)
class About(Reference):
    """A motion about another attitude than level; the body's rates are the same."""

    attitude: Array
    """(4,)."""
    motion: Reference

    def at(self, time: float | Array) -> Target:
        """The motion, carried there."""
        target = self.motion.at(time)
        return replace(target, attitude=multiply(self.attitude, target.attitude))


class _Rows:
    """Keeps what is true, estimated and applied at each tick."""

    def __init__(self) -> None:
        self.time: list[float] = []
        self.true: dict[str, list[Array]] = {}
        self.estimated: dict[str, list[Array]] = {"attitude": [], "rate": []}
        self.applied: dict[str, list[Array]] = {}

    def collect(self, tick: Tick) -> None:
        self.time.append(tick.reading.time)
        for name, samples in tick.truth.items():
            row = samples.value[:, -1].copy()
            self.true.setdefault(name.removeprefix("truth_"), []).append(row)
        self.estimated["attitude"].append(tick.estimate.attitude.copy())
        self.estimated["rate"].append(tick.estimate.rate_body.copy())
        for name, value in tick.applied.items():
            self.applied.setdefault(name, []).append(value.copy())
