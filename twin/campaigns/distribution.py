"""How one number is spread over the runs of a campaign: from a share of 1 to a value."""

import abc
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

Array = NDArray[np.float64]


class Distribution(abc.ABC):
    """Final subclasses are frozen dataclasses."""

    @property
    @abc.abstractmethod
    def middle(self) -> float:
        """Its median."""

    @property
    @abc.abstractmethod
    def ends(self) -> tuple[float, float]:
        """Lowest and highest value."""

    @abc.abstractmethod
    def at(self, share: Array) -> Array:
        """Values below which those shares of all runs lie; shares in (0, 1)."""

    @abc.abstractmethod
    def words(self) -> str:
        """As a person reads it, without a unit."""


@dataclass(frozen=True)
class Fixed(Distribution):
    """One value in all runs."""

    value: float

    @property
    def middle(self) -> float:
        return self.value

    @property
    def ends(self) -> tuple[float, float]:
        return self.value, self.value

    def at(self, share: Array) -> Array:
        return np.full_like(share, self.value)

    def words(self) -> str:
        return f"{self.value:g}"


@dataclass(frozen=True)
class Grid(Distribution):
    """Each of some values in turn, in every combination with the other grids."""

    values: tuple[float, ...]

    @property
    def middle(self) -> float:
        return self.values[len(self.values) // 2]

    @property
    def ends(self) -> tuple[float, float]:
        return min(self.values), max(self.values)

    def at(self, share: Array) -> Array:
        """The values stand for equal shares."""
        number = np.minimum((share * len(self.values)).astype(np.intp), len(self.values) - 1)
        return np.array(self.values)[number]

    def words(self) -> str:
        return "each of " + ", ".join(f"{value:g}" for value in self.values)


@dataclass(frozen=True)
class Uniform(Distribution):
    """Any value between two, alike."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def ends(self) -> tuple[float, float]:
        return self.low, self.high

    def at(self, share: Array) -> Array:
        return self.low + (self.high - self.low) * share

    def words(self) -> str:
        return f"between {self.low:g} and {self.high:g}"


@dataclass(frozen=True)
class LogUniform(Distribution):
    """Any value between two above 0, each decade alike."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        return math.sqrt(self.low * self.high)

    @property
    def ends(self) -> tuple[float, float]:
        return self.low, self.high

    def at(self, share: Array) -> Array:
        value = self.low * np.exp(math.log(self.high / self.low) * share)
        return np.clip(value, self.low, self.high)

    def words(self) -> str:
        return f"between {self.low:g} and {self.high:g}, decades alike"


@dataclass(frozen=True)
class Normal(Distribution):
    """Gaussian, cut off where the parameter's bounds are."""

    mean: float
    deviation: float
    low: float = -math.inf
    high: float = math.inf

    @property
    def middle(self) -> float:
        return float(self.at(np.array([0.5]))[0])

    @property
    def ends(self) -> tuple[float, float]:
        return self.low, self.high

    def at(self, share: Array) -> Array:
        below, above = (ndtr((end - self.mean) / self.deviation) for end in (self.low, self.high))
        value = self.mean + self.deviation * ndtri(below + (above - below) * share)
        return np.clip(value, self.low, self.high)

    def words(self) -> str:
        return f"{self.mean:g} +- {self.deviation:g}"
