"""The law that a machine has, and on top whatever it has besides: moved, pulsed, driven to and fro.

A part that stands still shows nothing of what is wrong with it. Stages shift the centre of mass by
an angle that the body's own pendulum would hang at, coils push a share of their limit, thrusters
pulse in turn.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from twin.controller import AnyController, Controller, load_controller
from twin.errors import ControllerError
from twin.platform import Platform
from twin.signals import Command, Estimate, Target

LAWS = ("quaternion_pd", "cmg_pd", "mass_magnetic_pid", "free_float")
"""The first that the machine can take."""
TONES = 0.035 * np.sqrt([1.0, 2.0, 3.0, 5.0, 6.0, 7.0])
"""[Hz], no two in a rational ratio."""
LEAN = 0.1
"""By which the stages would turn the machine's hanging [rad]."""
COILS = 0.1
"""Of their limit."""
PULSE = (7.0, 0.5, 0.05)
"""Time from one thruster's pulse to the next one's [s], how long [s], share of its limit."""


@dataclass(frozen=True)
class Driven:
    """What it remembers."""

    law: AnyController
    state: Any
    platform: Platform


@dataclass(frozen=True)
class Shaken(Controller[Driven]):
    """A tracker or balancer, and sines and pulses beside it."""

    def init(self, platform: Platform, n: int) -> Driven:
        """Of the first law that can."""
        for name in LAWS:
            law = load_controller(name)
            try:
                return Driven(law, law.init(platform, n), platform)
            except ControllerError:
                continue
        raise ControllerError(f"nothing moves {platform.name}")

    def update(
        self, state: Driven, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Driven]:
        """Both together."""
        command, after = state.law.update(state.state, estimate, target, time)
        platform, more = state.platform, dict(command)
        sine = np.sin(2.0 * np.pi * TONES * time) * min(time / 10.0, 1.0)
        zero = np.zeros((len(estimate.attitude), 1))
        if platform.stages:
            mass = np.array([stage.mass for stage in platform.stages])
            low, high = np.array([stage.travel for stage in platform.stages]).T
            reach = LEAN * np.linalg.norm(platform.center_of_mass_offset) / mass
            moved = more.get("command_stage_position", zero) + reach * sine[: len(mass)]
            more["command_stage_position"] = np.clip(moved, low, high)
        if platform.magnetorquers:
            limit = min(coil.dipole_limit for coil in platform.magnetorquers)
            more["command_dipole"] = more.get("command_dipole", zero) + COILS * limit * sine[3:]
        if platform.thrusters:
            every, length, share = PULSE
            turn, since = divmod(time, every)
            limit = np.array([one.force_limit for one in platform.thrusters])
            on = (np.arange(len(limit)) == turn % len(limit)) & (since < length)
            more["command_thruster"] = zero + share * limit * on
        return more, Driven(state.law, after, platform)
