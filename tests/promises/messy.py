"""Logs with what every real one has: torques and attitudes that wander, losses, stamps that jitter.

The machine that is flown is `sads` as it is stated; what is hidden is beside the mess.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin import rotation
from twin.clock import SimulatedClock
from twin.effects import BodyEffect, Domain, Effect, State, parameter
from twin.effects.on_body import TorqueLaw
from twin.flight import prepare
from twin.platform import Platform
from twin.recording import Recording, Series
from twin.stream.recorder import MemoryRecorder

MEASURED = ("gyro", "attitude", "wheel_speed")


@dataclass(frozen=True)
class Mess:
    """How much of it."""

    torque: float = 0.0
    """Rms of a torque that wanders about each body axis [N m]."""
    torque_time: float = 3.0
    """Its time constant [s]."""
    attitude: float = 0.0
    """Rms of an attitude error that wanders about each body axis [rad]."""
    attitude_time: float = 20.0
    """Its time constant [s]."""
    lost: float = 0.005
    """Share of the samples."""
    jitter: float = 2e-4
    """Rms of what stamps are off by [s]."""


@dataclass(frozen=True)
class WanderingTorque(BodyEffect):
    """An Ornstein-Uhlenbeck process about each axis of the base, drawn on a grid of its own."""

    name = "wandering_torque"
    domain = Domain.torque
    observable = "a torque that wanders"
    streams = ("gyro",)

    rms: float = parameter("rms", "N m", 1e-5, source="any", low=0.0, high=1.0)
    seed: int = field(default=0)
    """Of the draw."""
    time_constant: float = field(default=3.0)
    """[s]."""
    duration: float = field(default=600.0)
    """[s]."""

    def torque(self, platform: Platform) -> TorqueLaw:
        """See above."""
        step = 0.1 * self.time_constant
        times = np.arange(0.0, self.duration + step, step)
        rng = np.random.default_rng(self.seed)
        drawn = wandering(times, self.rms, self.time_constant, 3, rng)

        def law(state: State) -> np.ndarray:
            columns = [np.interp(state.time, times, column) for column in drawn.T]
            return np.stack(columns, axis=-1)

        return law


def wandering(
    times: np.ndarray, rms: float, time_constant: float, columns: int, rng: np.random.Generator
) -> np.ndarray:
    """(m, columns) an Ornstein-Uhlenbeck process at some times."""
    values = np.empty((len(times), columns))
    values[0] = rng.standard_normal(columns)
    for k, decay in enumerate(np.exp(-np.diff(times) / time_constant), start=1):
        fresh = np.sqrt(1.0 - decay**2) * rng.standard_normal(columns)
        values[k] = decay * values[k - 1] + fresh
    return rms * values


def flown(
    effects: Sequence[Effect], seed: int, mess: Mess | None = None, duration: float = 150.0
) -> Recording:
    """A run of `sads` on a multisine, with effects that are hidden and a mess that nobody models;
    without one, clean.

    Args:
        effects: that are hidden.
        seed: of the sensors' noise and of the mess.
        mess: how much of it.
        duration: [s].
    """
    effects = tuple(effects)
    if mess is not None and mess.torque > 0.0:
        wander = WanderingTorque(mess.torque, seed, mess.torque_time, duration + 1.0)
        effects = (*effects, wander)
    flight = prepare(
        "sads",
        controller="quaternion_pd",
        estimator="filter",
        plant="sim",
        reference="multisine:10",
        duration=duration,
        seed=seed,
        effects=effects,
    )
    recorder = MemoryRecorder(flight.platform, {"platform": "sads", "source": f"messy {seed}"})
    flight.fly(SimulatedClock(), [recorder])
    log = recorder.recording().without_truth()
    return log if mess is None else messy(log, mess, seed)


def messy(log: Recording, mess: Mess, seed: int) -> Recording:
    """A log with its sensors' part of the mess."""
    rng = np.random.default_rng([seed, 1])
    streams = dict(log.streams)
    for name in MEASURED:
        series = streams[name]
        if name == "attitude" and mess.attitude > 0.0:
            error = wandering(series.time, mess.attitude, mess.attitude_time, 3, rng)
            turn = rotation.from_rotation_vector(error)
            series = replace(series, value=rotation.multiply(series.value, turn))
        streams[name] = _stamped(series, mess, rng)
    return replace(log, streams=streams)


def _stamped(series: Series, mess: Mess, rng: np.random.Generator) -> Series:
    """With samples lost, and stamps that are off."""
    kept = rng.random(len(series)) >= mess.lost
    kept[[0, -1]] = True
    off = mess.jitter * rng.standard_normal(len(series))
    off[[0, -1]] = 0.0
    return replace(series, time=series.time + off).only(kept)
