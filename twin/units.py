"""Unit texts of measured files (`deg/s`, `rpm`, `uT`, `mN m`) to SI factors."""

import math
from dataclasses import dataclass

from twin.errors import UnknownName

STANDARD_GRAVITY = 9.80665
"""One g of an accelerometer's data sheet [m/s^2]; the exact value of the standard."""


@dataclass(frozen=True)
class Unit:
    """SI value = factor * value + offset."""

    factor: float
    si: str
    """The SI unit that results."""
    offset: float = 0.0


_DEGREE = math.pi / 180.0

_UNITS: dict[str, Unit] = {
    "1": Unit(1.0, "1"),
    "-": Unit(1.0, "1"),
    "%": Unit(1e-2, "1"),
    "rad": Unit(1.0, "rad"),
    "mrad": Unit(1e-3, "rad"),
    "urad": Unit(1e-6, "rad"),
    "deg": Unit(_DEGREE, "rad"),
    "arcmin": Unit(_DEGREE / 60.0, "rad"),
    "arcsec": Unit(_DEGREE / 3600.0, "rad"),
    "rev": Unit(2.0 * math.pi, "rad"),
    "rad/s": Unit(1.0, "rad/s"),
    "mrad/s": Unit(1e-3, "rad/s"),
    "deg/s": Unit(_DEGREE, "rad/s"),
    "mdeg/s": Unit(1e-3 * _DEGREE, "rad/s"),
    "deg/h": Unit(_DEGREE / 3600.0, "rad/s"),
    "rpm": Unit(math.pi / 30.0, "rad/s"),
    "rev/s": Unit(2.0 * math.pi, "rad/s"),
    "m/s^2": Unit(1.0, "m/s^2"),
    "mm/s^2": Unit(1e-3, "m/s^2"),
    "g": Unit(STANDARD_GRAVITY, "m/s^2"),
    "mg": Unit(1e-3 * STANDARD_GRAVITY, "m/s^2"),
    "T": Unit(1.0, "T"),
    "mT": Unit(1e-3, "T"),
    "uT": Unit(1e-6, "T"),
    "nT": Unit(1e-9, "T"),
    "G": Unit(1e-4, "T"),
    "mG": Unit(1e-7, "T"),
    "m": Unit(1.0, "m"),
    "cm": Unit(1e-2, "m"),
    "mm": Unit(1e-3, "m"),
    "um": Unit(1e-6, "m"),
    "in": Unit(0.0254, "m"),
    "m/s": Unit(1.0, "m/s"),
    "mm/s": Unit(1e-3, "m/s"),
    "s": Unit(1.0, "s"),
    "ms": Unit(1e-3, "s"),
    "us": Unit(1e-6, "s"),
    "ns": Unit(1e-9, "s"),
    "min": Unit(60.0, "s"),
    "V": Unit(1.0, "V"),
    "mV": Unit(1e-3, "V"),
    "A": Unit(1.0, "A"),
    "mA": Unit(1e-3, "A"),
    "N": Unit(1.0, "N"),
    "mN": Unit(1e-3, "N"),
    "N m": Unit(1.0, "N m"),
    "mN m": Unit(1e-3, "N m"),
    "uN m": Unit(1e-6, "N m"),
    "N m s": Unit(1.0, "N m s"),
    "mN m s": Unit(1e-3, "N m s"),
    "uN m s": Unit(1e-6, "N m s"),
    "N m s^2": Unit(1.0, "N m s^2"),
    "mN m s^2": Unit(1e-3, "N m s^2"),
    "uN m s^2": Unit(1e-6, "N m s^2"),
    "N m/rad": Unit(1.0, "N m/rad"),
    "mN m/rad": Unit(1e-3, "N m/rad"),
    "uN m/rad": Unit(1e-6, "N m/rad"),
    "kg": Unit(1.0, "kg"),
    "kg m": Unit(1.0, "kg m"),
    "kg m^2": Unit(1.0, "kg m^2"),
    "A m^2": Unit(1.0, "A m^2"),
    "mA m^2": Unit(1e-3, "A m^2"),
    "Pa": Unit(1.0, "Pa"),
    "hPa": Unit(1e2, "Pa"),
    "kPa": Unit(1e3, "Pa"),
    "bar": Unit(1e5, "Pa"),
    "mbar": Unit(1e2, "Pa"),
    "psi": Unit(6894.757293168361, "Pa"),
    "K": Unit(1.0, "K"),
    "degC": Unit(1.0, "K", 273.15),
    "Hz": Unit(1.0, "Hz"),
}

_SPELLINGS = {"µ": "u", "μ": "u", "°": "deg", "²": "^2", "·": " ", "*": " "}
"""How else people write the same; applied before the look-up."""

_SYNONYMS = {
    "": "1",
    "dps": "deg/s",
    "deg/sec": "deg/s",
    "rad/sec": "rad/s",
    "m/s2": "m/s^2",
    "m/s/s": "m/s^2",
    "mm/s2": "mm/s^2",
    "kg m2": "kg m^2",
    "A m2": "A m^2",
    "Am2": "A m^2",
    "Am^2": "A m^2",
    "Nm": "N m",
    "mNm": "mN m",
    "uNm": "uN m",
    "Nms": "N m s",
    "gauss": "G",
    "sec": "s",
}


def unit_named(text: str) -> Unit:
    """The unit of that text.

    Raises:
        UnknownName: no such unit; says which was probably meant.
    """
    name = text.strip()
    for written, ours in _SPELLINGS.items():
        name = name.replace(written, ours)
    name = _SYNONYMS.get(name, name)
    if name not in _UNITS:
        raise UnknownName("unit", text, _UNITS)
    return _UNITS[name]


_PRINTED = {
    "rad": (("deg", 0.0),),
    "rad/s": (("deg/s", 0.0),),
    "N m": (("N m", 0.1), ("mN m", 1e-4), ("uN m", 0.0)),
    "N m s": (("N m s", 0.1), ("mN m s", 1e-4), ("uN m s", 0.0)),
    "N m s^2": (("N m s^2", 0.1), ("mN m s^2", 1e-4), ("uN m s^2", 0.0)),
    "N m/rad": (("N m/rad", 0.1), ("mN m/rad", 1e-4), ("uN m/rad", 0.0)),
    "s": (("s", 0.5), ("ms", 1e-3), ("us", 0.0)),
    "m": (("m", 0.1), ("mm", 1e-4), ("um", 0.0)),
}
"""SI unit -> units to print in, each from a size [SI] upwards."""


def fitting(size: float, si: str) -> tuple[float, str]:
    """Factor and name of the unit in which a value of this size [SI] is best printed."""
    name = next((u for u, least in _PRINTED.get(si, ()) if abs(size) >= least), si)
    return _UNITS.get(name, Unit(1.0, si)).factor, name


def printed(value: float, si: str, size: float | None = None) -> str:
    """A number as a person writes it: three digits and a fitting unit (0.0123 N m -> 12.3 mN m).

    `size` chooses the unit for a value that stands beside a larger one.
    """
    factor, name = fitting(value if size is None else size, si)
    number = three_digits(value / factor)
    return number if name == "1" else f"{number} {name}"


def three_digits(value: float) -> str:
    """0.0123, 12.3, 1234; never 1.23e+03."""
    text = f"{value:.3g}"
    return f"{value:.0f}" if "e+" in text else text
