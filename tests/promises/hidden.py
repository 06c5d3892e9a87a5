"""Effects hidden at random in simulated logs, as large as a wanted evidence makes them.

The evidence that a perfect method would have is the squared length of the effect's whitened
signature, the base projected out. The machine that is simulated is not the one that is believed:
its J and m r are off, and it moves on half the step.
"""

from dataclasses import dataclass, replace

import numpy as np
from benches import LIBRARY, Bench, Yardstick, believed, flown, machine, yardstick

from twin.contrast import difference
from twin.effects import BiasEffect, Effect, Order, SeriesEffect, able, catalogue, with_effects
from twin.effects.effect import EffectError, targets
from twin.errors import TwinError
from twin.model import compile_model
from twin.platform import Platform, load_platform
from twin.predict.columns import BLIND, amplitudes
from twin.recording import Recording

UNSEEN = (*BLIND, "stage_vibration")
"""Kinds that no bench can show: what turns with a wheel, and what only adds noise."""
FREQUENCIES = {"flexible_appendage": (0.3, 5.0), "room_draft": (0.02, 0.5)}
"""Bounds of what is drawn [Hz]; a slosh's is its length's."""
LENGTHS = (0.02, 0.5)
"""[m]."""
TRIES = 20
"""Shapes, signs and directions, before an effect is too large for its bounds."""
CLOSE = 0.2
"""Share of its evidence to which a size is sought."""
RESIZED = 6
"""Times that a size is sought."""
PLAIN = 0.05
"""Share of a column that must be left beside the base for a size to be had by proportion: less is
another in another run, or the error of a linearised base."""
ENOUGH = 0.5
"""Share of its evidence that readings with and without an effect must differ by."""


@dataclass(frozen=True)
class Hidden:
    """A log with a secret."""

    bench: Bench
    seed: int
    effects: tuple[Effect, ...]
    log: Recording
    believed: Platform
    """The machine as its owners think it is."""


class OutOfReach(Exception):
    """What was drawn cannot be hidden; says why."""


def kinds() -> list[str]:
    """Of the whole catalogue, those that a bench could show."""
    return [kind.name for kind in catalogue() if kind.name not in UNSEEN]


def graded(bench: Bench, grade: str, *, long: bool) -> Bench:
    """The same, measured otherwise."""
    rate, duration = (100.0, 300.0) if long else (50.0, 120.0)
    return replace(bench, grade=grade, rate=rate, duration=duration)


def bench_for(
    kind: str, grade: str, rng: np.random.Generator, *, long: bool = False
) -> Bench | None:
    """A bench at random among those that show a kind of effect; None where none does."""
    takes = {one.name: one.takes for one in catalogue()}[kind]
    for index in rng.permutation(len(LIBRARY)).tolist():
        bench = graded(LIBRARY[index], grade, long=long)
        if takes and not targets(takes, load_platform(bench.platform)):
            continue
        try:
            measure = yardstick(bench)
        except TwinError:
            continue
        if labels_of(measure, kind):
            return bench
    return None


def labels_of(measure: Yardstick, kind: str) -> list[str]:
    """What a bench shows of a kind, once for each target."""
    return sorted({label for label in measure.labels if _kind(label) == kind})


def _kind(label: str) -> str:
    return label.partition(":")[0]


def shaped(effect: Effect, rng: np.random.Generator) -> Effect:
    """Of a random frequency, place or axis, where the effect has one."""
    if effect.name == "flexible_appendage":
        axis = rng.standard_normal(3)
        return replace(
            effect,
            frequency=_log_uniform(FREQUENCIES[effect.name], rng),
            damping_ratio=_log_uniform((0.005, 0.05), rng),
            axis=tuple((axis / np.linalg.norm(axis)).tolist()),
        )
    if effect.name == "liquid_slosh":
        return replace(
            effect,
            length=_log_uniform(LENGTHS, rng),
            damping_ratio=_log_uniform((0.005, 0.05), rng),
            pivot=tuple(rng.uniform(-0.2, 0.2, 3).tolist()),
        )
    if effect.name == "room_draft":
        return replace(
            effect,
            point=tuple(rng.uniform(-0.3, 0.3, 3).tolist()),
            frequency=_log_uniform(FREQUENCIES[effect.name], rng),
            phase=float(rng.uniform(-3.0, 3.0)),
        )
    return effect


def _log_uniform(ends: tuple[float, float], rng: np.random.Generator) -> float:
    low, high = np.log(ends)
    return float(np.exp(rng.uniform(low, high)))


def drawn(bench: Bench, label: str, evidence: float, rng: np.random.Generator) -> Effect:
    """An effect of a random shape in a random direction, of a size with that evidence.

    Raises:
        OutOfReach: that size is beyond its bounds.
    """
    measure = yardstick(bench)
    screen, index = measure.screen, measure.labels.index(label)
    effect = shaped(measure.effects[index], rng)
    if effect != measure.effects[index]:
        screen, every = measure.beside(effect)
        index = len(every) - 1
    size = amplitudes(effect)
    low, high = effect.bounds()
    scale = effect.scale()[size]
    values = effect.values
    for _ in range(TRIES):
        direction = rng.uniform(0.3, 1.0, len(scale)) * scale
        two_sided = low[size] < 0.0
        direction = direction * np.where(two_sided, rng.choice([-1.0, 1.0], len(scale)), 1.0)
        # a wheel's turn about its own axis is none: what no log shows stays absent
        direction = np.where(screen.identifiability(index) > 0.0, direction, 0.0)
        shown = float(np.linalg.norm(screen.signature(index, direction)))
        values[size] = direction * np.sqrt(evidence) / shown
        if np.all(values >= low) and np.all(values <= high):
            found = _possible(bench, effect.with_values(values))
            share = screen.identifiability(index)[direction != 0.0]
            plain = isinstance(effect, BiasEffect) or float(share.min(initial=1.0)) > PLAIN
            sized = plain and _proportional(found)
            return found if sized else _resized(bench, found, evidence)
    raise OutOfReach(f"not detectable here: {label} at {evidence:g} is beyond its bounds")


def _proportional(effect: Effect) -> bool:
    """Whether twice as much of an effect does twice as much: a heavy panel rings faster, what a
    stage's counter shows of its fault is known, but for a digit, and a stream that is later than
    its signal is long is no more wrong for being later still."""
    series = isinstance(effect, SeriesEffect)
    bent = series and (effect.order is Order.delay or effect.stream == "command_stage_position")
    return bool(amplitudes(effect).all()) and not bent


def _resized(bench: Bench, effect: Effect, evidence: float) -> Effect:
    """Of the size that has that evidence in a run with it.

    Raises:
        OutOfReach: none near it has.
    """
    size = amplitudes(effect)
    for _ in range(RESIZED):
        try:
            shown = yardstick(bench).evidence(effect)
        except TwinError as problem:
            raise OutOfReach(f"not detectable here: {effect.label}: {problem}") from problem
        if shown <= 0.0:
            break
        if abs(np.log(shown / evidence)) < CLOSE:
            return effect
        values = effect.values
        values[size] *= np.sqrt(evidence / shown)
        values = np.clip(values, *effect.bounds())
        if np.array_equal(values, effect.values):
            break
        effect = _possible(bench, effect.with_values(values))
    raise OutOfReach(f"not detectable here: no {effect.label} has evidence {evidence:g}")


def _possible(bench: Bench, effect: Effect) -> Effect:
    """The effect.

    Raises:
        OutOfReach: no such machine can be.
    """
    platform = machine(bench)
    try:
        compile_model(with_effects(able(platform, effect), (effect,)))
    except TwinError as problem:
        raise OutOfReach(f"not detectable here: {effect.label}: {problem}") from problem
    return effect


def any_of(bench: Bench, evidence: float, rng: np.random.Generator, kind: str = "") -> Effect:
    """Any effect that this bench shows, or any of a kind, of a size with that evidence."""
    measure = yardstick(bench)
    while True:
        which = kind or rng.choice(sorted({_kind(label) for label in measure.labels}))
        label = str(rng.choice(labels_of(measure, which)))
        try:
            return drawn(bench, label, evidence, rng)
        except OutOfReach:
            if kind:
                raise


def hide(bench: Bench, effects: tuple[Effect, ...], seed: int) -> Hidden:
    """A log with these effects.

    Raises:
        OutOfReach: the machine cannot have them, or hits a stop with them.
    """
    try:
        log = flown(bench, effects, seed)
    except EffectError as problem:
        raise OutOfReach(f"the machine cannot have it: {problem}") from problem
    if log is None:
        raise OutOfReach("with it the machine hits its stop, or its wheels their limits")
    return Hidden(bench, seed, effects, log, believed(bench, np.random.default_rng([seed, 1])))


def check_shown(secret: Hidden, evidence: float) -> None:
    """Of half that evidence at least, readings with and without the effects must differ.

    The size was drawn along the motion of a machine without them; friction that brings a wheel to
    rest does far less than there.

    Raises:
        OutOfReach: no method could have it.
    """
    quiet = flown(secret.bench, (), secret.seed)
    most = np.inf if quiet is None else _apart(machine(secret.bench), quiet, secret.log)
    if most < ENOUGH * evidence:
        names = " and ".join(effect.label for effect in secret.effects)
        raise OutOfReach(f"{names} changes nothing: of {evidence:g} no more than {most:.2g}")


def _apart(platform: Platform, one: Recording, other: Recording) -> float:
    """Squared difference, in standard deviations of the noise, which is the same in both; inf where
    the clocks differ, or what has no noise: a control law that answers to an effect hides it from
    the sensors, and shows it by its commands."""
    total = 0.0
    for name in (name for name in one if name.startswith("command_")):
        if not np.array_equal(one[name].value, other[name].value):
            return np.inf
    for name, sensor in platform.sensors.items():
        if name not in one or name not in other:
            continue
        if not np.array_equal(one[name].time, other[name].time):
            return np.inf
        noise = np.hypot(sensor.noise, sensor.resolution / np.sqrt(12.0))
        change = difference(name, one[name], other[name], one[name].time)
        with np.errstate(divide="ignore", invalid="ignore"):
            total += float(np.nansum((change / noise) ** 2))
    return total
