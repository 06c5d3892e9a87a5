"""How stages and gimbals go where they are told: the drives' own profiles, which nothing resists.

On the physics grid that starts with the first command. A mass starts where that sends it, if
nothing else is known, a gimbal at home; effects that the platform states of the drives are at work.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from twin.effects import Effect, series_effects
from twin.model import Machine
from twin.plant.prescribed import PrescribedJoints
from twin.recording import Series
from twin.signals import Samples

Array = NDArray[np.float64]

SIZED = 2
"""Times that an effect is sized by counters: play is not in proportion to what it does."""


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

    def sized(self, effect: Effect, seen: Series) -> Effect:
        """An effect on the command, of the size that leaves least of what counters show; as it is
        where they show none of it.

        Args:
            effect: one number, of some size.
            seen: positions as measured [m].
        """
        error, sized = from_mean(seen.value - self.place.interpolated_at(seen.time)), effect
        for _ in range(SIZED):
            mark = from_mean(self.less(sized, seen.time))
            power = float(np.sum(np.square(mark)))
            share = float(np.sum(mark * error)) / power if power > 0.0 else 0.0
            sized = sized.with_values(np.clip(share * sized.values, *sized.bounds()))
            if not sized.values.any():
                return effect
        return sized

    def otherwise(self, effect: Effect) -> tuple[Series, Series]:
        """Positions [m] and rates [m/s] with an effect on the command."""
        return _told_otherwise(self, effect)


def from_mean(values: Array) -> Array:
    """Positions or angles (m, k) from their mean: where they began is not known so well."""
    return values - values.mean(axis=0)


@lru_cache(maxsize=64)
def _told_otherwise(course: Course, effect: Effect) -> tuple[Series, Series]:
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
