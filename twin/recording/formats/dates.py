"""Dates and times of day as text -> seconds."""

import re
from collections.abc import Sequence
from datetime import date

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_CLOCK = r"\d{1,2}:\d\d(?::\d\d(?:[.,:]\d+)?)?(?: ?[AaPp][Mm])?"
_DAY = r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})|(\d{1,2})([./-])(\d{1,2})[./-](\d{4})"
_DATE = re.compile(rf"(?:{_DAY})(?:(?:[T ]|, ?)({_CLOCK})(?:Z| ?UTC|([+-])(\d\d):?(\d\d))?)?$")
_OF_DAY = re.compile(r"\d{1,2}:\d\d:\d\d(?:[.,:]\d+)?(?: ?[AaPp][Mm])?$")


def is_date(text: str) -> bool:
    """Whether a text is a date with or without a time, or a time of day.

    The date is year-month-day (ISO 8601), day.month.year, or day/month/year in either order.
    """
    text = text.strip()
    return _DATE.match(text) is not None or _OF_DAY.match(text) is not None


def seconds_of(texts: Sequence[str | None]) -> Array:
    """Seconds (m,) since 1970 of dates, since midnight of times of day; NaN for the rest.

    A date without a zone is taken as UTC: only its differences count. Of 2/3/2026 the first number
    is the month, unless a date of the column denies it, or the column spans fewer days otherwise.
    """
    seconds = np.full(len(texts), np.nan)
    days: dict[tuple[str, ...], list[int]] = {}
    for i, text in enumerate(texts):
        if text is None:
            continue
        if (found := _DATE.match(text.strip())) is not None:
            *day, clock, sign, hours, minutes = found.groups(default="")
            days.setdefault(tuple(day), []).append(i)
            seconds[i] = _of_day(clock or "00:00")
            if sign:
                shift = 3600.0 * int(hours) + 60.0 * int(minutes)
                seconds[i] -= shift if sign == "+" else -shift
        elif _OF_DAY.match(text.strip()):
            seconds[i] = _of_day(text.strip())
    for rows, start in zip(days.values(), _starts(list(days)), strict=True):
        seconds[rows] += start
    return seconds


def _starts(days: Sequence[tuple[str, ...]]) -> list[float]:
    """Seconds of the beginnings of days, in the order of day and month that suits them all."""
    readings: list[list[float]] = []
    for month_first in (True, False):
        try:
            readings.append([_start(day, month_first=month_first) for day in days])
        except ValueError:  # there is no month 13
            continue
    if not readings:
        return [float("nan")] * len(days)
    return min(readings, key=lambda one: max(one, default=0.0) - min(one, default=0.0))


def _start(day: tuple[str, ...], *, month_first: bool) -> float:
    year, month, number, first, mark, second, behind = day
    if not year:
        first_is_month = month_first and mark == "/"
        month, number = (first, second) if first_is_month else (second, first)
    days = date(int(year or behind), int(month), int(number)).toordinal()
    return 86400.0 * (days - date(1970, 1, 1).toordinal())


def _of_day(clock: str) -> float:
    half = clock[-2:].lower() if clock[-1:].lower() == "m" else ""
    if half:
        clock = clock[:-2].strip()
    hours, minutes, *rest = clock.replace(",", ".").split(":", 2)
    hour = int(hours) % 12 + 12 * (half == "pm") if half else int(hours)
    seconds = float(rest[0].replace(":", ".")) if rest else 0.0
    return 3600.0 * hour + 60.0 * int(minutes) + seconds
