"""What no number of a command line may be, whichever verb it is of."""

import math
from typing import Any

import tyro

from twin.errors import UsageError


def check_numbers(verb: object) -> None:
    """Refuse numbers that are not finite, or a seed below 0, before the verb meets them.

    Raises:
        UsageError: which argument, and what it is.
    """
    for name, value in vars(verb).items():
        numbers = _numbers(value)
        if not all(map(math.isfinite, numbers)):
            given = " ".join(f"{number:g}" for number in numbers)
            wanted = "finite numbers" if len(numbers) > 1 else "a finite number"
            raise UsageError(f"{_written(verb, name)} is {given}; give {wanted}")
        if name == "seed" and value < 0:
            raise UsageError(f"--seed is {value}; give 0 or more")


def _numbers(value: Any) -> tuple[float, ...]:
    """Those of an argument: itself, or its entries."""
    entries = value if isinstance(value, tuple) else (value,)
    return tuple(entry for entry in entries if isinstance(entry, int | float))


def _written(verb: object, name: str) -> str:
    """How the command line calls a field."""
    marks: tuple[Any, ...] = getattr(type(verb).__annotations__[name], "__metadata__", ())
    if tyro.conf.Positional in marks:
        return next(mark.metavar for mark in marks if hasattr(mark, "metavar")).strip("[]")
    return "--" + name.replace("_", "-")
