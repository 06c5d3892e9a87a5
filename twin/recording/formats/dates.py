"""Dates and times of day as text -> seconds."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ISO = re.compile(
    r"(\d{4}-\d\d-\d\d)(?:[T ](\d\d:\d\d(?::\d\d(?:[.,]\d+)?)?)(?:Z|([+-])(\d\d):?(\d\d))?)?$"
)
_OF_DAY = re.compile(r"(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)$")


def seconds_of(texts: Sequence[str | None]) -> Array:
    """Seconds (m,) since 1970 of ISO 8601 dates, since midnight of times of day; NaN for the rest.

    A date without a zone is taken as UTC: only its differences count.
    """
    seconds = np.full(len(texts), np.nan)
    for i, text in enumerate(texts):
        if text is None:
            continue
        if (found := _ISO.match(text.strip())) is not None:
            day, clock, sign, hours, minutes = found.groups()
            seconds[i] = float(np.datetime64(day, "s").astype(np.int64)) + _of_day(clock or "00:00")
            if sign:
                shift = 3600.0 * int(hours) + 60.0 * int(minutes)
                seconds[i] -= shift if sign == "+" else -shift
        elif _OF_DAY.match(text.strip()):
            seconds[i] = _of_day(text.strip())
    return seconds


def _of_day(clock: str) -> float:
    hours, minutes, *rest = clock.replace(",", ".").split(":")
    return 3600.0 * int(hours) + 60.0 * int(minutes) + (float(rest[0]) if rest else 0.0)
