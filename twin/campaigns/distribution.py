"""How one number is spread over the runs of a campaign, and the shares that its samples take.

Shares in (0, 1) for the samples of a campaign, of which any few can be had without the others.

`random` and `latin_hypercube` give each sample a generator of its own. A Latin hypercube needs, for
each factor, a permutation of as many strata as there are samples: a Feistel network on the number
of the sample, walked until it falls inside (J. Black, P. Rogaway, Ciphers with arbitrary finite
domains, 2002), so that nothing is kept of the others. `sobol` skips to the sample. `saltelli` is
the design that Sobol indices are computed from: of each point of a Sobol sequence of twice as many
numbers come one sample of the first half, one of the second, and one for each factor, of the first
half with that factor from the second.

Source: A. Saltelli et al., Computer Physics Communications 181, 2010, table 2.
"""

import abc
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

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
        """Quantiles of the distribution, for shares in (0, 1)."""

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
class GridValues(Distribution):
    """Each of some values in turn, in every combination with the other grids."""

    values: tuple[float, ...]

    @property
    def middle(self) -> float:
        return self.values[len(self.values) // 2]

    @property
    def ends(self) -> tuple[float, float]:
        return min(self.values), max(self.values)

    def at(self, share: Array) -> Array:
        """Values of equal probability."""
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


Words = NDArray[np.uint64]

Sampling = Literal["random", "latin_hypercube", "sobol", "saltelli", "grid"]
SAMPLINGS: tuple[Sampling, ...] = ("random", "latin_hypercube", "sobol", "saltelli", "grid")

_ROUNDS = 6
_KEY = zlib.crc32(b"campaign")


def shares(
    sampling: Sampling, samples: Sequence[int], count: int, names: Sequence[str], seed: int
) -> Array:
    """(len(samples), len(names)) shares in (0, 1).

    Args:
        sampling: how they are spread.
        samples: which ones, ascending from 0.
        count: of all samples.
        names: of the factors; each is spread for itself.
        seed: of all random numbers.
    """
    if not names:
        return np.zeros((len(samples), 0))
    if sampling == "saltelli":
        return _designed(np.array(samples), count, names, seed)
    if sampling == "sobol":
        from scipy.stats import qmc  # takes a second to import

        first, last = min(samples), max(samples)
        sequence = qmc.Sobol(len(names), scramble=True, seed=_generator(seed, 0))
        if first:
            sequence.fast_forward(first)
        # from the start SciPy asks for a power of 2, though the points are the same
        many = last - first + 1
        points = np.asarray(sequence.random(many if first else 1 << (many - 1).bit_length()))
        return _inside(points[np.array(samples) - first])
    free = np.array([_generator(seed, 1 + sample).random(len(names)) for sample in samples])
    if sampling == "latin_hypercube":
        number = np.array(samples, dtype=np.uint64)
        strata = np.stack([_permuted(number, count, seed, name) for name in names], axis=1)
        return _inside((strata.astype(np.float64) + free) / count)
    return _inside(free)


def of_a_point(factors: int) -> int:
    """Samples of each point of a Saltelli design."""
    return factors + 2


def _designed(sample: NDArray[np.int64], count: int, names: Sequence[str], seed: int) -> Array:
    many, width = of_a_point(len(names)), len(names)
    point, place = sample // many, sample % many
    points = sorted(set(point.tolist()))
    both = shares("sobol", points, count // many, [*names, *names], seed)
    both = both[np.searchsorted(points, point)]
    first, second = both[:, :width], both[:, width:]
    changed = place[:, None] == 2 + np.arange(width)
    return np.where(changed | (place == 1)[:, None], second, first)


def _generator(seed: int, number: int) -> np.random.Generator:
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence([seed, number, _KEY])))


def _inside(share: Array) -> Array:
    """Neither 0 nor 1, at which a Gaussian is infinite."""
    tiny = 2.0**-53
    return np.clip(share, tiny, 1.0 - tiny)


def _permuted(number: Words, count: int, seed: int, name: str) -> Words:
    """A permutation of range(count), at some numbers."""
    half = max(((count - 1).bit_length() + 1) // 2, 1)
    sequence = np.random.SeedSequence([seed, zlib.crc32(name.encode()), _KEY])
    keys = sequence.generate_state(_ROUNDS, np.uint64).astype(np.uint64)
    out = _feistel(number, half, keys)
    while (outside := out >= count).any():
        out = np.where(outside, _feistel(out, half, keys), out)
    return out


def _feistel(number: Words, half: int, keys: Words) -> Words:
    bits, mask = np.uint64(half), np.uint64((1 << half) - 1)
    high, low = number >> bits, number & mask
    for key in keys:
        high, low = low, high ^ (_mixed(low + key) & mask)
    return (high << bits) | low


def _mixed(value: Words) -> Words:
    """The finaliser of splitmix64 (G. Steele et al., 2014): every bit depends on every other."""
    with np.errstate(over="ignore"):
        value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))
