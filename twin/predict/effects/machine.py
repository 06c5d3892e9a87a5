"""A machine as a prediction has it: without what depends on how a run began."""

from dataclasses import replace

from twin.effects import BodyEffect, Effect, effects_of
from twin.model import Machine, compile_model
from twin.platform import Platform


def predicted_machine(platform: Platform) -> Machine:
    """The machine that a log is predicted with.

    A part that hangs on it moves by itself, and a spring may be at rest where the log began:
    neither is a state of the prediction, which begins anew with each segment. Such an effect is
    left out of the model, and pushes it as `stated.py` says.

    Raises:
        PlatformError, EffectError: as `compile_model`.
    """
    machine = compile_model(modelled(platform))
    return replace(machine, platform=platform, effects=effects_of(platform))


def modelled(platform: Platform) -> Platform:
    """The platform without such effects."""
    pairs = zip(platform.effects, effects_of(platform), strict=True)
    stays = tuple(stated for stated, effect in pairs if not depends_on_start(effect))
    return replace(platform, effects=stays)


def depends_on_start(effect: Effect) -> bool:
    """Whether what it does depends on how a run began."""
    return isinstance(effect, BodyEffect) and (effect.hangs_on or effect.follows_start)
