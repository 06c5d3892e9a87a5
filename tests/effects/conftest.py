"""A dumbbell to put effects on."""

from dataclasses import replace

import numpy as np
import pytest

from twin.platform import Platform, load_platform


@pytest.fixture(scope="session")
def sads() -> Platform:
    """With a field, which the paper does not state, and without the tilt stop."""
    field = np.array([2.2e-5, 0.0, -4.2e-5])
    return replace(load_platform("sads"), magnetic_field=field, tilt_limit=np.pi)


@pytest.fixture(scope="session")
def balanced(sads: Platform) -> Platform:
    """Its CM in the CR: nothing but the effect turns it."""
    return replace(sads, center_of_mass_offset=np.zeros(3))
