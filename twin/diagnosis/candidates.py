"""Candidates: effects of the catalogue that the logs may show."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.diagnosis.screen import Trace
from twin.effects import (
    BodyEffect,
    Domain,
    Effect,
    ScatterEffect,
    SeriesEffect,
    able,
    catalogue,
    with_effects,
)
from twin.effects.effect import targets
from twin.errors import PlatformError, TwinError
from twin.identification.start import drives
from twin.model import compile_model
from twin.platform import Platform
from twin.predict.body import Body
from twin.predict.columns import SMALL, amplitudes, perturbations_of
from twin.predict.forces import Perturbation

Array = NDArray[np.float64]

SLOWEST = 0.2
"""Lowest frequency of a resonance that is tried [Hz]."""
APART = 0.16
"""Relative spacing of those frequencies: a resonance of damping 0.05 responds over a tenth on
either side."""

OF_PARTS, OF_MACHINES = 1.0, 2.0
"""1 sigma of the size of an effect about its usual one, in decades: of sensors, clocks and drives,
which are alike everywhere, and of torques, which go with machines of 1 to 1000 kg."""
WAVES = 60
"""Waves in a turn of a hinge that are tried, at most: ten in a turn of a motor behind a gear of
6:1."""
_CLOCKS = ("clock_drift", "clock_lag")
_FILTERED = ("sensor_lag",)
"""Candidates only for sensors with a stated filter: on slow signals a filter equals a late
clock."""

_HINGE = ("joint_angle", "joint_rate")
"""Either one determines the motion of a hinge."""
_BALL = ("attitude", "gyro", "inclinometer")
"""Any one determines that of a ball joint."""
_FLOOR = ("heading", "heading_rate")
"""Either one determines the turn of a machine on a floor."""
_GIMBAL = ("gimbal_angle", "gimbal_rate")
"""Either one determines that of a gimbal."""


@dataclass(frozen=True)
class Candidate:
    """An effect as columns of the linearised prediction, one for each amplitude."""

    effect: Effect
    """The effect where it is linearised: at a typical shape, amplitudes 0."""
    perturbations: tuple[Perturbation, ...]
    """One for each amplitude."""
    low: Array
    """(k,) bounds of the amplitudes."""
    high: Array
    looked: float = 0.0
    """See `Trace`."""

    @property
    def label(self) -> str:
        """Label of its effect."""
        return self.effect.label

    @property
    def trace(self) -> Trace:
        """Description for the linear screen."""
        shapes = len(self.effect.values) - len(self.low)
        return Trace(
            self.label,
            self.low,
            self.high,
            shapes,
            looked=self.looked,
            exact=self.effect.exact,
            usual=usual(self.effect)[amplitudes(self.effect)],
            decades=decades(self.effect),
        )


@dataclass(frozen=True)
class Candidates:
    """Effects that are candidates, and those that are not."""

    asked: tuple[Candidate, ...]
    """Candidates, one for each shape of an effect."""
    not_asked: Mapping[str, str]
    """Why an effect is no candidate, by label."""


def candidates_of(bodies: Sequence[Body], own: Sequence[type[Effect]] = ()) -> Candidates:
    """All effects of the catalogue that these logs may show, and those of a lab's `own`."""
    platform = _widest([body.machine.platform for body in bodies])
    candidates: list[Candidate] = []
    not_asked: dict[str, str] = {}
    for kind in (*catalogue(), *own):
        for target in targets(kind.takes, platform) if kind.takes else ("",):
            label = f"{kind.name}:{target}" if target else kind.name
            why = _why_not(kind, target, platform, bodies)
            if why:
                not_asked[label] = why
                continue
            shapes = kind.typical(target).absent().variants(platform)
            looked = float(np.log(len(shapes)))
            result = [replace(candidate(shape, platform), looked=looked) for shape in shapes]
            if not result[0].perturbations:
                not_asked[label] = (
                    "not observable: no scatter beyond chance follows it"
                    if issubclass(kind, ScatterEffect)
                    else "not observable: the prediction does not depend on it"
                )
                continue
            candidates += result
    return Candidates(tuple(candidates), not_asked)


def ringing(
    candidates: Sequence[Candidate], lines: Sequence[float], bodies: Sequence[Body]
) -> tuple[Candidate, ...]:
    """Resonant and periodic effects at given frequencies.

    Args:
        candidates: candidates.
        lines: spectral lines of the residual [Hz].
        bodies: the logs.
    """
    platform, looked = bodies[0].machine.platform, looked_among(bodies)
    return tuple(
        replace(item, looked=looked)
        for known in candidates
        for hertz in lines
        for item in _shaped(known.effect.at_frequency, hertz, platform)
    )


def resonators(candidates: Sequence[Candidate], bodies: Sequence[Body]) -> tuple[Candidate, ...]:
    """Resonant effects at frequencies over the whole spectrum, up to a quarter of the control
    rate."""
    platform, looked = bodies[0].machine.platform, looked_among(bodies)
    fastest = 0.25 / platform.tick
    count = max(int(np.log(fastest / SLOWEST) / APART), 0) + 1
    every = np.geomspace(SLOWEST, fastest, count).tolist()
    return tuple(
        replace(item, looked=looked)
        for known in candidates
        for hertz in every
        for item in _shaped(known.effect.resonating, hertz, platform)
    )


def winding(candidates: Sequence[Candidate], bodies: Sequence[Body]) -> tuple[Candidate, ...]:
    """Effects that make waves around the turn of a hinge, at each number of waves."""
    platform = bodies[0].machine.platform
    return tuple(
        replace(candidate(shape, platform), looked=looked_for(shape, bodies))
        for known in candidates
        for waves in range(1, WAVES + 1)
        for shape in known.effect.with_waves(float(waves))
    )


def looked_for(effect: Effect, bodies: Sequence[Body]) -> float:
    """Logarithm of the number of shapes of an effect that are tried."""
    if effect.winds:
        return float(np.log(WAVES))
    return looked_among(bodies) if effect.rings else 0.0


def looked_among(bodies: Sequence[Body]) -> float:
    """Logarithm of the number of frequencies in the longest stream's spectrum."""
    return float(np.log(max(len(output.time) for body in bodies for output in body.outputs) / 2.0))


def candidate(effect: Effect, platform: Platform) -> Candidate:
    """An effect as a candidate; without perturbations where no prediction depends on it."""
    size = amplitudes(effect)
    low, high = effect.bounds()
    parts = perturbations_of(effect, platform)
    own = tuple(part for part, free in zip(parts, size, strict=True) if free) if parts else ()
    return Candidate(effect, own, low[size], high[size])


def usual(effect: Effect) -> Array:
    """(p,) usual size of each component; the same for all of a vector."""
    scale = effect.scale()
    ends = np.cumsum([0, *(known.size for known in effect.parameters())])
    return np.concatenate(
        [np.full(j - i, scale[i:j].max()) for i, j in zip(ends, ends[1:], strict=False)]
    )


def decades(effect: Effect) -> float:
    """1 sigma of the logarithm of an effect's size about its usual one, to base 10."""
    return OF_MACHINES if effect.domain in (Domain.torque, Domain.exchange) else OF_PARTS


def _shaped(
    shapes: Callable[[float, float], tuple[Effect, ...]], hertz: float, platform: Platform
) -> list[Candidate]:
    """Shapes of an effect at a frequency that effect and machine can have."""
    try:
        result = shapes(hertz, platform.gravity)
    except TwinError:  # beyond the effect's bounds
        return []
    return [candidate(shape, platform) for shape in result if not _refused(shape, platform)]


def _widest(platforms: Sequence[Platform]) -> Platform:
    """The platform in the strongest magnetic field of all logs."""
    return max(platforms, key=lambda platform: float(np.linalg.norm(platform.magnetic_field)))


def _why_not(kind: type[Effect], target: str, platform: Platform, bodies: Sequence[Body]) -> str:
    """Why an effect is no candidate; empty where it is one."""
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
    turned = max(_turned(body) for body in bodies)
    if turned > kind.reach:
        return (
            f"not asked: it is defined up to a turn of {np.degrees(kind.reach):.0f} deg from where "
            f"a log begins, and these turn by {np.degrees(turned):.0f} deg"
        )
    seen = {output.stream for body in bodies for output in body.outputs}
    if kind.name in _CLOCKS and seen == {target} and not _driven(bodies):
        return (
            "not observable: it is the only clock of logs that nothing drives, and its error is "
            "the moment at which they begin and the base's own periods"
        )
    seen |= {name for body in bodies for name in body.inputs.used}
    shown = {"hinge": _HINGE, "planar": _FLOOR}.get(platform.base.kind, _BALL)
    if target in platform.sensors and not any(target in body.recording for body in bodies):
        return f"not observable: needs stream {target}"
    for name in kind.streams:
        enough = _enough(effect, name, shown)
        if not any(item in body.recording for item in enough for body in bodies):
            return f"not observable: needs stream {' or '.join(enough)}"
        if not any(item in seen for item in enough):
            return f"not observable: {' or '.join(enough)} has no part in the prediction"
    return ""


def _turned(body: Body) -> float:
    """Largest turn of a hinge from where its log begins [rad]; 0 of a ball joint."""
    angle = body.motion.position
    return float(np.abs(angle - angle[0]).max()) if angle.shape[1] == 1 else 0.0


def _driven(bodies: Sequence[Body]) -> bool:
    return any(drives(body.recording, body.machine) for body in bodies)


def _enough(effect: Effect, stream: str, shown: tuple[str, ...]) -> tuple[str, ...]:
    """Streams of which any one replaces a stream that an effect needs; `shown` are those of the
    base's turn."""
    own = effect.acts_on if isinstance(effect, ScatterEffect) else ""
    if stream == (effect.stream if isinstance(effect, SeriesEffect) else own):
        return (stream,)
    if stream in _BALL:
        return shown
    return _GIMBAL if stream in _GIMBAL else (stream,)


def _refused(effect: Effect, platform: Platform) -> str:
    """Why a machine cannot have an effect of any size; empty where it can."""
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
