"""What an effect is: one way in which reality departs from a machine's model.

A frozen dataclass whose fields are its parameters. A parameter's unit, bounds, typical size and
source are declared once, with `parameter`; simulation, fit, dispersion, command line and documents
read them from there.
"""

import abc
import inspect
import math
from collections.abc import Sequence
from dataclasses import Field, dataclass, field, fields, replace
from enum import Enum
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.platform import Platform
from twin.units import printed


class EffectError(UsageError):
    """An effect with a wrong value, or one that a platform cannot have."""


Array = NDArray[np.float64]
Value = float | tuple[float, ...]
Target = Literal["", "stream", "wheel", "stage", "gimbal", "thruster"]
"""What an effect is aimed at."""

_XYZ = ("x", "y", "z")


class Domain(Enum):
    """Where an effect lives."""

    torque = "external torque"
    """It changes the machine's angular momentum."""
    exchange = "exchange inside"
    """It moves momentum between the machine's own parts."""
    sensor = "sensor"
    clock = "clock"
    actuator = "actuator"
    """It stands between a command and what the machine does."""


@dataclass(frozen=True)
class Parameter:
    """One field of an effect: a number or a vector that can be fitted."""

    name: str
    words: str
    """What it is."""
    unit: str
    """SI."""
    typical: Value
    """A size that labs meet."""
    source: str
    """Of the typical size."""
    low: float
    high: float
    """Bounds of every component."""
    amplitude: bool
    """Whether the effect is gone where this is 0."""

    @property
    def size(self) -> int:
        """Number of components."""
        return len(self.typical) if isinstance(self.typical, tuple) else 1

    @property
    def names(self) -> tuple[str, ...]:
        """One a component."""
        if not isinstance(self.typical, tuple):
            return (self.name,)
        ends = _XYZ if self.size == 3 else tuple(str(i) for i in range(self.size))
        return tuple(f"{self.name}_{end}" for end in ends)


def parameter(
    words: str,
    unit: str,
    typical: Value,
    *,
    source: str,
    low: float = -math.inf,
    high: float = math.inf,
    amplitude: bool = True,
) -> Any:
    """Declare a parameter: the default of a field of an effect's dataclass.

    Args:
        words: what it is.
        unit: SI.
        typical: a size that labs meet; a tuple where the parameter is a vector.
        source: of the typical size.
        low: of every component.
        high: of every component.
        amplitude: whether the effect is gone where this is 0.
    """
    facts = (words, unit, typical, source, low, high, amplitude)
    return field(metadata={"parameter": facts})


@dataclass(frozen=True)
class Effect(abc.ABC):
    """One cause. Subclasses are final: `BodyEffect`, `SeriesEffect`,
    `ReadingEffect` or `ScatterEffect` above them.

    Raises:
        EffectError: a parameter with the wrong number of components, not finite, or out of bounds.
    """

    name: ClassVar[str]
    """Canonical (docs/design.md 4.4); also that of its file."""
    domain: ClassVar[Domain]
    observable: ClassVar[str]
    """What gives it away in a log."""
    streams: ClassVar[tuple[str, ...]]
    """Streams without which it cannot be seen."""
    takes: ClassVar[Target] = ""
    """What it is aimed at, if at anything: a stream, or a part (no target: all of them)."""
    exact: ClassVar[bool] = False
    """Whether what it does to a log is linear in its size: what distinguishes it from a change of
    the base, however little, is then what platform.toml states and no linearisation's error."""

    reach: ClassVar[float] = math.inf
    """Largest turn of a hinge from where a log begins up to which it is defined [rad]."""

    target: str = field(default="", kw_only=True)
    """The stream or part it acts on."""

    def __post_init__(self) -> None:
        for known in self.parameters():
            object.__setattr__(self, known.name, self._checked(known, getattr(self, known.name)))

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """In the order of the fields."""
        return tuple(
            Parameter(entry.name, *entry.metadata["parameter"])
            for entry in fields(cls)
            if "parameter" in entry.metadata
        )

    @classmethod
    def settings(cls) -> "tuple[Field[Any], ...]":
        """Fields that are chosen and never fitted."""
        return tuple(
            entry
            for entry in fields(cls)
            if "parameter" not in entry.metadata and entry.name != "target"
        )

    @classmethod
    def typical(cls, target: str = "") -> Self:
        """The effect at its typical size."""
        return cls(**{known.name: known.typical for known in cls.parameters()}, target=target)

    @classmethod
    def meaning(cls) -> str:
        """The first line of its docstring."""
        return (inspect.getdoc(cls) or "").partition("\n")[0]

    @property
    def label(self) -> str:
        """`clock_lag:wheel_speed`: its name and its target."""
        return f"{self.name}:{self.target}" if self.target else self.name

    @property
    def names(self) -> tuple[str, ...]:
        """(p) names of all components."""
        return tuple(name for known in self.parameters() for name in known.names)

    @property
    def values(self) -> Array:
        """(p,) all components, SI."""
        return np.concatenate(
            [np.atleast_1d(getattr(self, known.name)) for known in self.parameters()]
        )

    def with_values(self, values: Array) -> Self:
        """The same effect with other components (p,).

        Raises:
            EffectError: wrong number, not finite, or out of bounds.
        """
        return replace(self, **self.named(values.tolist()))

    @classmethod
    def named(cls, components: Sequence[float]) -> dict[str, Value]:
        """Components in a row as a value for each field.

        Raises:
            EffectError: a wrong number of them.
        """
        known = cls.parameters()
        if len(components) != sum(item.size for item in known):
            needed = ", ".join(f"{n} [{item.unit}]" for item in known for n in item.names)
            raise EffectError(
                f"{cls.name} takes {sum(item.size for item in known)} numbers ({needed}), "
                f"not {len(components)}; separate them by /"
            )
        result: dict[str, Value] = {}
        rest = list(components)
        for item in known:
            values, rest = rest[: item.size], rest[item.size :]
            result[item.name] = tuple(values) if isinstance(item.typical, tuple) else values[0]
        return result

    @classmethod
    def scale(cls) -> Array:
        """(p,) size of each component, for finite differences and conditioning; never 0."""
        return np.concatenate([_scale(known) for known in cls.parameters()])

    @classmethod
    def bounds(cls) -> tuple[Array, Array]:
        """(p,) lowest and highest values of the components."""
        known = cls.parameters()
        low, high = ([getattr(item, end) for item in known] for end in ("low", "high"))
        sizes = [item.size for item in known]
        return np.repeat(low, sizes), np.repeat(high, sizes)

    def if_possible(self, values: Array) -> Self:
        """The effect with these components (p,); as it is where they are out of bounds."""
        low, high = self.bounds()
        return self.with_values(values) if np.all((low <= values) & (values <= high)) else self

    def least(self, platform: Platform) -> Self:
        """The smallest that does the same: a turn about a wheel's own axis does nothing, and a fit
        may find any."""
        return self

    def variants(self, platform: Platform) -> tuple[Self, ...]:
        """The effect in each of the settings in which a diagnosis looks for it."""
        del platform
        return (self,)

    def absent(self) -> Self:
        """The same with every amplitude at 0: what it adds to a model stays, and does nothing."""
        gone = {
            known.name: (0.0,) * known.size if isinstance(known.typical, tuple) else 0.0
            for known in self.parameters()
            if known.amplitude
        }
        return replace(self, **gone)

    @property
    def rings(self) -> bool:
        """Whether it rings or pushes at a frequency of its own."""
        return type(self).at_frequency is not Effect.at_frequency

    def at_frequency(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """Shapes in which it would ring or push at a frequency; none of an effect without one.

        Args:
            hertz: a line in the spectrum of what a model leaves.
            gravity: where the machine stands [m/s^2].

        Raises:
            EffectError: a frequency beyond the effect's bounds.
        """
        del hertz, gravity
        return ()

    def resonating(self, hertz: float, gravity: float) -> tuple[Self, ...]:
        """Shapes in which it would answer to whatever pushes it about a frequency, damped so that
        it does so far around it; none of an effect that does not ring.

        Args:
            hertz: of its own.
            gravity: where the machine stands [m/s^2].

        Raises:
            EffectError: a frequency beyond the effect's bounds.
        """
        del hertz, gravity
        return ()

    @property
    def winds(self) -> bool:
        """Whether it makes waves around the turn of a hinge."""
        return type(self).with_waves is not Effect.with_waves

    def with_waves(self, waves: float) -> tuple[Self, ...]:
        """Shapes in which it would make so many waves in a turn of the hinge; none of an effect
        that makes none."""
        del waves
        return ()

    def words(self) -> str:
        """The effect with its numbers, as a person reads them."""
        parts = [value_words(known, getattr(self, known.name)) for known in self.parameters()]
        of = f" of {self.target}" if self.target else ""
        return f"{self.name}{of}: {', '.join(parts)}"

    def unfit(self, platform: Platform) -> str:
        """Why a platform cannot have it, as the end of a sentence; empty where it can."""
        known = targets(self.takes, platform)
        if not self.takes:
            return f"it takes no target, but was given {self.target!r}" if self.target else ""
        if not known:
            return f"the platform has no {self.takes}"
        if not self.target and self.takes == "stream":
            return f"it needs the stream it acts on, as in {self.name}:{known[0]}"
        if self.target and self.target not in known:
            return f"{self.target!r} is none of its {self.takes}s ({', '.join(known)})"
        return ""

    def hidden_from(self, platform: Platform) -> str:
        """Why no log of a platform shows it, as the end of a sentence; empty where one may."""
        return ""

    def of_parts(self, names: Sequence[str]) -> tuple[str, ...]:
        """Those parts that the effect is aimed at."""
        return tuple(name for name in names if self.target in ("", name))

    def _checked(self, known: Parameter, given: object) -> Value:
        vector = isinstance(known.typical, tuple)
        entries = tuple(given) if isinstance(given, list | tuple | np.ndarray) else (given,)
        numbers = [_number(entry) for entry in entries]
        if len(entries) != known.size or (not vector and isinstance(given, list | tuple)):
            raise EffectError(
                f"{self.name}: {known.name} takes {_count(known.size)} in {known.unit}, "
                f"not {given!r}"
            )
        for entry, number in zip(entries, numbers, strict=True):
            if not math.isfinite(number):
                raise EffectError(
                    f"{self.name}: {known.name} is {entry!r}; give a finite number in {known.unit}"
                )
            if not known.low <= number <= known.high:
                raise EffectError(
                    f"{self.name}: {known.name} is {number:g} {known.unit}; it must lie "
                    f"{_between(known)}"
                )
        return tuple(numbers) if vector else numbers[0]


def targets(takes: Target, platform: Platform) -> tuple[str, ...]:
    """What an effect can be aimed at on a platform."""
    if takes == "stream":
        return tuple(platform.sensors)
    parts = {
        "wheel": platform.wheels,
        "stage": platform.stages,
        "gimbal": platform.gimbals,
        "thruster": platform.thrusters,
    }
    return tuple(part.name for part in parts.get(takes, ()))


def _number(entry: object) -> float:
    if isinstance(entry, bool) or not isinstance(entry, int | float | np.number):
        return math.nan
    return float(entry)


def _count(size: int) -> str:
    return "one number" if size == 1 else f"{size} numbers"


def _between(known: Parameter) -> str:
    if math.isinf(known.high):
        return f"at or above {known.low:g} {known.unit}"
    if math.isinf(known.low):
        return f"at or below {known.high:g} {known.unit}"
    return f"between {known.low:g} and {known.high:g} {known.unit}"


def _scale(known: Parameter) -> Array:
    typical = np.abs(np.atleast_1d(known.typical))
    largest = float(typical.max()) or 1.0
    return np.where(typical > 0.0, typical, largest)


def value_words(known: Parameter, value: Value) -> str:
    """A parameter's name and value, as a person reads them."""
    if not isinstance(value, tuple):
        return f"{known.name} {printed(value, known.unit)}"
    size = max(abs(entry) for entry in value)
    numbers = [printed(entry, known.unit, size) for entry in value]
    unit = numbers[0].partition(" ")[2]
    inner = ", ".join(number.partition(" ")[0] for number in numbers)
    return f"{known.name} ({inner}) {unit}".rstrip()
