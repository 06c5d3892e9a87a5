"""[environment] of a log.toml or a platform.toml: field and gravity where a machine stands."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.config import Table

Array = NDArray[np.float64]

STRONGEST = 0.1
"""More than any cage makes, and less than the earth's field read in uT, mG or G [T]."""
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
