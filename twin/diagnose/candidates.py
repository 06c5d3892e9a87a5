"""The causes that logs can be asked for: effects of the catalogue that would leave a trace."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.screen import Trace
from twin.effects import (
    BodyEffect,
    Effect,
    ScatterEffect,
    SeriesEffect,
    able,
    catalogue,
    with_effects,
)
from twin.effects.effect import targets
from twin.errors import PlatformError, TwinError
from twin.identify.start import drives
from twin.model import compile_model
from twin.platform import Platform
from twin.predict.body import Body
from twin.predict.columns import SMALL, amplitudes, perturbations_of
from twin.predict.forces import Perturbation

Array = NDArray[np.float64]

SLOWEST = 0.2
"""Frequency from where on what rings is sought [Hz]."""
APART = 0.16
"""Between such frequencies, in parts of them: with a damping of 0.05 it rings to a tenth on either
side."""

WAVES = 60
"""Up to so many in a turn of a hinge are sought: ten in a turn of a motor behind a gear of 6:1."""
_CLOCKS = ("clock_drift", "clock_lag")
_FILTERED = ("sensor_lag",)
"""Asked for only of sensors that have a filter: on slow signals one is as good as a late clock."""

_HINGE = ("joint_angle", "joint_rate")
"""Either tells the motion of a hinge."""
_BALL = ("attitude", "gyro", "inclinometer")
"""Any tells that of a ball, and effects name those in which they show best."""
_GIMBAL = ("gimbal_angle", "gimbal_rate")
"""Either tells the motion of a gimbal."""


@dataclass(frozen=True)
class Candidate:
    """One cause, as it enters the linearised prediction: an effect by its amplitudes."""

    effect: Effect
    """Where it is linearised: at a typical shape, its amplitudes 0."""
    perturbations: tuple[Perturbation, ...]
    """One an amplitude."""
    low: Array
    """(k,) of the amplitudes."""
    high: Array
    looked: float = 0.0
    """See `Trace`."""

    @property
    def label(self) -> str:
        """Of its effect."""
        return self.effect.label

    @property
    def trace(self) -> Trace:
        """For weighing; a fit of it would set its shape too."""
        shapes = len(self.effect.values) - len(self.low)
        exact = self.effect.exact
        return Trace(self.label, self.low, self.high, shapes, looked=self.looked, exact=exact)


@dataclass(frozen=True)
class Candidates:
    """What can be asked, and what cannot."""

    asked: tuple[Candidate, ...]
    """A cause of which several shapes are tried is there once for each."""
    not_asked: Mapping[str, str]
    """Why, by label."""


def candidates_of(bodies: Sequence[Body]) -> Candidates:
    """Everything in the catalogue, held against what these logs hold."""
    platform = _widest([body.machine.platform for body in bodies])
    asked: list[Candidate] = []
    not_asked: dict[str, str] = {}
    for kind in catalogue():
        for target in targets(kind.takes, platform) if kind.takes else ("",):
            label = f"{kind.name}:{target}" if target else kind.name
            why = _why_not(kind, target, platform, bodies)
            if why:
                not_asked[label] = why
                continue
            usual = kind.typical(target).absent()
            found = candidate(usual, platform)
            if not found.perturbations:
                not_asked[label] = (
                    "not observable: no scatter beyond chance follows it"
                    if issubclass(kind, ScatterEffect)
                    else "not observable: the prediction does not depend on it"
                )
                continue
            asked.append(found)
    return Candidates(tuple(asked), not_asked)


def ringing(
    asked: Sequence[Candidate], lines: Sequence[float], bodies: Sequence[Body]
) -> tuple[Candidate, ...]:
    """Those that ring or push at one frequency, there where what a model leaves stands out [Hz]."""
    platform, looked = bodies[0].machine.platform, looked_among(bodies)
    return tuple(
        replace(one, looked=looked)
        for known in asked
        for hertz in lines
        for one in _shaped(known.effect.at_frequency, hertz, platform)
    )


def resonators(asked: Sequence[Candidate], bodies: Sequence[Body]) -> tuple[Candidate, ...]:
    """Those that ring, at frequencies all over the spectrum; faster, each command that kicks them
    lasts several periods."""
    platform, looked = bodies[0].machine.platform, looked_among(bodies)
    fastest = 0.25 / platform.tick
    count = max(int(np.log(fastest / SLOWEST) / APART), 0) + 1
    every = np.geomspace(SLOWEST, fastest, count).tolist()
    return tuple(
        replace(one, looked=looked)
        for known in asked
        for hertz in every
        for one in _shaped(known.effect.resonating, hertz, platform)
    )


def winding(asked: Sequence[Candidate], bodies: Sequence[Body]) -> tuple[Candidate, ...]:
    """Those that make waves around the turn of a hinge, any number of them."""
    platform = bodies[0].machine.platform
    return tuple(
        replace(candidate(shape, platform), looked=looked_for(shape, bodies))
        for known in asked
        for waves in range(1, WAVES + 1)
        for shape in known.effect.with_waves(float(waves))
    )


def looked_for(effect: Effect, bodies: Sequence[Body]) -> float:
    """Logarithm of how many shapes an effect is looked for in."""
    if effect.winds:
        return float(np.log(WAVES))
    return looked_among(bodies) if effect.rings else 0.0


def looked_among(bodies: Sequence[Body]) -> float:
    """Logarithm of how many frequencies could stand out of what a model leaves: those of the
    longest stream's spectrum."""
    return float(np.log(max(len(output.time) for body in bodies for output in body.outputs) / 2.0))


def candidate(effect: Effect, platform: Platform) -> Candidate:
    """An effect of some shape as a candidate; without perturbations where it has no trace."""
    size = amplitudes(effect)
    low, high = effect.bounds()
    parts = perturbations_of(effect, platform)
    own = tuple(one for one, free in zip(parts, size, strict=True) if free) if parts else ()
    return Candidate(effect, own, low[size], high[size])


def _shaped(
    shapes: Callable[[float, float], tuple[Effect, ...]], hertz: float, platform: Platform
) -> list[Candidate]:
    """An effect's shapes at a frequency, but those that the machine, or the effect, cannot have."""
    try:
        found = shapes(hertz, platform.gravity)
    except TwinError:  # beyond the effect's bounds
        return []
    return [candidate(shape, platform) for shape in found if not _refused(shape, platform)]


def _widest(platforms: Sequence[Platform]) -> Platform:
    """The machine where it can have most: in the strongest field that logs were measured in."""
    return max(platforms, key=lambda one: float(np.linalg.norm(one.magnetic_field)))


def _why_not(kind: type[Effect], target: str, platform: Platform, bodies: Sequence[Body]) -> str:
    """Why logs cannot be asked for a cause; empty where they can."""
    effect = kind.typical(target).absent()
    refused = _refused(effect, platform)
    if refused:
        return f"not possible here: {refused}"
    if effect.label in [stated.label for stated in bodies[0].machine.effects]:
        return "part of the model already"
    hidden = effect.hidden_from(platform)
    if hidden:
        return f"not observable: {hidden}"
    if kind.name in _FILTERED and np.isinf(platform.sensors[target].cutoff):
        return "not asked: the platform states no filter there, and without one it is a clock_lag"
    seen = {output.stream for body in bodies for output in body.outputs}
    if kind.name in _CLOCKS and seen == {target} and not _driven(bodies):
        return (
            "not observable: it is the only clock of logs that nothing drives, and its error is "
            "the moment at which they begin and the base's own periods"
        )
    seen |= {name for body in bodies for name in body.inputs.used}
    hinge = platform.base.kind == "hinge"
    if target in platform.sensors and not any(target in body.recording for body in bodies):
        return f"not observable: needs stream {target}"
    for name in kind.streams:
        enough = _enough(effect, name, hinge=hinge)
        if not any(one in body.recording for one in enough for body in bodies):
            return f"not observable: needs stream {' or '.join(enough)}"
        if not any(one in seen for one in enough):
            return f"not observable: {' or '.join(enough)} has no part in the prediction"
    return ""


def _driven(bodies: Sequence[Body]) -> bool:
    return any(drives(body.recording, body.machine) for body in bodies)


def _enough(effect: Effect, stream: str, *, hinge: bool) -> tuple[str, ...]:
    """Streams of which any tells what an effect needs of one."""
    own = effect.acts_on if isinstance(effect, ScatterEffect) else ""
    if stream == (effect.stream if isinstance(effect, SeriesEffect) else own):
        return (stream,)
    if stream in _BALL:
        return _HINGE if hinge else _BALL
    return _GIMBAL if stream in _GIMBAL else (stream,)


def _refused(effect: Effect, platform: Platform) -> str:
    """Why a machine cannot have an effect, be it small; empty where it can."""
    try:
        finer = able(platform, effect)
        if isinstance(effect, BodyEffect):
            first = np.where(amplitudes(effect), SMALL * effect.scale(), effect.values)
            compile_model(with_effects(finer, (effect.with_values(first),)))
    except PlatformError:
        return f"{platform.name} is too light or too thin to hold such a part"
    except TwinError as problem:
        said = str(problem)
        return said.partition(f" cannot have {effect.label}: ")[2] or said
    return ""
