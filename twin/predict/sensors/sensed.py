"""What sensors on the body make of a predicted motion: specific force, tilt, field.

The same laws as the simulated sensors have, on every instant of the grid, behind the low-pass that
platform.toml states. A sensor feels how fast the rate changes; that is the mean over the step
before an instant, or over the sensor's window if that is longer, as one that sums up velocity
increments has it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import sosfilt, sosfilt_zi

from twin import rotation
from twin.model import Machine
from twin.plant.derived import elevations, site_places, specific_force
from twin.plant.low_pass import sections_of
from twin.platform import Sensor
from twin.predict.path.states import States

Array = NDArray[np.float64]

SENSED = ("inclinometer", "accelerometer", "magnetometer")
"""Streams that follow from attitude, rate and the change of the rate. So does a gyro with a filter,
which takes from the rate what the drives' steps shake it by."""

SETTLED = 8.0
"""Time constants of a low-pass before a segment over which its motion is carried back: what the
filter remembers of."""


@dataclass(frozen=True)
class Sense:
    """One sensor on one grid."""

    stream: str
    step: float
    """Of the grid [s]."""
    gravity: float
    """[m/s^2]."""
    field_world: Array
    """(3,) [T]."""
    site: Array
    """(3,) from the CR, body axes [m]."""
    window: float
    """Over which the change of the rate is taken, where that is longer than a step [s]."""
    sections: Array | None
    """(., 6) second-order sections of the low-pass; None without one."""
    memory: int
    """Steps before a segment that the low-pass remembers."""

    @property
    def feels_turning(self) -> bool:
        """Whether a value depends on how the rate has changed over the step before."""
        return self.stream in ("inclinometer", "accelerometer")

    def shown(self, path: States) -> Array:
        """Values (v, S, steps + 1, k) along paths (v, S, steps + 1, .)."""
        position, rate, turning = self._extended(path)
        if self.stream == "gyro":
            value = rate
        elif self.stream == "magnetometer":
            value = rotation.rotate(rotation.conjugate(position), self.field_world)
        else:
            push = np.zeros_like(rate)
            push[..., 2] = self.gravity
            value = specific_force(position, push, rate, turning, self.site)
            if self.stream == "inclinometer":
                value = elevations(value, self.gravity)
        if self.sections is None:
            return value
        rest = sosfilt_zi(self.sections)[:, None, None, :, None] * value[None, :, :, :1]
        passed, _ = sosfilt(self.sections, value, axis=2, zi=rest)
        return passed[:, :, self.memory :]

    def slope(self, path: States) -> Array:
        """(S, steps + 1, k, 6) d value / d (turn, rate) along a path (1, S, steps + 1, .), the
        low-pass left out."""
        return self._slopes(path)[..., :6]

    def moved_by(self, path: States, change: Array) -> Array:
        """(S, steps + 1, k, a) change of the values by changes (S, steps + 1, x, a) of the state,
        none before the first instant."""
        turning = self._turning(np.moveaxis(change[:, :, 3:6], 1, 0))
        felt = np.concatenate([change[:, :, :6], np.moveaxis(turning, 0, 1)], axis=2)
        moved = self._slopes(path) @ felt
        return moved if self.sections is None else sosfilt(self.sections, moved, axis=1)

    def _slopes(self, path: States) -> Array:
        """(S, steps + 1, k, 9) d value / d (turn, rate, its derivative)."""
        position, rate = path.position[0], path.rate[0]
        none = np.zeros((*rate.shape[:-1], 3, 3))
        if self.stream == "gyro":
            return np.concatenate([none, none + np.eye(3), none], axis=-1)
        if self.stream == "magnetometer":
            field_body = rotation.rotate(rotation.conjugate(position), self.field_world)
            return np.concatenate([rotation.skew(field_body), none, none], axis=-1)
        up = rotation.rotate(rotation.conjugate(position), np.array([0.0, 0.0, self.gravity]))
        whirl = (
            rate[..., :, None] * self.site
            + (rate @ self.site)[..., None, None] * np.eye(3)
            - 2.0 * self.site[:, None] * rate[..., None, :]
        )
        lever = none - rotation.skew(self.site)
        slopes = np.concatenate([rotation.skew(up), whirl, lever], axis=-1)
        if self.stream == "accelerometer":
            return slopes
        level = np.sqrt(np.maximum(1.0 - np.square(up / self.gravity), 1e-6)) * self.gravity
        return np.stack(
            [slopes[..., 1, :] / level[..., 1:2], -slopes[..., 0, :] / level[..., 0:1]], axis=-2
        )

    def _extended(self, path: States) -> tuple[Array, Array, Array]:
        """Attitude, rate and its derivative, from so long before each segment as is remembered."""
        position, rate = path.position, path.rate
        turning = np.moveaxis(self._turning(np.moveaxis(rate, 2, 0)), 0, 2)
        if not self.memory:
            return position, rate, turning
        ago = self.step * np.arange(self.memory, 0, -1)[:, None]
        first, slope = rate[:, :, :1], turning[:, :, :1]
        back = rotation.from_rotation_vector(0.5 * slope * ago**2 - first * ago)
        before = rotation.multiply(position[:, :, :1], back)
        return (
            np.concatenate([before, position], axis=2),
            np.concatenate([first - slope * ago, rate], axis=2),
            np.concatenate([np.repeat(slope, self.memory, axis=2), turning], axis=2),
        )

    def _turning(self, rate: Array) -> Array:
        """How fast rates (steps + 1, ...) change, at each instant the mean over the window; as if
        they had changed before the first as they do after it."""
        slope = np.diff(rate, axis=0) / self.step
        slope = np.concatenate([slope[:1], slope])
        steps = max(self.window / self.step, 1.0)
        if steps == 1.0:
            return slope
        # of a step that the window does not fill, its part
        parts = np.clip(steps - np.arange(np.ceil(steps)), 0.0, 1.0) / steps
        padded = np.concatenate([slope[:1].repeat(len(parts) - 1, axis=0), slope])
        last = len(parts) - 1
        return sum(
            (part * padded[last - back : len(padded) - back] for back, part in enumerate(parts)),
            start=np.zeros_like(slope),
        )


def senses_of(machine: Machine, step: float, field_world: Array) -> dict[str, Sense]:
    """By stream, those of a ball. On one that glides, accelerometers and inclinometers feel more
    than the state of a prediction holds. A magnetometer needs a field that is known."""
    platform = machine.platform
    base = platform.base
    if base.kind != "ball":
        return {}
    glides = set(base.planar) - set(base.locked)
    sites = site_places(machine)
    found: dict[str, Sense] = {}
    for name in ("gyro", *SENSED):
        sensor = platform.sensors.get(name)
        if sensor is None or (name == "magnetometer" and not field_world.any()):
            continue
        sections, memory = _low_pass(sensor, step)
        if name == "gyro" and sections is None:
            continue
        if glides and name in ("inclinometer", "accelerometer"):
            continue
        site = sites.get(sensor.site, np.zeros(3))
        found[name] = Sense(
            name, step, platform.gravity, field_world, site, sensor.window, sections, memory
        )
    return found


def _low_pass(sensor: Sensor, step: float) -> tuple[Array | None, int]:
    if not np.isfinite(sensor.cutoff) or sensor.cutoff * step >= 0.5:
        return None, 0
    memory = int(np.ceil(SETTLED / (2.0 * np.pi * sensor.cutoff * step)))
    return sections_of(sensor, step), memory
