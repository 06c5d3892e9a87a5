"""In what units a log.toml says that a stream's numbers are, checked."""

import numpy as np
from numpy.typing import NDArray

from twin.config import Table
from twin.errors import UnknownName
from twin.signals import Stream
from twin.units import Unit, unit_named

Array = NDArray[np.float64]

TWICE = 3e-3
"""A scale that is so near to its unit's factor (0.0175 of a degree) converts a second time."""


def time_factor(table: Table) -> float:
    """To seconds."""
    if "time_scale" in table:
        if "time_unit" in table:
            raise table.fail("time_scale", "is given beside `time_unit`", "remove one of them")
        scale = table.number("time_scale", low=0.0, unit="s a count")
        if scale == 0.0:
            raise table.fail("time_scale", "is 0", "give the seconds of one count")
        return scale
    text = table.text("time_unit", "s")
    try:
        unit = unit_named(text)
    except UnknownName:
        raise table.fail(
            "time_unit",
            f"is {text!r}, no unit",
            "use s, ms or us, or `time_scale`, the seconds of one count",
        ) from None
    if unit.si != "s":
        raise table.fail("time_unit", f"is {text!r}, a unit of {unit.si}", "use s, ms or us")
    return unit.factor


def si_of(canonical: Stream | None, layout: str) -> str:
    """The unit that the file's values must come to; empty where any will do."""
    if layout.startswith("euler") or layout == "rotation_vector":
        return "rad"
    return canonical.unit if canonical else ""


def unit_of(table: Table, name: str, canonical: Stream | None, layout: str) -> Unit:
    """Of the file's values."""
    si = si_of(canonical, layout)
    text = table.text("unit", si or None)
    try:
        unit = unit_named(text)
    except UnknownName as unknown:
        raise table.fail("unit", f"is {text!r}", str(unknown)) from None
    if si and unit.si != si and "scale" not in table:
        raise table.fail(
            "unit", f"is {text!r}, but {name} is in {si}", f"use a unit of {si}, or add `scale`"
        )
    return unit


def scale_of(table: Table, unit: Unit, si: str) -> float:
    """What the values are multiplied by after that."""
    if table.raw("scale", 1.0) == "fit":
        return 1.0
    scale = table.number("scale", 1.0)
    if scale == 0.0:
        raise table.fail("scale", "is 0", "give the factor to SI")
    converts = unit.si == si and unit.factor != 1.0
    if converts and abs(scale / unit.factor - 1.0) < TWICE:
        raise table.fail(
            "scale",
            f"is {scale:g}, which is {table.text('unit')} in {si}, and `unit` converts already",
            "remove `scale`, which multiplies what `unit` gives",
        )
    return scale


def noise_of(table: Table, canonical: Stream | None) -> Array | None:
    """(k,) or (1,) 1 sigma of a sample [SI]; None where nothing is stated."""
    if "noise" not in table:
        return None
    unit = canonical.unit if canonical else "its SI unit"
    size = None if isinstance(table.raw("noise"), list) else 1
    noise = table.numbers("noise", size, low=0.0, unit=unit)
    if not noise.all():
        raise table.fail("noise", "is 0", "give what a sample scatters by, or leave it out")
    return noise
