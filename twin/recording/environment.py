"""[environment] of a log.toml or a platform.toml: field, gravity and latitude of a laboratory."""

from typing import Any

import numpy as np

from twin.config import Table

STRONGEST = 0.1
"""More than any cage makes, and less than the earth's field read in uT, mG or G [T]."""
EARTH_RATE = 7.292115e-5
"""[rad/s] of the Earth against the stars (WGS 84)."""
HEAVIEST = 100.0
"""More than any planet's [m/s^2]; a value in mm/s^2 or in Gal is above."""


def read_field(environment: Table, default: Any) -> Any:
    """(3,) `magnetic_field`, world [T]; `default` where it is not given.

    Raises:
        FileError: no three numbers, or stronger than any table's field.
    """
    field = environment.numbers("magnetic_field", 3, default, unit="T")
    if field is not default and np.abs(field).max() > STRONGEST:
        raise environment.fail(
            "magnetic_field",
            f"is {field.tolist()} T, and the earth's is 25e-6 to 65e-6 T",
            "give it in T: 1 uT is 1e-6 T, 1 G is 1e-4 T",
        )
    return field


def read_gravity(environment: Table, default: Any) -> Any:
    """`gravity` [m/s^2]; `default` where it is not given.

    Raises:
        FileError: no such number.
    """
    return environment.number("gravity", default, low=0.0, high=HEAVIEST, unit="m/s^2")


def read_earth_rate(environment: Table) -> list[float] | None:
    """(3,) rotation of the room against the stars, world [rad/s], by `latitude` and `heading`; None
    where neither is given.

    Raises:
        FileError: one of the two alone, or out of range.
    """
    latitude: Any = environment.number(
        "latitude", None, low=-0.5 * np.pi, high=0.5 * np.pi, unit="rad"
    )
    heading: Any = environment.number(
        "heading", None, low=-2.0 * np.pi, high=2.0 * np.pi, unit="rad"
    )
    if latitude is None and heading is None:
        return None
    if latitude is None or heading is None:
        given, lacks = ("latitude", "heading") if heading is None else ("heading", "latitude")
        raise environment.fail(
            given,
            f"stands without {lacks}",
            "give both in rad, the heading of the world's x axis from north to east; or neither",
        )
    north = np.cos(latitude) * np.array([np.cos(heading), np.sin(heading)])
    return [float(EARTH_RATE * part) for part in (*north, np.sin(latitude))]
