"""Motion of stages, gimbals and wheels under their commands.

Stages and gimbals follow their drives' profiles, with the effects that the platform states of the
drives; nothing resists them. A stage starts where its first command sends it, if nothing else is
known, a gimbal at home. What a gimbal does beside its command is a random walk, except for a known
fault of its drive.

A wheel without a recorded command has a white torque of the size that its speed shows. The body
receives the opposite torque, so that the log still determines their common momentum.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar, nnls
from scipy.signal import lfilter

from twin.effects import Effect, SeriesEffect, catalogue, series_effects
from twin.model import Machine
from twin.plant.prescribed import PrescribedJoints
from twin.recording import Series
from twin.signals import Samples

Array = NDArray[np.float64]
SIZED = 2
"""Times that an effect is sized by counters: play is not in proportion to what it does."""
STREAM = "command_gimbal_rate"
ROUNDS = 5
"""Times that the faults' marks are formed, each where the one before found them."""
ROUNDED = 1.25
"""Digits, from the least to the most, that rounding may take a reading off: one where the truth is
known to the instant, a quarter more for when it was read. What strays farther is not rounding."""
WORTHWHILE = 10.0
"""By how much a walk must lower twice the negative log-likelihood of the readings to be believed.
"""


@dataclass(frozen=True, eq=False)
class Course:
    """Where stages should be by what they were told."""

    machine: Machine
    command: Series
    place: Series
    """[m]."""

    def less(self, effect: Effect, time: Array) -> Array:
        """(m, k) how far an effect on the command takes the stages from there [m]."""
        there, _ = self.otherwise(effect)
        return there.interpolated_at(time) - self.place.interpolated_at(time)

    def sized(self, effect: Effect, measured: Series) -> Effect:
        """An effect on the command, of the size that leaves least of what counters show; as it is
        where they show none of it.

        Args:
            effect: one number, of some size.
            measured: positions as measured [m].
        """
        error, sized = from_mean(measured.value - self.place.interpolated_at(measured.time)), effect
        for _ in range(SIZED):
            mark = from_mean(self.less(sized, measured.time))
            power = float(np.sum(np.square(mark)))
            share = float(np.sum(mark * error)) / power if power > 0.0 else 0.0
            sized = sized.with_values(np.clip(share * sized.values, *sized.bounds()))
            if not sized.values.any():
                return effect
        return sized

    def otherwise(self, effect: Effect) -> tuple[Series, Series]:
        """Positions [m] and rates [m/s] with an effect on the command."""
        return _profile_with(self, effect)


def from_mean(values: Array) -> Array:
    """Positions or angles (m, k) from their mean: where they began is not known so well."""
    return values - values.mean(axis=0)


@lru_cache(maxsize=64)
def _profile_with(course: Course, effect: Effect) -> tuple[Series, Series]:
    machine = replace(course.machine, effects=(*course.machine.effects, effect))
    name, start = "command_stage_position", course.place.value[0]
    return profile(machine, name, course.command, start)


def profile(
    machine: Machine, name: str, command: Series, start: Array | None = None
) -> tuple[Series, Series]:
    """Positions and rates of all stages or gimbals.

    Args:
        machine: compiled.
        name: `command_stage_position` or `command_gimbal_rate`.
        command: as applied.
        start: (stages,) where they were seen at the first command [m].
    """
    platform, model = machine.platform, machine.model
    step, steps = platform.step, platform.steps_per_tick
    samples = Samples(command.value[None], command.time[None], np.ones((1, len(command)), bool))
    for effect in series_effects(machine.effects, name):
        samples = effect.apply(samples, platform)
    ticks = round(float(command.time[-1] - command.time[0]) / platform.tick) + 1
    time = command.time[0] + step * np.arange(ticks * steps + 1)
    # half a step of grace: stamps are rounded
    last = np.searchsorted(command.time, time[:-1:steps] + 0.5 * step, side="right") - 1
    held = samples.value[0][last]
    position, velocity = model.qpos0[None].copy(), np.zeros((1, model.nv))
    gimbals = name == "command_gimbal_rate"
    if gimbals:
        position[:, machine.gimbal_qpos] = [gimbal.home for gimbal in platform.gimbals]
        places, dof, inertia = machine.gimbal_qpos, machine.gimbal_dof, machine.gimbal_inertia
    else:
        position[:, machine.stage_qpos] = held[0] if start is None else start
        places, dof, inertia = machine.stage_qpos, machine.stage_dof, machine.stage_inertia
    first = position[0, places]
    joints = PrescribedJoints(machine, position, velocity)
    send = joints.send_gimbals if gimbals else joints.send_stages
    change = np.zeros((ticks, steps, len(dof)))
    for tick in range(ticks):
        send(held[tick][None])
        force = joints.forces(steps)
        if force is not None:
            change[tick] = force[0][:, dof] / inertia
    none = np.zeros((1, len(dof)))
    rate = np.concatenate([none, np.cumsum(step * change.reshape(-1, len(dof)), axis=0)])
    moved = np.concatenate([none, np.cumsum(0.5 * step * (rate[1:] + rate[:-1]), axis=0)])
    unit = "rad" if gimbals else "m"
    return (
        Series(time, first + moved, command.columns, unit),
        Series(time, rate, command.columns, f"{unit}/s"),
    )


def less_drive_faults(
    machine: Machine, series: Series, commanded: Series, measured: Series
) -> Series:
    """What gimbals' angles (m, gimbals) are beside their command, and no fault explains [rad].

    Args:
        machine: compiled.
        series: the commanded rates.
        commanded: the angles that they lead to.
        measured: the measured angles.
    """
    kinds = [k for k in catalogue() if issubclass(k, SeriesEffect) and k.acts_on == STREAM]
    gimbals = [gimbal.name for gimbal in machine.platform.gimbals]
    error = from_mean(measured.value - commanded.interpolated_at(measured.time))
    left = error
    # one of each kind on each gimbal, which is felt there alone
    faults: list[list[Effect]] = [[kind.typical(name) for name in gimbals] for kind in kinds]
    for _ in range(ROUNDS):
        marks = [_mark(machine, every, series, commanded, measured.time) for every in faults]
        sizes = np.stack(
            [
                nnls(np.stack([mark[:, i] for mark in marks], axis=1), error[:, i])[0]
                for i in range(len(gimbals))
            ],
            axis=1,
        )
        left = error - sum(mark * size for mark, size in zip(marks, sizes, strict=True))
        faults = [
            [_sized(fault, float(item)) for fault, item in zip(every, size, strict=True)]
            for every, size in zip(faults, sizes, strict=True)
        ]
    return replace(measured, value=left)


def _mark(
    machine: Machine, faults: Sequence[Effect], series: Series, commanded: Series, time: Array
) -> Array:
    """(m, gimbals) [rad]."""
    faulty = replace(machine, effects=(*machine.effects, *faults))
    astray = profile(faulty, STREAM, series)[0]
    return from_mean(astray.interpolated_at(time) - commanded.interpolated_at(time))


def _sized(fault: Effect, size: float) -> Effect:
    return fault.with_values(np.clip(fault.values * max(size, 1e-3), *fault.bounds()))


def random_walk(series: Series, noise: Array, digit: Array) -> Array:
    """(k,) variance a second of what walks at random and is read with white noise.

    The most likely one: a Kalman filter at rest, its gain sought. 0 where the readings do not ask
    for any, or where rounding alone could have them stray so far: of what moves slowly that is no
    white noise, and looks like a walk.

    Args:
        series: as measured.
        noise: (k,) 1 sigma of a reading.
        digit: (k,) to which it is rounded; 0: not at all.
    """
    period = float(np.median(np.diff(series.time)))
    strayed = np.ptp(series.value, axis=0) > ROUNDED * digit
    walk = [
        _random_walk(column, float(sigma)) if far else 0.0
        for column, sigma, far in zip(series.value.T, noise, strayed, strict=True)
    ]
    return np.array(walk) / period


def wander(answer: Array, force: Array, intensity: Array, step: float) -> tuple[Array, Array]:
    """Covariance (S, K, x, x) that a state gains in each step, and its expected drift (S, K, x)
    from the path.

    Args:
        answer: (S, K or 1, x, d) change of the state by a unit impulse on each wheel, a unit turn
            of each gimbal, of the machine as it is fitted.
        force: (S, K, d) that the path was predicted with and no command explains [N m, rad/s].
        intensity: (d,) of the torques, of the rates; 0 where a command explains all.
        step: [s].
    """
    drift = -step * (answer @ (force * (intensity > 0.0))[..., None])[..., 0]
    noise = (answer * (intensity * step)) @ answer.swapaxes(-1, -2)
    return np.broadcast_to(noise, (*drift.shape, drift.shape[-1])), drift


def _random_walk(values: Array, noise: float) -> float:
    """Variance that a random walk gains a sample, from readings (m,) with white noise."""

    def cost(logarithm: float) -> float:
        gain = 1.0 / (1.0 + np.exp(-logarithm))
        error = lfilter([1.0, -1.0], [1.0, gain - 1.0], values - values[0])
        variance = noise**2 / (1.0 - gain)
        return float(np.mean(np.square(error)) / variance + np.log(variance))

    best = minimize_scalar(cost, bounds=(-12.0, 12.0), method="bounded")
    if len(values) * (cost(-12.0) - float(best.fun)) < WORTHWHILE:
        return 0.0
    gain = 1.0 / (1.0 + np.exp(-float(best.x)))
    return float(np.square(noise * gain) / (1.0 - gain))
