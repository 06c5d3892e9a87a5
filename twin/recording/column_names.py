"""What the names of a file's columns say: which part of a stream each is, its unit, its clock."""

import re
from collections.abc import Sequence
from os.path import commonprefix

_IN_BRACKETS = re.compile(r"\s*[\[(]([^\[\]()]*)[\])]\s*$")
_CLOCK = re.compile(
    r"(t|ts|stamp|epoch|zeit|temps|tiempo|tempo|sec(onds)?|t_\w+|time(stamp)?(_\w+)?)(\W|$)",
    re.IGNORECASE,
)
_COUNTER = re.compile(
    r"(|nr|no|n_?samples?|samples?|seq(uence)?|(sub[ _]?)?frames?(_?(nr|no|number))?|row|idx|index"
    r"|step|count(er)?|packet(_?(nr|no|number|count(er)?|id))?|unnamed.*)$",
    re.I,
)
_OF_TIME = re.compile(
    r"_(s|sec|secs|seconds|ms|msec|millis|milliseconds|us|usec|micros|microseconds|ns|nsec"
    r"|nanoseconds|nanos)$",
    re.I,
)
_SHORT = {"millis": "ms", "micros": "us", "nanos": "ns"}
_POWERS = {
    **dict.fromkeys(("degps", "deg_s", "degs"), "deg/s"),
    **dict.fromkeys(("radps", "rad_s", "rads"), "rad/s"),
    **dict.fromkeys(("mps2", "m_s2", "ms2"), "m/s^2"),
}
"""Units of names that have no room for a slash."""
_OF_VALUE = re.compile(
    rf"_(deg|degrees?|dps|rad|rpm|mm|cm|um|mrad|arcsec|uT|nT|mG|{'|'.join(_POWERS)})$"
)
_PART = re.compile(r"(|\d+|[xyzwijkq]|roll|pitch|yaw|0?x[0-9a-f]{2,8})$", re.I)
"""What stands in brackets and is a part of the name or the code of a field, not a unit."""


def in_order(names: Sequence[str], expected: Sequence[str]) -> tuple[str, ...] | None:
    """The names in the order of the parts that they name; None where they do not name them all.

    Capitals, a unit in brackets, and what all have before or behind do not count: `gyro_x [deg/s]`
    is x beside `gyro_y [deg/s]`.
    """
    plain = [without_unit(name).lower() for name in names]
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
    return _COUNTER.match(without_unit(name).strip()) is not None


def names_a_clock(name: str) -> bool:
    """Whether a column is called somewhat like times are, with words before it: `Control_Time`."""
    return is_clock(name) or re.search(r"time|stamp|clock|\bi?tow\b", name, re.I) is not None


def stated_unit(name: str) -> str:
    """The text that stands behind a name as its unit, known or not: in brackets, or as `_deg`;
    empty if none does: `x (1)` is another x, `Rot[0]` the first of several."""
    result = _IN_BRACKETS.search(name)
    if result:
        text = result[1].strip()
        return "" if _PART.match(text) else text
    behind = _OF_VALUE.search(name)
    return _POWERS.get(behind[1], behind[1]) if behind else ""


def stated_time_unit(name: str) -> str:
    """The same of a clock, of which `time_ms` says it too."""
    result = _OF_TIME.search(name)
    if result:
        return _SHORT.get(result[1].lower(), result[1].lower())
    result = _IN_BRACKETS.search(name)
    return "" if result is None or _PART.match(result[1].strip()) else result[1].strip()


def without_unit(name: str) -> str:
    """A name without the unit behind it that `stated_unit` gives."""
    return (_IN_BRACKETS if _IN_BRACKETS.search(name) else _OF_VALUE).sub("", name)
