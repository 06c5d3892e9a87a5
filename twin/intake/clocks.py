"""When the rows of a table were: times and their unit, a counter and its rate, or a rate."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin.intake.tables import DataTable
from twin.recording.column_names import is_clock, is_counter, names_a_clock, stated_time_unit
from twin.units import known_unit

_NUMBER = r"\W*(\d+(?:\.\d+)?)"
_PERIOD = re.compile(r"^delta[_ ]?x\W+(\d+(?:[.,]\d+)?(?:E[+-]?\d+)?)", re.IGNORECASE)
"""How LabVIEW states the time from one row to the next [s]."""
_RATES = (
    rf"(?:update|sampl\w*|output|capture|export|frame|actual)[ _]*(?:frame[ _]*)?rate{_NUMBER}",
    rf"^(?:sampl\w*[ _]*)?freq\w*{_NUMBER}",
    rf"^fs{_NUMBER}",
    r"^(\d+(?:\.\d+)?)$",
)
"""How preambles state a rate, the surest first; Vicon's is a number alone on its line."""
COMMON = (0.5, 5e3)
"""Rates of logs [Hz]."""
FASTEST = 1e5
"""A larger number in a preamble is no rate [Hz]."""
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True)
class Clock:
    """Keys of log.toml, each a TOML value, and why."""

    keys: dict[str, str]
    reason: str
    column: str | None
    sure: bool = True


def clock_of(table: DataTable, rate: float | None) -> Clock | None:
    """The clock of a table; None where nothing tells when its rows were.

    Args:
        table: whose rows.
        rate: of tables without times, as the lab says [Hz].
    """
    if table.file.clocks:
        clock = _running(table)
        keys = {} if clock == table.file.time else {"time": quoted(clock)}
        return Clock(keys, f"{clock} is a time by its type", clock)
    for test in (is_clock, names_a_clock):
        for name in table.names:
            if test(name.rpartition(".")[2]) and (found := _timed(table, name)) is not None:
                return found
    reason = "stated"
    if rate is None:
        rate, reason = _rate_in(table.preamble), "by the lines beside the table"
    counter = next((name for name in table.names if is_counter(name.rpartition(".")[2])), None)
    if rate is not None:
        keys = {"rate": f"{rate:g}"}
        reason = f"{rate:g} Hz, {reason}"
        if counter is not None and _counts(table, counter):
            return Clock(
                {"time": quoted(counter), **keys}, f"{reason}, counted by {counter}", counter
            )
        return Clock(keys, reason, None)
    for name in table.names[:1]:
        if (found := _timed(table, name)) is not None:
            return found
    return None


def _running(table: DataTable) -> str:
    """The first of the columns that are times by their type, and goes on: a date without a time
    does not, beside a time of day."""
    first = table.file.time
    clocks = sorted(table.file.clocks, key=lambda name: name != first)
    for name in clocks:
        column = table.column(name)
        if column is not None and (np.diff(column[np.isfinite(column)]) > 0.0).mean() > 0.5:
            return name
    return clocks[0]


def _timed(table: DataTable, name: str) -> Clock | None:
    """A column as times, in the unit that it states or that its steps have."""
    column = table.column(name)
    if column is None:
        return None
    times = column[np.isfinite(column)]
    steps = np.diff(times)
    if len(steps) < 2 or (steps < 0.0).mean() > 0.01 or not (steps > 0.0).mean() > 0.5:
        return None
    step = float(np.median(steps[steps > 0.0]))
    if step == 1.0 and (times == np.round(times)).all() and not is_clock(name.rpartition(".")[2]):
        return None
    keys = {} if name == table.file.header[0] else {"time": quoted(name)}
    text = table.unit(name) or stated_time_unit(name)
    if text:
        unit = known_unit(text.strip("[]() "))
        if unit is not None and unit.si == "s":
            rate = 1.0 / (step * unit.factor)
            if COMMON[0] / 10.0 <= rate <= 10.0 * COMMON[1]:
                stated = {} if unit.factor == 1.0 else {"time_unit": quoted(text.strip("[]() "))}
                return Clock(keys | stated, f"{name}, in {text}: {rate:.4g} Hz", name)
    if "sampletimefine" in name.lower().replace("_", ""):
        tick = _tick_of_xsens(step, _rate_in(table.preamble))
        return Clock(keys | {"time_scale": f"{tick:g}"}, f"{name} counts {1e3 * tick:g} ms", name)
    fitting = [u for u, s in UNITS.items() if COMMON[0] <= 1.0 / (step * s) <= COMMON[1]]
    if not fitting:
        rate = _rate_in(table.preamble)
        if rate is None:
            return None
        return Clock(
            keys | {"time_scale": f"{1.0 / (rate * step):.6g}"},
            f"{name} in steps of {step:g}, {rate:g} Hz by the lines above the table",
            name,
        )
    unit_text = fitting[0]
    rate = 1.0 / (step * UNITS[unit_text])
    stated = {} if unit_text == "s" else {"time_unit": quoted(unit_text)}
    sure = len(fitting) == 1
    return Clock(keys | stated, f"{name} in {unit_text}: {rate:.4g} Hz", name, sure)


def _tick_of_xsens(step: float, rate: float | None) -> float:
    """Seconds of a count of SampleTimeFine: 0.1 ms of an MTi, 1 us of a DOT.

    Args:
        step: between two rows, in counts.
        rate: that the file states [Hz]; without it, an MTi gives 1 Hz or more.
    """
    slowest = 1.0 if rate is None else 0.1 * rate
    return 1e-4 if 1e-4 * step * slowest <= 1.0 else 1e-6


def _counts(table: DataTable, name: str) -> bool:
    column = table.column(name)
    if column is None or not np.isfinite(column).all():
        return False
    return bool((column == np.round(column)).all() and (np.diff(column) > 0.0).mean() > 0.9)


def _rate_in(preamble: Sequence[str]) -> float | None:
    for pattern in _RATES:
        for line in preamble:
            found = re.search(pattern, line.strip(" ,;\t"), re.IGNORECASE)
            if found and 0.0 < float(found[1]) < FASTEST:
                return float(found[1])
    periods = (_PERIOD.match(line.strip()) for line in preamble)
    period = next((float(one[1].replace(",", ".")) for one in periods if one), 0.0)
    return 1.0 / period if period > 1.0 / FASTEST else None


def quoted(text: str) -> str:
    """A text as TOML writes it."""
    return json.dumps(text, ensure_ascii=False)
