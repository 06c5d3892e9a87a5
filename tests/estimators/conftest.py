"""Sensors on bodies that turn in a known way, so that an estimate can be held against the truth."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from twin.platform import Platform, Sensor, load_platform
from twin.rotation import from_rotation_vector, multiply, normalized
from twin.signals import Reading, Samples


@dataclass
class Bodies:
    """n bodies that swing about all axes, each with its own phases, gyro bias and noise.

    `readings` yields one Reading a tick; the truth at that tick is then in `attitude`, `rate`.
    """

    platform: Platform
    n: int
    seed: int
    swing: float = 0.05
    """Largest rate about an axis [rad/s]."""
    fine: int = 10
    """Steps of the truth between two gyro samples."""

    def __post_init__(self) -> None:
        self.draw = np.random.default_rng(self.seed)
        self.attitude = normalized(self.draw.normal(size=(self.n, 4)))
        self.bias = self.draw.normal(size=(self.n, 3)) * self.platform.sensors["gyro"].bias
        self._phase = self.draw.uniform(0.0, 2.0 * np.pi, (self.n, 3))
        self.rate = self.rate_at(0.0)

    def rate_at(self, time: float) -> np.ndarray:
        return self.swing * np.sin(np.array([0.5, 0.8, 1.1]) * time + self._phase)

    def readings(self, duration: float) -> Iterator[Reading]:
        gyro, attitude = (self.platform.sensors[name] for name in ("gyro", "attitude"))
        step = 1.0 / gyro.rate
        per_tick, apart = round(self.platform.tick / step), round(gyro.rate / attitude.rate)
        pending: list[tuple[str, float, float, np.ndarray, np.ndarray]] = []
        for tick in range(1, round(duration / self.platform.tick) + 1):
            for k in range((tick - 1) * per_tick + 1, tick * per_tick + 1):
                self._turn((k - 1) * step, step)
                measured = self.rate + self.bias + self._noise(gyro)
                pending.append(("gyro", *self._stamped(gyro, k * step, measured)))
                if k % apart == 0:
                    error = from_rotation_vector(self._noise(attitude))
                    measured = multiply(self.attitude, error)
                    pending.append(("attitude", *self._stamped(attitude, k * step, measured)))
            now = tick * self.platform.tick
            arrived = [sample for sample in pending if sample[1] <= now + 1e-9]
            pending = [sample for sample in pending if sample[1] > now + 1e-9]
            yield Reading(
                now, {name: s for name in ("gyro", "attitude") for s in _of(name, arrived)}
            )

    def _turn(self, start: float, step: float) -> None:
        h = step / self.fine
        for i in range(self.fine):
            turn = from_rotation_vector(h * self.rate_at(start + (i + 0.5) * h))
            self.attitude = multiply(self.attitude, turn)
        self.rate = self.rate_at(start + step)

    def _noise(self, sensor: Sensor) -> np.ndarray:
        return self.draw.normal(size=(self.n, 3)) * sensor.noise

    def _stamped(self, sensor: Sensor, time: float, value: np.ndarray):
        kept = self.draw.uniform(size=self.n) >= sensor.dropout
        value[~kept] = np.nan
        return time + sensor.latency, time, value, kept


def _of(name: str, arrived: list) -> Iterator[Samples]:
    rows = [sample for sample in arrived if sample[0] == name]
    if rows:
        times = np.tile([row[2] for row in rows], (len(rows[0][3]), 1))
        value = np.stack([row[3] for row in rows], axis=1)
        yield Samples(value, times, np.stack([row[4] for row in rows], axis=1))


@pytest.fixture(scope="session")
def platform() -> Platform:
    """The shipped dumbbell with a gyro at 100 Hz, an attitude sensor at 50 Hz and nothing else."""
    shipped = load_platform("sads")
    sensors = {name: shipped.sensors[name] for name in ("gyro", "attitude")}
    return dataclasses.replace(shipped, sensors=sensors)


@pytest.fixture
def with_sensor(platform):
    """The platform with other properties of a sensor: with_sensor(gyro={"dropout": 0.1})."""

    def change(**changes: dict) -> Platform:
        sensors = dict(platform.sensors)
        for stream, values in changes.items():
            values = {k: np.full(3, v) if k in ("noise", "bias") else v for k, v in values.items()}
            sensors[stream] = dataclasses.replace(sensors[stream], **values)
        return dataclasses.replace(platform, sensors=sensors)

    return change


@pytest.fixture
def bodies() -> type[Bodies]:
    """The bodies."""
    return Bodies
