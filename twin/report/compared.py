"""What several methods of identification found of the same logs: one table."""

from collections.abc import Mapping, Sequence
from typing import TypeGuard

from twin.errors import TwinError
from twin.identification import Identification
from twin.platform import taken_as_at_rest
from twin.report.words import pair

GAP = "  "


def compared(found: Mapping[str, Identification | TwinError]) -> list[str]:
    """A row a method, a column a parameter, values with half their 95 % intervals.

    Args:
        found: by what each is called; the first one has found something.
    """
    first = next(one for one in found.values() if isinstance(one, Identification))
    count = len(first.base.names) - len(first.base.joints)
    names, units = first.base.names[:count], first.base.units[:count]
    heads = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    rows = [
        [name, *_cells(one, count)]
        for name, one in found.items()
        if isinstance(one, Identification)
    ]
    stated = ["as stated", *(f"{value:.4g}" for value in first.base.as_stated[:count])]
    doubt = next((one.doubt for one in found.values() if _doubted(one)), "")
    ours = "hold" if not doubt else f"are not 95 % intervals, for {doubt}"
    lines = [
        f"{first.platform.title} ({first.platform.name}): values +- half of "
        f"{'95 % intervals' if not doubt else 'intervals that do not hold'}",
        *_table([["method", *heads], stated, *rows]),
        f"The intervals of prediction-error {ours}. The others' know the scatter of what is left, "
        "not what noise in rates and wheel speeds does to the values.",
    ]
    lines += taken_as_at_rest(first.recordings, first.platform)
    lines += _failed(found)
    return lines + [f"Cannot be told: {sentence}." for sentence in first.not_excited]


def _doubted(one: Identification | TwinError) -> TypeGuard[Identification]:
    return isinstance(one, Identification) and bool(one.doubt)


def _failed(found: Mapping[str, Identification | TwinError]) -> list[str]:
    """Each sentence once, after the names of all methods that it is of."""
    told: dict[str, list[str]] = {}
    for name, problem in found.items():
        if isinstance(problem, TwinError):
            told.setdefault(str(problem), []).append(name)
    return [f"{', '.join(names)}: {sentence}." for sentence, names in told.items()]


def _cells(found: Identification, count: int) -> list[str]:
    values, half = found.theta[:count].tolist(), found.half_widths[:count].tolist()
    return [pair(v, h) for v, h in zip(values, half, strict=True)]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        GAP.join(
            cell.ljust(width) if place == 0 else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
