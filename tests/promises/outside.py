"""Torque laws that the catalogue has no name for, and the check that none of its names would do."""

import abc
import json
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from benches import KEPT, Bench, Yardstick, machine, tree, yardstick
from hidden import OutOfReach
from scoring import shapes_at

from twin import rotation
from twin.effects import BodyEffect, Domain, Effect, State, parameter
from twin.effects.on_body import TorqueLaw
from twin.platform import Platform

MOST = 0.5
"""Share of a law's evidence that a cause of the catalogue may explain."""
LINES = tuple(np.geomspace(0.02, 2.0, 6).tolist())
"""At which causes that have a frequency are tried against a law [Hz]."""
DEAD = 0.02
"""Half the width of the dead zone [rad]."""


@dataclass(frozen=True)
class Outside(BodyEffect, abc.ABC):
    """A torque law that the catalogue lacks."""

    domain = Domain.torque
    observable = "nothing that the catalogue knows"
    streams = ("gyro", "attitude")


@dataclass(frozen=True)
class Nameless(Outside):
    """A torque about x in proportion to the rates about x and z."""

    name = "nameless"

    size: float = parameter("torque per product of rates", "N m s^2", 3.0, source="any")

    def torque(self, platform: Platform) -> TorqueLaw:
        """See above."""

        def law(state: State) -> np.ndarray:
            torque = np.zeros_like(state.rate)
            torque[:, 0] = self.size * state.rate[:, 0] * state.rate[:, 2]
            return torque

        return law


@dataclass(frozen=True)
class DeadZoneSpring(Outside):
    """A spring on roll and pitch that acts beyond a small angle only."""

    name = "dead_zone_spring"

    stiffness: float = parameter("beyond the dead zone", "N m/rad", 0.01, source="any")

    def torque(self, platform: Platform) -> TorqueLaw:
        """See above."""

        def law(state: State) -> np.ndarray:
            up = rotation.vertical_body(state.position)
            lean = np.stack([up[:, 1], -up[:, 0], np.zeros(len(up))], axis=1)
            return -self.stiffness * np.sign(lean) * np.maximum(np.abs(lean) - DEAD, 0.0)

        return law


@dataclass(frozen=True)
class TiltedFriction(Outside):
    """A viscous friction that is there on one side of level and gone on the other."""

    name = "tilted_friction"

    damping: float = parameter("per sine of the tilt", "N m s", 0.1, source="any")

    def torque(self, platform: Platform) -> TorqueLaw:
        """See above."""

        def law(state: State) -> np.ndarray:
            up = rotation.vertical_body(state.position)
            return -self.damping * up[:, :1] * state.rate

        return law


@dataclass(frozen=True)
class WheelPump(Outside):
    """A torque about x in proportion to the square of the first wheel's speed."""

    name = "wheel_pump"
    streams = ("gyro", "attitude", "wheel_speed")

    size: float = parameter("per square of the speed", "N m s^2", 1e-7, source="any")

    def torque(self, platform: Platform) -> TorqueLaw:
        """See above."""

        def law(state: State) -> np.ndarray:
            torque = np.zeros_like(state.rate)
            torque[:, 0] = self.size * state.wheel_speed[:, 0] ** 2
            return torque

        return law

    def unfit(self, platform: Platform) -> str:
        """No wheels, no torque."""
        return super().unfit(platform) or ("" if platform.wheels else "it has no wheels")


LAWS: tuple[type[Effect], ...] = (Nameless, DeadZoneSpring, TiltedFriction, WheelPump)


@cache
def explained(bench: Bench, law: Effect) -> tuple[float, float, str]:
    """Evidence of a law, the share that one cause of the catalogue could explain, and which.

    A cause may have any strengths within its bounds, and any frequency of `LINES`.
    """
    path = KEPT / f"{bench.file}-{law.name}-{tree()}.json"
    if not path.exists():
        path.write_text(json.dumps(_explained(yardstick(bench), law)), encoding="utf-8")
    whole, share, label = json.loads(path.read_text(encoding="utf-8"))
    return whole, share, label


def _explained(measure: Yardstick, law: Effect) -> tuple[float, float, str]:
    platform = machine(measure.bench)
    shapes = [
        shape
        for effect in measure.effects
        for hertz in LINES
        for shape in shapes_at(effect, hertz, platform)
    ]
    screen, every = measure.beside(*shapes, law)
    last = len(every) - 1
    silent = screen.showing(screen.signature(last, law.values))
    gains = [silent.weigh((i,)).gain if screen.identifiable(i) else 0.0 for i in range(last)]
    whole, worst = silent.weigh((last,)).gain, int(np.argmax(gains))
    return whole, gains[worst] / whole if whole else 0.0, every[worst].label


def law_for(bench: Bench, kind: type[Effect], evidence: float) -> Effect:
    """Of such a size that this evidence remains when the best cause has taken its share.

    Raises:
        OutOfReach: a cause of the catalogue explains more than half of it here, or the base all.
    """
    law = kind.typical()
    if law.unfit(machine(bench)):
        raise OutOfReach(f"{bench.words} cannot have it")
    whole, share, label = explained(bench, law)
    if whole == 0.0:
        raise OutOfReach(f"{law.name} does nothing here that a change of the base does not")
    if share > MOST:
        raise OutOfReach(f"not outside the catalogue here: {label} explains {share:.0%} of it")
    size = float(np.sqrt(evidence / (whole * (1.0 - share))))
    return replace(law, **law.named((law.values * size).tolist()))
