"""Flights of `astros`, as what is true and believed at each tick of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.errors import UsageError
from twin.estimators import Estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, Sensor, load_platform
from twin.reference import Hold
from twin.rotation import from_euler_zyx
from twin.signals import Tick

Array = NDArray[np.float64]

STABLE = {"integral": 0.1}
"""K_I in place of the printed 1; the other gains as printed."""
PRINTED = {"proportional": 1.0, "integral": 1.0, "derivative": 5.0}


@dataclass(frozen=True)
class FlownRuns:
    """n runs, tick by tick."""

    time: Array
    """(m,) [s]."""
    true: Mapping[str, Array]
    """By stream without its `truth_`, (m, n, k)."""
    applied: Mapping[str, Array]
    """By command stream, (m, n, k); each holds until the next tick."""
    believed: Mapping[str, Array]
    """By field of the estimate, (m, n, k)."""


class _Rows:
    def __init__(self, believed: Sequence[str]) -> None:
        self.time: list[float] = []
        self.true: dict[str, list[Array]] = {}
        self.applied: dict[str, list[Array]] = {}
        self.believed: dict[str, list[Array]] = {name: [] for name in believed}

    def collect(self, tick: Tick) -> None:
        self.time.append(tick.reading.time)
        for name, samples in tick.truth.items():
            self.true.setdefault(name.removeprefix("truth_"), []).append(samples.value[:, 0].copy())
        for name, value in tick.applied.items():
            self.applied.setdefault(name, []).append(value.copy())
        for name, values in self.believed.items():
            values.append(np.array(getattr(tick.estimate, name)))


def astros(moment: Array | None = None) -> Platform:
    """The shipped machine, which has the numbers of eq. 38, with another m r [kg m] if given."""
    platform = load_platform("astros")
    return platform if moment is None else replace(platform, center_of_mass_offset=moment)


def exact_sensors(platform: Platform) -> Platform:
    """The machine with sensors that show what is true at each tick."""

    def exact(sensor: Sensor) -> Sensor:
        none = np.zeros_like(sensor.noise)
        return Sensor(sensor.stream, platform.control_rate, none, none, site=sensor.site)

    return replace(
        platform, sensors={name: exact(sensor) for name, sensor in platform.sensors.items()}
    )


def tilted(roll: float, pitch: float, rate: Sequence[float] = (0.0, 0.0, 0.0)) -> InitialState:
    """A start by Euler angles [deg] and a body rate [deg/s]."""
    attitude = from_euler_zyx(np.array(0.0), np.radians(pitch), np.radians(roll))
    return InitialState(attitude=attitude, rate_body=np.radians(rate))


def flown(
    platform: Platform,
    law: str,
    estimator: Estimator,
    start: InitialState,
    duration: float,
    *,
    gains: Mapping[str, float] | None = None,
    seeds: int = 1,
    believed: Sequence[str] = (),
) -> FlownRuns:
    """Fly the loop, all seeds as one batch.

    Args:
        platform: the machine.
        law: a shipped control law.
        estimator: in the loop.
        start: of all runs.
        duration: [s].
        gains: of the law.
        seeds: runs, which differ by their sensors' noise.
        believed: fields of the estimate to be kept.

    Raises:
        UsageError: a run had to be stopped.
    """
    plant = SimulatedPlant(platform, runs=range(seeds), seed=1, initial=start)
    rows = _Rows(believed)
    fly(
        plant,
        estimator,
        load_controller(law, gains),
        Hold(),
        SimulatedClock(),
        duration=duration,
        observers=(rows,),
    )
    if plant.stopped:
        raise UsageError(f"a run of {platform.name} was stopped: {plant.stopped}")
    return FlownRuns(
        np.array(rows.time),
        {name: np.array(values) for name, values in rows.true.items()},
        {name: np.array(values) for name, values in rows.applied.items()},
        {name: np.array(values) for name, values in rows.believed.items()},
    )
