"""Effects on a series: what a sensor, a clock or a drive makes of what went into it.

`apply` is what the machine does: a true value becomes a shown one, a commanded one becomes what is
done. `undo` is its inverse. Where several act on one stream, they do so in the order of `Order`,
within a place in that of their names; undoing goes the other way.
"""

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from twin.effects.effect import Domain, Effect
from twin.platform import Platform
from twin.signals import Samples

Array = NDArray[np.float64]
RESOLVED = 0.01
"""Scale of a vibration's frequency [Hz]."""
Live = Callable[[Samples], Samples]
"""Takes the next samples of a stream; remembers what it must."""


class Order(IntEnum):
    """From the truth to what is logged (docs/design.md, section 2)."""

    geometry = 0
    scale = 1
    bias = 2
    filter = 3
    """Whatever remembers: low-passes, backlash."""
    noise = 4
    """Noise, quantisation and saturation are the platform's own sensor."""
    delay = 5


@dataclass(frozen=True)
class SeriesEffect(Effect, abc.ABC):
    """Acts on one stream."""

    order: ClassVar[Order]
    acts_on: ClassVar[str] = ""
    """The stream; empty where it is the target."""

    @property
    def stream(self) -> str:
        """The stream that it changes."""
        return self.acts_on or self.target

    @abc.abstractmethod
    def apply(self, samples: Samples, platform: Platform) -> Samples:
        """What becomes of a stream from its start, (n, m, k)."""

    @abc.abstractmethod
    def undo(self, samples: Samples, platform: Platform) -> Samples:
        """What must have gone in."""

    def live(self, platform: Platform) -> Live:
        """`apply` for a stream that comes bit by bit."""
        return lambda samples: self.apply(samples, platform)

    def unfit(self, platform: Platform) -> str:
        """A stream that the platform has not cannot be changed."""
        missing = super().unfit(platform)
        if missing or self.stream in platform.sensors or self.stream in platform.commands:
            return missing
        return f"the platform has no {self.stream}"


@dataclass(frozen=True)
class ScaleEffect(SeriesEffect, abc.ABC):
    """Multiplies each column of a stream."""

    order = Order.scale

    @abc.abstractmethod
    def gain(self, platform: Platform) -> Array:
        """(k,) what each column is multiplied by; 1 where nothing is wrong."""

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value * self.gain(platform))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value / self.gain(platform))


@dataclass(frozen=True)
class DelayEffect(SeriesEffect, abc.ABC):
    """Lets a stream come later."""

    order = Order.delay

    @abc.abstractmethod
    def lateness(self) -> float:
        """By how much [s]; negative where it comes early."""

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_time(samples, samples.time + self.lateness())

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_time(samples, samples.time - self.lateness())


@dataclass(frozen=True)
class BiasEffect(SeriesEffect, abc.ABC):
    """Adds a constant to each column of a stream."""

    order = Order.bias
    exact = True

    @abc.abstractmethod
    def error(self) -> Array:
        """(k,) what each column shows too much."""

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value + self.error())

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value - self.error())


@dataclass(frozen=True)
class VibrationEffect(SeriesEffect, abc.ABC):
    """Adds a sinusoid s sin(2 pi f t) + c cos(2 pi f t) to each column of a sensor; f is its last
    parameter.

    What shakes the sensor in its mount, and the machine only so little that no other stream shows
    it: a pump, a fan, the frame that the machine stands on.
    """

    domain = Domain.sensor
    order = Order.bias

    @classmethod
    def scale(cls) -> Array:
        """(p,) likewise; of the frequency what a log of a minute or two tells apart, as a step of
        a share of the frequency itself would be whole turns at its end."""
        return np.append(super().scale()[:-1], RESOLVED)

    @abc.abstractmethod
    def sinusoid(self) -> tuple[Array, Array, float]:
        """s and c, (k,) or a number, in the stream's unit, and f [Hz]."""

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value + self._error(samples))

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        return with_value(samples, samples.value - self._error(samples))

    def _error(self, samples: Samples) -> Array:
        sine, cosine, frequency = self.sinusoid()
        turns = 2.0 * np.pi * frequency * samples.time[..., None]
        return sine * np.sin(turns) + cosine * np.cos(turns)


@dataclass(frozen=True)
class ScatterEffect(Effect, abc.ABC):
    """Adds noise to one sensor, as strong as something else makes it; it cannot be undone."""

    acts_on: ClassVar[str]
    """The sensor."""
    cause: ClassVar[str]
    """The true stream that decides how strong (a name of `Truth.measured`)."""

    @abc.abstractmethod
    def sigma(self, cause: Array, platform: Platform) -> Array:
        """1 sigma of the added noise, (n, m, k) or (n, m, 1), from the cause (n, m, j)."""

    def unfit(self, platform: Platform) -> str:
        """A sensor that the platform has not cannot be shaken."""
        missing = super().unfit(platform)
        if missing or self.acts_on in platform.sensors:
            return missing
        return f"the platform has no {self.acts_on}"


@dataclass(frozen=True)
class ReadingEffect(Effect, abc.ABC):
    """Makes sensors show other than the truth by where the base stands and how fast it turns: one
    fault behind several streams."""

    reads: ClassVar[tuple[str, ...]]
    """The sensors."""

    @abc.abstractmethod
    def error(self, stream: str, position: Array, rate: Array) -> Array:
        """What one of them shows too much.

        Args:
            stream: which of `reads`.
            position: (n, m, 4) attitude of a ball joint, world from body, or (n, m, 1) angle of a
                hinge [rad].
            rate: (n, m, 3), body axes, or (n, m, 1) [rad/s].

        Returns:
            (n, m, k) in the stream's unit.
        """

    def unfit(self, platform: Platform) -> str:
        """A machine without any of the sensors cannot have it."""
        missing = super().unfit(platform)
        if missing or any(stream in platform.sensors for stream in self.reads):
            return missing
        return f"the platform has no {' and no '.join(self.reads)}"


class Recursion:
    """Follows a stream from sample to sample; remembers its last input and output."""

    def __init__(self, step: Callable[[Array, Array, Array, Array], Array]) -> None:
        """Start with the first output equal to the first input.

        Args:
            step: from the time since the last sample (n, 1) [s], the last input, the last output
                and this input, each (n, k), to this output.
        """
        self._step = step
        self._last: tuple[Array, Array, Array] | None = None

    def __call__(self, samples: Samples) -> Samples:
        """The next samples."""
        value = np.empty_like(samples.value)
        for i in range(value.shape[1]):
            time, current = samples.time[:, i, None], samples.value[:, i]
            if self._last is None:
                value[:, i] = current
            else:
                stamp, before, shown = self._last
                value[:, i] = self._step(time - stamp, before, shown, current)
            self._last = time, current, value[:, i]
        return with_value(samples, value)


def series_effects(effects: Sequence[Effect], stream: str) -> tuple[SeriesEffect, ...]:
    """Those that act on a stream, in the order in which they do."""
    result = [
        effect for effect in effects if isinstance(effect, SeriesEffect) and effect.stream == stream
    ]
    return tuple(sorted(result, key=lambda item: (item.order, item.label)))


def columns_of(effect: Effect, platform: Platform, stream: str) -> NDArray[np.bool_]:
    """(k,) the columns of a stream that belong to the parts an effect is aimed at."""
    names = platform.columns(stream)
    return np.isin(names, effect.of_parts(names))


def with_value(samples: Samples, value: Array) -> Samples:
    """The same samples with other values."""
    return Samples(value, samples.time, samples.valid)


def with_time(samples: Samples, time: Array) -> Samples:
    """The same samples with other stamps."""
    return Samples(samples.value, time, samples.valid)
