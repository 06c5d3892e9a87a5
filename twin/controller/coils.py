"""Magnetorquers as actuators: from a torque to the dipole that gives what the field allows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.errors import ControllerError
from twin.platform import Platform
from twin.rotation import conjugate, cross, rotate

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coils:
    """Magnetorquers in the field that their platform states."""

    field_world: Array
    """(3,) [T]."""

    @classmethod
    def of(cls, platform: Platform, law: str) -> "Coils":
        """Those of the platform.

        Raises:
            ControllerError: it has none, or states no field.
        """
        if not platform.magnetorquers:
            raise ControllerError(
                f"{law} turns the body by magnetorquers, and {platform.name} has none; "
                "choose a platform that does"
            )
        if not np.any(platform.magnetic_field):
            raise ControllerError(
                f"{law} needs a magnetic field, and {platform.name} states none; "
                "give [environment] magnetic_field"
            )
        return cls(platform.magnetic_field)

    def dipole(self, attitude: Array, torque: Array) -> Array:
        """Least dipole that gives the part of a torque across the field: d = B x tau / |B|^2.

        Args:
            attitude: (n, 4), world from body.
            torque: (n, 3) [N m, body].

        Returns:
            Shape (n, 3) [A m^2, body].
        """
        field_world = np.broadcast_to(self.field_world, torque.shape)
        field_body = rotate(conjugate(attitude), field_world)
        return cross(field_body, torque) / float(self.field_world @ self.field_world)
