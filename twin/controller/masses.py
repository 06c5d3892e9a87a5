"""Balance masses as actuators: from a gravity torque to stage positions, and their limits."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.errors import ControllerError
from twin.platform import Platform
from twin.rotation import cross

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Masses:
    """The stages of one platform; for axes that are not orthogonal, pinv(u_1 ... u_N) shares."""

    allocation: Array
    """Stage position per mass moment, (stages, 3) [1/kg]."""
    travel: Array
    """Lowest and highest position, (2, stages) [m]."""
    speed: Array
    """Highest, (stages,) [m/s]."""
    gravity: float
    """[m/s^2]."""

    @classmethod
    def of(cls, platform: Platform, law: str) -> "Masses":
        """Those of the platform.

        Raises:
            ControllerError: they do not move the CM in both horizontal directions, as `law` does.
        """
        stages = platform.stages
        axes = np.array([stage.axis for stage in stages]).reshape(-1, 3)
        if np.linalg.matrix_rank(axes[:, :2]) < 2:
            raise ControllerError(
                f"{law} moves the CM in both horizontal directions, but the {len(axes)} stages "
                f"of {platform.name} do not; choose a platform whose stages do"
            )
        masses = np.array([stage.mass for stage in stages])
        return cls(
            allocation=np.linalg.pinv(axes.T) / masses[:, None],
            travel=np.array([stage.travel for stage in stages]).T,
            speed=np.array([stage.speed for stage in stages]),
            gravity=platform.gravity,
        )

    def positions(self, moment: Array) -> Array:
        """Stage positions (n, stages) [m] that add a mass moment (n, 3) [kg m, body]."""
        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        return np.einsum("ij,nj->ni", self.allocation, moment)

    def leaning(self, torque: Array, up: Array) -> Array:
        """Stage positions (n, stages) [m] whose gravity torque is the horizontal part of `torque`.

        m_j d_j = (g^ x tau)_j / |g|, g^ = -up: the least mass moment that does.

        Args:
            torque: on the body, (n, 3) [N m, body].
            up: the vertical, upwards, (n, 3) in body axes.
        """
        return self.positions(cross(torque, up) / self.gravity)

    def integrated(self, position: Array, step: Array, direct: Array) -> tuple[Array, Array]:
        """An integral kept as stage positions, and the command with `direct` on top, (n, stages).

        Its windup stops stage by stage, while a stage is asked to go beyond its travel.
        """
        low, high = self.travel
        asked = position + step + direct
        beyond = ((asked > high) & (step > 0.0)) | ((asked < low) & (step < 0.0))
        position = np.where(beyond, position, position + step)
        return position, np.clip(position + direct, low, high)
