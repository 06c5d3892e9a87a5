"""What the names of a file's columns say: which part of a stream each is, its unit, its clock."""

import re
from collections.abc import Sequence
from os.path import commonprefix

from twin.errors import UnknownName
from twin.units import Unit, unit_named

_IN_BRACKETS = re.compile(r"\s*[\[(]([^\[\]()]*)[\])]\s*$")
_CLOCK = re.compile(
    r"(t|ts|stamp|epoch|zeit|sec(onds)?|t_\w+|time(stamp)?(_\w+)?)(\W|$)", re.IGNORECASE
)
_COUNTER = re.compile(r"(|nr|no|samples?|seq|frame|row|idx|index|count(er)?|unnamed.*)$", re.I)
_OF_TIME = re.compile(r"_(s|ms|us|ns)$")


def in_order(names: Sequence[str], expected: Sequence[str]) -> tuple[str, ...] | None:
    """The names in the order of the parts that they name; None where they do not name them all.

    Capitals, a unit in brackets, and what all have before or behind do not count: `gyro_x [deg/s]`
    is x beside `gyro_y [deg/s]`.
    """
    plain = [_without_unit(name).lower() for name in names]
    before = len(commonprefix(plain))
    behind = len(commonprefix([name[::-1] for name in plain]))
    for start, end in ((0, 0), (before, 0), (0, behind), (before, behind)):
        parts = [name[start : len(name) - end] for name in plain]
        if sorted(parts) == sorted(expected):
            return tuple(names[parts.index(part)] for part in expected)
    return None


def is_clock(name: str) -> bool:
    """Whether a column is called as times are."""
    return _CLOCK.match(name) is not None


def is_counter(name: str) -> bool:
    """Whether a column is called as the numbers of rows are."""
    return _COUNTER.match(_without_unit(name).strip()) is not None


def stated_unit(name: str) -> str:
    """The unit that stands behind a name in brackets; empty if none does: `x (1)` is another x."""
    found = _IN_BRACKETS.search(name)
    unit = _known(found[1]) if found else None
    return found[1].strip() if found and unit is not None and unit.si != "1" else ""


def stated_time_unit(name: str) -> str:
    """The same of a clock, of which `time_ms` says it too."""
    found = _OF_TIME.search(name)
    text = found[1] if found else stated_unit(name)
    unit = _known(text) if text else None
    return text if unit is not None and unit.si == "s" else ""


def _without_unit(name: str) -> str:
    return _IN_BRACKETS.sub("", name)


def _known(text: str) -> Unit | None:
    try:
        return unit_named(text.strip())
    except UnknownName:
        return None
