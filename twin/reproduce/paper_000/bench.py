"""The paper's machine and its sinusoidal tracking run, from which it identifies."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.controller import load_controller
from twin.plant.initial import InitialState, hanging
from twin.platform import Platform, load_platform
from twin.reference import Multisine, Reference
from twin.reproduce.flown import About, Flown, flown
from twin.signals import Target

Array = NDArray[np.float64]

PRINTED = np.array(
    [[61.7985, -2.4520, -15.2826], [-2.4520, 56.2741, -9.1634], [-15.2826, -9.1634, 215.1353]]
)
"""J of eq. 43 [kg m^2], in the paper's axes."""
PRINTED_MOMENT = np.array([-0.0058, 0.0302, 0.4008])
"""m r of eq. 43 [kg m], in the paper's axes."""
TURN = np.array([1.0, -1.0, -1.0])
"""Half a turn about x: from the paper's axes to ours."""
JZZ = 95.0
"""[kg m^2], ASSUMED in place of the printed one, which no rigid body has beside the others."""
MIDDLE = 1e-3
"""Noise of gyro and attitude of the grade `middle` [rad/s, rad]."""
AMPLITUDE, PACE = np.radians(3.0), 0.02
"""Of the tracking run [rad, Hz]."""
LENGTH = 60.0
"""Of the tracking run [s]."""


def printed_machine() -> Platform:
    """`tas2` with J (but for Jzz) and m r of eq. 43, and sensors of the middle grade."""
    shipped = load_platform("tas2")
    inertia = PRINTED * np.outer(TURN, TURN)
    inertia[2, 2] = JZZ
    machine = replace(shipped, inertia=inertia, center_of_mass_offset=PRINTED_MOMENT * TURN)
    return with_noise(machine, MIDDLE)


def with_noise(machine: Platform, noise: float) -> Platform:
    """The machine with that noise on gyro [rad/s] and attitude [rad]."""
    sensors = dict(machine.sensors)
    for name in ("gyro", "attitude"):
        sensors[name] = replace(sensors[name], noise=np.full(3, noise))
    return replace(machine, sensors=sensors)


def tracked(machine: Platform, *, runs: Sequence[int] = (0,)) -> Flown:
    """Sines in roll, pitch and yaw by quaternion feedback and three gyros, about where m r hangs.

    About level the offset of eq. 43 would fill the array within a minute.
    """
    rest = hanging(machine.center_of_mass_offset)
    return flown(
        machine,
        load_controller("cmg_pd"),
        LENGTH,
        start=InitialState(attitude=rest),
        reference=About(rest, Multisine(AMPLITUDE, PACE)),
        runs=runs,
        record=True,
    )


@dataclass(frozen=True)
class RollPitch(Reference):
    """Rates of a body that rolls and pitches, a quarter of a period apart, after a smooth start.

    The adaptive law follows a momentum and looks at no attitude; this one stays level.
    """

    angle: float = np.radians(10.0)
    """Of both [rad]. ASSUMED: the paper prints no amplitude; its bumper is at 20 deg."""
    pace: float = 0.3
    """[rad/s], that of the law's gains as shipped. ASSUMED."""
    ramp: float = 30.0
    """[s]."""

    def at(self, time: float | Array) -> Target:
        """Rate and acceleration; no step in either."""
        now = np.asarray(time, dtype=np.float64)
        turn, part = self.pace * now, 0.5 * np.pi * np.clip(now / self.ramp, 0.0, 1.0)
        size = np.sin(part)[..., None] ** 2
        growth = 0.5 * np.pi / self.ramp * np.sin(2.0 * part)[..., None]
        along = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)
        across = np.stack([-np.sin(turn), np.cos(turn), 0.0 * turn], axis=-1)
        most = self.angle * self.pace
        level = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*turn.shape, 4))
        acceleration = most * (growth * along + self.pace * size * across)
        return Target(level, most * size * along, acceleration)
