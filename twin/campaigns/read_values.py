"""Values of a specification: a number, some numbers, or how they are spread over the runs."""

import math

import numpy as np
from numpy.typing import NDArray

from twin.campaigns.distribution import (
    Distribution,
    Fixed,
    Grid,
    LogUniform,
    Normal,
    Uniform,
)
from twin.config import Table, as_number
from twin.effects import Parameter

Array = NDArray[np.float64]

KINDS = ("uniform", "log_uniform", "normal", "grid")
"""Of distributions, by their keys."""

_SHAPES = {
    "uniform": "two values, lowest and highest",
    "log_uniform": "two values above 0, lowest and highest",
    "normal": "two values, mean and standard deviation",
}


def read_values(
    table: Table,
    key: str,
    size: int,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
) -> tuple[Distribution, ...]:
    """The distribution of each of `size` components of a key.

    A number or a list is the same in all runs; `{ uniform = [low, high] }` and its like are spread,
    each component for itself. Low, high and the others are numbers or lists of `size`; a component
    of a vector that is left no room is the same in all runs.

    Args:
        table: that holds the key.
        key: is there.
        size: components.
        low: bound of every component; a normal distribution is cut off there.
        high: bound of every component.
        unit: of the values.

    Raises:
        CampaignError: no distribution, or values that do not fit.
    """
    if not isinstance(table.raw(key), dict):
        return tuple(map(Fixed, table.numbers(key, size, low=low, high=high, unit=unit).tolist()))
    spread = table.table(key)
    kinds = [kind for kind in KINDS if kind in spread]
    if len(kinds) != 1:
        said = " and ".join(kinds) or "no distribution"
        raise table.fail(key, f"has {said}", "give one of " + ", ".join(KINDS))
    (kind,) = kinds
    if kind == "grid":
        if size != 1:
            raise table.fail(key, "is a vector on a grid", "put a single number on a grid")
        values = spread.numbers(kind, None, low=low, high=high, unit=unit)
        if len(set(values.tolist())) < len(values):
            raise spread.fail(kind, "has a value twice", "give each once")
        found: tuple[Distribution, ...] = (Grid(tuple(values.tolist())),)
    else:
        first, second = _pair(spread, kind, size)
        found = tuple(
            Fixed(a)
            if size > 1 and low <= a <= high and (b == 0.0 if kind == "normal" else a == b)
            else _distribution(spread, kind, a, b, (low, high), unit)
            for a, b in zip(first.tolist(), second.tolist(), strict=True)
        )
    spread.close()
    return found


def usual(known: Parameter) -> tuple[Distribution, ...]:
    """How a parameter is spread where nobody says so, one distribution a component.

    An amplitude of either sign is normal about 0 with its typical size as standard deviation, one
    of a single sign uniform from 0 to twice its typical size; a shape stays as it typically is.
    """
    return tuple(_usual(known, value) for value in np.atleast_1d(known.typical).tolist())


def _usual(known: Parameter, typical: float) -> Distribution:
    if not known.amplitude or typical == 0.0:
        return Fixed(typical)
    if known.low < 0.0 < known.high:
        return Normal(0.0, abs(typical), known.low, known.high)
    return Uniform(*sorted((0.0, float(np.clip(2.0 * typical, known.low, known.high)))))


def _pair(spread: Table, kind: str, size: int) -> tuple[Array, Array]:
    given = spread.raw(kind)
    each = f", each a number or a list of {size}" if size > 1 else ""
    problem = spread.fail(kind, f"is {given!r}", f"give {_SHAPES[kind]}{each}, as in [1.0, 2.0]")
    if not isinstance(given, list) or len(given) != 2:
        raise problem
    ends: list[Array] = []
    for end in given:
        numbers = end if isinstance(end, list) else [end] * size
        if len(numbers) != size or not all(math.isfinite(as_number(x)) for x in numbers):
            raise problem
        ends.append(np.array(numbers, dtype=np.float64))
    return ends[0], ends[1]


def _distribution(
    spread: Table, kind: str, a: float, b: float, bounds: tuple[float, float], unit: str
) -> Distribution:
    low, high = bounds
    of = f" {unit}" if unit else ""
    if kind == "normal":
        if b <= 0.0:
            raise spread.fail(kind, f"has a standard deviation of {b:g}{of}", "give one above 0")
        if not low <= a <= high:
            raise spread.fail(kind, f"has a mean of {a:g}{of}", _within(low, high, of))
        return Normal(a, b, low, high)
    if not a < b:
        raise spread.fail(kind, f"goes from {a:g} to {b:g}{of}", "give the lower value first")
    for end in (a, b):
        if not low <= end <= high:
            raise spread.fail(kind, f"holds {end:g}{of}", _within(low, high, of))
    if kind == "uniform":
        return Uniform(a, b)
    if a <= 0.0:
        raise spread.fail(kind, f"begins at {a:g}{of}", "decades begin above 0")
    return LogUniform(a, b)


def _within(low: float, high: float, of: str) -> str:
    if math.isinf(high):
        return f"it must be at least {low:g}{of}"
    return f"it must lie between {low:g} and {high:g}{of}"
