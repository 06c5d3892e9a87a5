"""Unit texts of measured files (`deg/s`, `rpm`, `uT`, `mN m`) to SI factors.

A text is looked up in a table first, then read as a product of units with prefixes and powers
(`deg s^-1`, `milli-g`, `degrees/second`). Libraries of units read `g` as a gram, `Nm` as nothing
and `rad` as a number; in the files of these laboratories they are the standard gravity, the unit
of torque and the unit of an angle.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

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
    "h": Unit(3600.0, "s"),
    "day": Unit(86400.0, "s"),
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

_SPELLINGS = {
    **{"µ": "u", "μ": "u", "°": "deg", "²": "^2", "³": "^3", "⁻": "^-", "¹": "1"},
    **{"·": " ", "⋅": " ", "**": "^", "*": " ", " per ": "/"},
}
"""How else people write the same; applied before the look-up."""

_SYNONYMS = {
    "": "1",
    "Am2": "A m^2",
    "Am^2": "A m^2",
    "kgm2": "kg m^2",
    "kgm^2": "kg m^2",
    "Nm": "N m",
    "mNm": "mN m",
    "uNm": "uN m",
    "Nms": "N m s",
    "deg C": "degC",
    "celsius": "degC",
}

_ATOMS: dict[str, tuple[float, str]] = {
    "rad": (1.0, "rad"),
    "deg": (_DEGREE, "rad"),
    "arcmin": (_DEGREE / 60.0, "rad"),
    "arcsec": (_DEGREE / 3600.0, "rad"),
    "rev": (2.0 * math.pi, "rad"),
    "s": (1.0, "s"),
    "min": (60.0, "s"),
    "h": (3600.0, "s"),
    "day": (86400.0, "s"),
    "m": (1.0, "m"),
    "in": (0.0254, "m"),
    "kg": (1.0, "kg"),
    "N": (1.0, "N"),
    "T": (1.0, "T"),
    "G": (1e-4, "T"),
    "V": (1.0, "V"),
    "A": (1.0, "A"),
    "Pa": (1.0, "Pa"),
    "bar": (1e5, "Pa"),
    "psi": (6894.757293168361, "Pa"),
    "K": (1.0, "K"),
    "Hz": (1.0, "Hz"),
}
"""Factor to SI, and the SI unit."""

_WORDS = {
    **dict.fromkeys(("radian", "radians", "rads"), "rad"),
    **dict.fromkeys(("degree", "degrees", "degs"), "deg"),
    **dict.fromkeys(("revolution", "revolutions", "revs", "turn", "turns"), "rev"),
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("minute", "minutes"), "min"),
    **dict.fromkeys(("hr", "hour", "hours"), "h"),
    "days": "day",
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("inch", "inches"), "in"),
    **dict.fromkeys(("newton", "newtons"), "N"),
    **dict.fromkeys(("tesla", "teslas"), "T"),
    **dict.fromkeys(("gauss", "gs"), "G"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("amp", "amps", "ampere", "amperes"), "A"),
    **dict.fromkeys(("pascal", "pascals"), "Pa"),
    **dict.fromkeys(("kelvin", "kelvins"), "K"),
    **dict.fromkeys(("hertz", "hz"), "Hz"),
}
"""Units in words, whatever their capitals."""

_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6}
_PREFIX_WORDS = {"nano": "n", "micro": "u", "milli": "m", "centi": "c", "kilo": "k", "mega": "M"}
_COMPOUND = {
    "g": (STANDARD_GRAVITY, {"m": 1, "s": -2}),
    "gee": (STANDARD_GRAVITY, {"m": 1, "s": -2}),
    "dps": (_DEGREE, {"rad": 1, "s": -1}),
    "rpm": (math.pi / 30.0, {"rad": 1, "s": -1}),
    "rps": (2.0 * math.pi, {"rad": 1, "s": -1}),
}
"""Units that are products of others."""

_FACTOR = re.compile(r"([A-Za-z]+)(?:\^?([+-]?\d+))?$")

_Product = tuple[float, dict[str, int]]
"""A factor to SI, and the powers of the SI units."""


def unit_named(text: str) -> Unit:
    """The unit of that text.

    Raises:
        UnknownName: no such unit; says which was probably meant.
    """
    name = text.strip()
    for written, ours in _SPELLINGS.items():
        name = name.replace(written, ours)
    name = " ".join(name.split())
    name = _SYNONYMS.get(name, name)
    if name in _UNITS:
        return _UNITS[name]
    product = _product(name)
    si = None if product is None else _si_texts().get(frozenset(product[1].items()))
    if product is None or si is None:
        raise UnknownName("unit", text, _UNITS)
    return Unit(product[0], si)


def known_unit(text: str) -> Unit | None:
    """The unit of that text; None where there is none."""
    try:
        return unit_named(text)
    except UnknownName:
        return None


@cache
def _si_texts() -> dict[frozenset[tuple[str, int]], str]:
    """The SI units of the table, by the powers of what they are made of."""
    products = {si: _product(si) for si in {unit.si for unit in _UNITS.values()} - {"1"}}
    return {frozenset(product[1].items()): si for si, product in products.items() if product}


def _product(text: str) -> _Product | None:
    """A text such as `deg s^-1` or `N-m/rad`; None where a part of it is no unit."""
    factor, powers = 1.0, dict[str, int]()
    over, *under = text.replace("(", " ").replace(")", " ").split("/")
    for sign, part in ((1, over), *((-1, part) for part in under)):
        part = re.sub(rf"({'|'.join(_PREFIX_WORDS)})[- ]", r"\1", part, flags=re.IGNORECASE)
        part = re.sub(r"(?<=[A-Za-z])-(?=[A-Za-z])", " ", part)
        for token in part.replace(".", " ").split():
            result = _FACTOR.match(token)
            atom = _atom(result[1]) if result else None
            if result is None or atom is None:
                return None
            power = sign * int(result[2] or 1)
            factor *= atom[0] ** power
            for name, exponent in atom[1].items():
                powers[name] = powers.get(name, 0) + power * exponent
    powers = {name: power for name, power in powers.items() if power}
    return (factor, powers) if powers else None


def _atom(text: str) -> _Product | None:
    """One unit with or without a prefix: `mdeg`, `milliradian`, `RPM`."""
    if (known := _unprefixed(text)) is not None:
        return known
    for word, symbol in _PREFIX_WORDS.items():
        if text.lower().startswith(word):
            return _scaled(symbol, _unprefixed(text[len(word) :]))
    return _scaled(text[0], _unprefixed(text[1:]))


def _scaled(prefix: str, unit: _Product | None) -> _Product | None:
    if unit is None or prefix not in _PREFIXES:
        return None
    return _PREFIXES[prefix] * unit[0], unit[1]


def _unprefixed(text: str) -> _Product | None:
    for name in (text, _WORDS.get(text.lower(), text.lower() if len(text) > 2 else text)):
        if name in _COMPOUND:
            return _COMPOUND[name]
        if name in _ATOMS:
            factor, si = _ATOMS[name]
            return factor, {si: 1}
    return None


SPIN = "rad/s about its own axis"
"""Unit of the speed of a wheel: as rad/s, but printed in rpm, as its maker states it."""
SPINNING = ("wheel_speed", "command_wheel_speed")
"""Streams of such speeds."""
_PRINTED = {
    SPIN: (("rpm", 0.0),),
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


def unit_of(stream: str, si: str) -> str:
    """Key for `fitting` and `printed` of a stream in this SI unit."""
    return SPIN if stream in SPINNING and si == "rad/s" else si


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


def as_precise(value: float, half: float) -> str:
    """A number with three digits, or as many as half its interval asks for: one of that."""
    text = three_digits(value)
    if not half > 0.0 or not math.isfinite(half) or "e" in text:
        return text
    places = min(-math.floor(math.log10(half)), 9)
    return f"{value:.{places}f}" if places > len(text.partition(".")[2]) else text


def span(seconds: float) -> str:
    """A time that a person waits: "8 s", "3 min", "1.5 h"."""
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def listed(names: Sequence[str]) -> str:
    """Names as a sentence has them: "x, y and z"; nothing of none."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
