"""Effects of a platform: from what platform.toml or the command line states to objects, and back.

A `Platform` carries its effects as they are stated, so that what a machine is does not depend on
what an effect can do; whoever compiles or simulates it makes them objects here.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from twin.effects.catalogue import effect_named
from twin.effects.effect import Effect, EffectError
from twin.errors import PlatformError, TwinError, UnknownName
from twin.platform import Platform, StatedEffect

FINER = (1, 2, 4, 8, 16, 32)
"""Into how many parts a step may be cut for an effect that needs shorter ones."""


def effects_of(platform: Platform) -> tuple[Effect, ...]:
    """The effects that a platform has.

    Raises:
        PlatformError: platform.toml states one that is unknown, or has a wrong value, with its
            line.
        EffectError: one that the platform cannot have, or twice the same.
    """
    effects = tuple(_effect(stated, platform) for stated in platform.effects)
    labels = [effect.label for effect in effects]
    for label in labels:
        if labels.count(label) > 1:
            raise EffectError(f"{platform.name} has {label} twice; give it once")
    return effects


def with_effects(platform: Platform, effects: Sequence[Effect]) -> Platform:
    """The platform with effects, in addition to those it has.

    Raises:
        EffectError: one that the platform cannot have, or that it has already.
    """
    for effect in effects:
        _refuse_unfit(effect, platform)
    added = tuple(stated(effect) for effect in effects)
    changed = replace(platform, effects=(*platform.effects, *added))
    effects_of(changed)
    return changed


def able(platform: Platform, effect: Effect) -> Platform:
    """The platform, with a shorter step if the effect needs one.

    Raises:
        EffectError: it cannot have it.
    """
    for parts in FINER:
        finer = replace(platform, step=platform.step / parts)
        if not effect.unfit(finer):
            return finer
    raise EffectError(f"{platform.name} cannot have {effect.label}: {effect.unfit(platform)}")


def stated(effect: Effect) -> StatedEffect:
    """An effect as a platform carries it."""
    names = [known.name for known in (*effect.parameters(), *effect.settings())]
    values = {name: getattr(effect, name) for name in names}
    return StatedEffect(effect.name, effect.target, values, made_by=type(effect))


def parse_effects(text: str) -> tuple[Effect, ...]:
    """The effects of a command line: `clock_lag:wheel_speed=0.17,gyro_bias=1e-3/0/0`.

    The numbers are the components of all parameters in their order; without any, the effect has its
    typical size. A lab's own effect is named by the path of its file.

    Raises:
        UnknownName: no such effect.
        EffectError: a wrong number of components, one that is no number, or one out of bounds.
    """
    words = [word.strip() for word in text.split(",")]
    if not any(words):
        raise EffectError("no effect is given; write NAME=VALUE, as in gyro_bias=1e-3/0/0")
    return tuple(_parsed(word) for word in words if word)


def _parsed(word: str) -> Effect:
    label, equals, numbers = word.partition("=")
    name, _, target = label.strip().partition(":")
    kind = effect_named(name)
    if not equals:
        return kind.typical(target)
    try:
        components = [float(number) for number in numbers.split("/")]
    except ValueError:
        raise EffectError(
            f"{word!r}: {numbers!r} are no numbers; write NAME=VALUE/VALUE, as in "
            "gyro_bias=1e-3/0/0"
        ) from None
    return kind(**kind.named(components), target=target)


def _effect(stated: StatedEffect, platform: Platform) -> Effect:
    try:
        kind: Any = stated.made_by or effect_named(stated.name, files_allowed=False)
        known = [entry.name for entry in (*kind.parameters(), *kind.settings())]
        for key in stated.values:
            if key not in known:
                raise UnknownName(f"parameter of {stated.name}", key, known)
        for entry in kind.parameters():
            if entry.name not in stated.values:
                raise EffectError(f"{stated.name} lacks {entry.name} [{entry.unit}]; add it")
        effect = kind(**stated.values, target=stated.target)
        _refuse_unfit(effect, platform)
    except TwinError as problem:
        if stated.line is None:
            raise
        said, _, remedy = str(problem).rpartition("; ")
        raise PlatformError(
            platform.folder / "platform.toml",
            said or str(problem),
            remedy if said else "mend or remove the effect",
            line=stated.line,
        ) from None
    return effect


def _refuse_unfit(effect: Effect, platform: Platform) -> None:
    why = effect.unfit(platform)
    if why:
        raise EffectError(f"{platform.name} cannot have {effect.label}: {why}")
