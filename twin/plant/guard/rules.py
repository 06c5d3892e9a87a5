"""What a command may be, from what is wished and what has been seen: every rule on its own.

None of them stops the machine: they give the nearest command that is allowed, and count.
"""

from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.plant.guard.seen import Seen
from twin.plant.guard.settings import GuardSettings
from twin.plant.limits import Limits
from twin.platform import Platform
from twin.signals import Command

Array = NDArray[np.float64]

RULES: Mapping[str, str] = {
    "stroke": "a stage stays within its travel, less the margin at both ends",
    "rate": "a stage is sent no further than it goes in the horizon; a gimbal turns no faster than "
    "its drive can",
    "torque": "no motor, coil or thruster is asked for more than it has",
    "momentum": "a wheel takes up no more than its share of its limit",
    "balance_step": "while floating, one move changes m g r by no more than max_balance_step",
    "height": "while floating, no move brings the CM up to the CR",
}
"""Names of the rules that limit a command, and what each says."""


class Rules:
    """The rules for one machine."""

    def __init__(self, platform: Platform, settings: GuardSettings) -> None:
        """Nothing has been limited yet."""
        self.count = Counter[str]()
        """Ticks in which each rule changed a command."""
        self._platform, self._settings = platform, settings
        self._limits = Limits(platform)
        stages = platform.stages
        margin = settings.stroke_margin
        self._lowest = np.array([stage.travel[0] + margin for stage in stages])
        self._highest = np.array([stage.travel[1] - margin for stage in stages])
        self._lead = np.array([stage.speed for stage in stages]) * settings.horizon
        self._resolution = np.array([stage.resolution for stage in stages])
        self._moment = np.array([stage.mass * stage.axis for stage in stages]).reshape(-1, 3)
        """(stages, 3) mass moment per position [kg]."""
        self._most_momentum = settings.momentum_share * np.array(
            [wheel.momentum_limit for wheel in platform.wheels]
        )

    def limited(self, wanted: Command, seen: Seen, *, floating: bool) -> Command:
        """The nearest allowed command, each channel (1, columns).

        Args:
            wanted: finite, of channels that the machine has.
            seen: with the stages' positions, if `wanted` moves them.
            floating: whether the rules of a floating machine hold.
        """
        allowed: Command = {}
        for name, value in wanted.items():
            match name:
                case "command_stage_position":
                    allowed[name] = self._stages(value[0], seen, floating=floating)[None]
                case "command_wheel_torque":
                    allowed[name] = self._wheels(value[0], seen)[None]
                case "command_gimbal_rate":
                    allowed[name] = self._noted("rate", value, self._limits.gimbal_rate(value))
                case "command_dipole":
                    coils, dipole = self._limits.dipole(value)
                    if not np.allclose(coils, self._limits.coils(value), rtol=1e-9, atol=0.0):
                        self.count["torque"] += 1
                    allowed[name] = dipole
                case "command_thruster":
                    allowed[name] = self._noted("torque", value, self._limits.force(value))
                case _:
                    allowed[name] = self._noted("torque", value, self._limits.joint_torque(value))
        return allowed

    def _stages(self, wanted: Array, seen: Seen, *, floating: bool) -> Array:
        place = seen.stage_position
        assert place is not None
        target = self._noted("stroke", wanted, np.clip(wanted, self._lowest, self._highest))
        # outside the margins it may stay or come back, but is not thrown back
        lead = self._noted("rate", target - place, np.clip(target - place, -self._lead, self._lead))
        if floating:
            torque = self._platform.gravity * float(np.linalg.norm(lead @ self._moment))
            lead = self._scaled("balance_step", lead, self._settings.max_balance_step, torque)
            rise = float(lead @ self._moment[:, 2])
            if rise > 0.0:
                room = max(-self._settings.height_margin - self.height(place), 0.0)
                lead = self._scaled("height", lead, room, rise)
        return place + lead

    def height(self, stage_position: Array) -> float:
        """m r z with the stages there [kg m]; negative: the CM is below the CR."""
        base = float(self._platform.center_of_mass_offset[2])
        return base + float(stage_position @ self._moment[:, 2])

    def _wheels(self, wanted: Array, seen: Seen) -> Array:
        limit = np.array([wheel.torque_limit for wheel in self._platform.wheels])
        torque = self._noted("torque", wanted, np.clip(wanted, -limit, limit))
        tick, momentum = self._platform.tick, seen.wheel_momentum
        # one that is beyond its share is let down, but not braked for it
        most = np.maximum((self._most_momentum - momentum) / tick, 0.0)
        least = np.minimum((-self._most_momentum - momentum) / tick, 0.0)
        return self._noted("momentum", torque, np.clip(torque, least, most))

    def _scaled(self, rule: str, lead: Array, most: float, size: float) -> Array:
        """A move cut to the share that is allowed, towards where the stages are, in whole steps."""
        if size <= most * (1.0 + 1e-12):
            return lead
        self.count[rule] += 1
        lead = lead * (most / size)
        steps = np.where(self._resolution > 0.0, self._resolution, 1.0)
        return np.where(self._resolution > 0.0, np.trunc(lead / steps) * steps, lead)

    def _noted(self, rule: str, wanted: Array, allowed: Array) -> Array:
        if not np.array_equal(wanted, allowed):
            self.count[rule] += 1
        return allowed
