"""The effects that a platform states, as a prediction has them beside its model: at their size.

What an effect changes in MuJoCo's model, the compiled machine has already, and a drive's fault the
drive's profile. What is left is a torque law, a push with axes of the room, a fault of a command,
of a sensor or of a clock.
"""

from collections.abc import Callable
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from twin.effects import BodyEffect, CoupleEffect, Effect, SeriesEffect
from twin.platform import Platform
from twin.predict.body import Body
from twin.predict.effects.columns import perturbations_of, strengths_of
from twin.predict.effects.forces import pushed_along
from twin.predict.effects.machine import depends_on_start
from twin.predict.effects.perturbation import Perturbation
from twin.predict.effects.reference import references_of

Array = NDArray[np.float64]

OF_DRIVES = ("command_stage_position", "command_gimbal_rate")
"""Commands whose faults the drives' profiles have."""


Stated = tuple[tuple[Perturbation, ...], Array]

_stated: WeakKeyDictionary[Body, Stated] = WeakKeyDictionary()
_rests: WeakKeyDictionary[Body, tuple[Perturbation, ...]] = WeakKeyDictionary()


def stated_of(body: Body) -> Stated:
    """What the platform of a log's machine states, and the strengths (a,) of it."""
    if body not in _stated:
        every = [_parts(effect, body.machine.platform) for effect in body.machine.effects]
        parts = tuple(one for found, _ in every for one in found)
        _stated[body] = parts, np.array([size for _, sizes in every for size in sizes])
    return _stated[body]


def rests_of(body: Body) -> tuple[Perturbation, ...]:
    """Where the springs of what is stated rest, if that is where the log began: about each axis."""
    if body not in _rests:
        found = [part for one in body.machine.effects for part in references_of(one, [body])]
        _rests[body] = tuple(replace(one, force=_once(one.force)) for one in found if one.force)
    return _rests[body]


def _parts(effect: Effect, platform: Platform) -> tuple[list[Perturbation], list[float]]:
    if isinstance(effect, BodyEffect) and not depends_on_start(effect):
        law = effect.torque(platform)
        pushes = isinstance(effect, CoupleEffect) or effect.pushes(platform)
        one = Perturbation(
            effect.label,
            "1",
            force=_once(lambda body: pushed_along(effect, body)) if pushes else None,
            laws=() if law is None else ((1.0, law),),
        )
        return [one], [1.0]
    if isinstance(effect, SeriesEffect) and effect.stream in OF_DRIVES:
        return [], []
    parts = perturbations_of(effect, platform)
    once = [one if one.force is None else replace(one, force=_once(one.force)) for one in parts]
    return once, strengths_of(effect).tolist() if parts else []


def _once(force: Callable[[Body], Array]) -> Callable[[Body], Array]:
    """Whoever poses the same log again asks again."""
    known: WeakKeyDictionary[Body, Array] = WeakKeyDictionary()

    def remembered(body: Body) -> Array:
        if body not in known:
            known[body] = force(body)
        return known[body]

    return remembered
