"""Runs of one batch that differ in their effects or in their centre of mass.

Runs of one batch whose machines differ in the values of their effects.
What an effect changes in MuJoCo's model is compiled run by run, and each run gets the fields in
which its model differs. What it does in NumPy is done for all runs at once: its parameters become
arrays with the runs in front. Nobody declares that an effect's code can take those: a trial holds
it against each run alone, bit for bit.
"""

import copy
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch
from numpy.typing import NDArray

from twin.effects import (
    BodyEffect,
    Effect,
    EffectError,
    Order,
    ReadingEffect,
    ScatterEffect,
    SeriesEffect,
    State,
)
from twin.effects.stated import stated
from twin.errors import UsageError
from twin.model import Machine, MassProperties, compile_model, set_mass_properties
from twin.platform import Platform
from twin.rotation import normalized
from twin.signals import Samples

Array = NDArray[np.float64]


_FIELDS = ("body_mass", "body_ipos", "body_iquat", "body_inertia", "body_sameframe")
"""Of MuJoCo's model: what `set_mass_properties` writes."""


def set_offsets(batch: Batch, machine: Machine, offsets: Array) -> None:
    """Give each run of a batch its own m r; mass and J about the CR stay.

    Args:
        batch: of the machine's model.
        machine: as its platform states it.
        offsets: (n, 3) m r at stage position 0 [kg m, body].

    Raises:
        UsageError: no rigid body has such an offset and the stated inertia.
    """
    views = {name: batch.expand(name) for name in _FIELDS}
    platform = machine.platform
    frames = np.empty_like(views["body_sameframe"])
    for run, offset in enumerate(offsets):
        model = copy.copy(machine.model)
        try:
            set_mass_properties(
                model, machine.base_body, MassProperties(platform.mass, platform.inertia, offset)
            )
        except ValueError as problem:
            raise UsageError(
                f"no rigid body has m r = {offset} kg m and the inertia of {platform.name}: "
                f"{problem}"
            ) from None
        for name, view in views.items():
            view[run] = getattr(model, name)
        frames[run] = model.body_sameframe
    batch.set_const()
    # which takes a centre of mass within 1e-6 m of its body's origin to lie there
    views["body_sameframe"][:] = frames


_TRIALS = 5
"""Runs of a trial: as many as no stream has columns."""
_SAMPLES = 2


def give_each(
    batch: Batch,
    machine: Machine,
    each: Sequence[Sequence[Effect]],
    offsets: Array | None,
) -> tuple[tuple[Effect, ...], list[mujoco.MjModel]]:
    """Give each run of a batch its own effects.

    Whether a run is compiled depends on the kinds of its effects and never on its company.

    Args:
        batch: of the machine's model.
        machine: of all runs.
        each: (n,) effects of each run, alike but for their values.
        offsets: (3,) or (n, 3) m r at stage position 0 [kg m]; None: as the platform states.

    Returns:
        Those effects for all runs at once, and the model of each run (none where they are alike).

    Raises:
        PlatformError: no rigid body has these mass properties.
        EffectError: values that cannot differ from run to run.
    """
    platform, models = machine.platform, list[mujoco.MjModel]()
    if any(isinstance(item, BodyEffect) and item.changes_machine for item in each[0]):
        given = None if offsets is None else np.broadcast_to(offsets, (len(each), 3))
        compiled: dict[tuple[bytes, ...], Machine] = {}
        for run, effects in enumerate(each):
            moment = platform.center_of_mass_offset if given is None else given[run]
            key = (moment.tobytes(), *(item.values.tobytes() for item in effects))
            if key not in compiled:
                varied = tuple(stated(effect) for effect in effects)
                compiled[key] = compile_model(
                    replace(platform, effects=varied, center_of_mass_offset=np.array(moment))
                )
            _set_fields(batch, run, machine.model, compiled[key].model)
            models.append(compiled[key].model)
    elif offsets is not None:
        set_offsets(batch, machine, np.broadcast_to(offsets, (len(each), 3)))
    return tuple(stacked(same, platform) for same in zip(*each, strict=True)), models


def _set_fields(batch: Batch, run: int, common: mujoco.MjModel, varied: mujoco.MjModel) -> None:
    for name in _fields(common):
        value = getattr(varied, name)
        if not np.array_equal(value, getattr(common, name)):
            batch.expand(name)[run] = value
    if not np.array_equal(varied.opt.gravity, common.opt.gravity):
        batch.expand("opt.gravity")[run] = varied.opt.gravity


def stacked(effects: Sequence[Effect], platform: Platform) -> Effect:
    """One effect for all runs of a batch, whose parameters are arrays with the runs in front.

    Args:
        effects: (n,) of each run, alike but for their values.
        platform: of all runs.

    Raises:
        EffectError: its code cannot do so, or its values must not differ from run to run.
    """
    first = effects[0]
    why = cannot_differ(first, platform)
    axes = None if why else _axes(first, platform)
    if axes is not None:
        return _with_axes(effects, axes)
    if not all(np.array_equal(effect.values, first.values) for effect in effects):
        raise EffectError(f"{why}; give it one value")
    return first


def cannot_differ(effect: Effect, platform: Platform) -> str:
    """Why its values cannot differ from run to run, as a sentence; empty where they can."""
    if isinstance(effect, SeriesEffect) and effect.order >= Order.delay:
        return (
            f"the runs of a batch share one sampling schedule, so {effect.label} is the same "
            "in all of them"
        )
    turns = isinstance(effect, BodyEffect) and "edit_thruster" in vars(type(effect))
    if turns and platform.thrusters:
        return f"{effect.label} turns a thruster, which a batch has once for all its runs"
    if _axes(effect, platform) is None:
        return f"{effect.label} computes with one value for all runs of a batch"
    return ""


def _fields(model: mujoco.MjModel) -> list[str]:
    names = sorted(name for name in MODEL_FIELDS if not name.startswith("opt."))
    return [name for name in names if isinstance(getattr(model, name, None), np.ndarray)]


def _axes(effect: Effect, platform: Platform) -> int | None:
    """How many axes stand behind the runs' in a number of its stacked parameters."""
    tries = _spread(effect)
    for axes in (2, 1):
        try:
            with np.errstate(all="ignore"):
                whole = _outcome(_with_axes(tries, axes), platform, np.arange(_TRIALS))
                parts = [
                    # in company: a lone row may have other last bits
                    _outcome(item, platform, np.array([row, row]))[:1]
                    for row, item in enumerate(tries)
                ]
        except (ValueError, TypeError, IndexError):
            continue
        if np.array_equal(whole, np.concatenate(parts), equal_nan=True):
            return axes
    return None


def _spread(effect: Effect) -> list[Effect]:
    """The effect at some other values within its bounds."""
    low, high = effect.bounds()
    typical = type(effect).typical(effect.target).values
    sizes = np.linspace(0.4, 1.2, _TRIALS)
    return [effect.with_values(np.clip(size * typical, low, high)) for size in sizes]


def _with_axes(effects: Sequence[Effect], axes: int) -> Effect:
    whole = copy.copy(effects[0])
    for known in whole.parameters():
        values = np.array([getattr(effect, known.name) for effect in effects], dtype=np.float64)
        inner = values.shape[1:] or (1,)
        shape = (len(effects), *(1,) * (axes - 1), *inner)
        object.__setattr__(whole, known.name, values.reshape(shape))
    return whole


def _outcome(effect: Effect, platform: Platform, rows: NDArray[np.intp]) -> Array:
    """What an effect's code makes of random input in some of the trial's runs."""
    draw = np.random.default_rng(7)

    def random(*shape: int) -> Array:
        return draw.normal(size=(_TRIALS, *shape))[rows]

    if isinstance(effect, SeriesEffect):
        width = len(platform.columns(effect.stream))
        time = np.broadcast_to(np.arange(3.0 * _SAMPLES), (_TRIALS, 3 * _SAMPLES))[rows]
        act, shown = effect.live(platform), list[Array]()
        for block in range(3):
            part = slice(block * _SAMPLES, (block + 1) * _SAMPLES)
            value = 1e-3 * random(_SAMPLES, width)
            value = normalized(value) if effect.stream == "attitude" else value
            stamp = time[:, part].copy()
            shown.append(act(Samples(value, stamp, np.ones(stamp.shape, dtype=np.bool_))).value)
        return np.concatenate(shown, axis=1)
    if isinstance(effect, ScatterEffect):
        cause = random(_SAMPLES, len(platform.stages) or 3)
        return np.broadcast_to(effect.sigma(cause, platform), (len(cause), _SAMPLES, 1))
    hinge = platform.base.kind == "hinge"
    shown = [np.zeros((len(rows), 1))]
    if isinstance(effect, ReadingEffect):
        position = random(_SAMPLES, 1) if hinge else normalized(random(_SAMPLES, 4))
        rate = random(_SAMPLES, 1 if hinge else 3)
        shown += [
            effect.error(read, position, rate).reshape(len(rows), -1) for read in effect.reads
        ]
    if isinstance(effect, BodyEffect):
        position = random(1) if hinge else normalized(random(4))
        rate, speed = random(1 if hinge else 3), random(len(platform.wheels))
        state = State(position, rate, speed, 0.5 + rows.astype(np.float64))
        laws = (effect.torque(platform), effect.mass_moment(platform))
        shown += [law(state) for law in laws if law is not None]
    return np.concatenate(shown, axis=1)
