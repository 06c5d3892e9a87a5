"""How simulated runs start."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.platform import Platform
from twin.rotation import from_rotation_vector

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InitialState:
    """How the runs start; each shape broadcasts against (n, width)."""

    attitude: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    """(4,) or (n, 4), world from body; ball joints and free bases."""
    rate_body: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) or (n, 3) [rad/s]; ball joints."""
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) or (n, 3) of the CR in the room [m/s]; free bases, and x and y of planar ones."""
    joint_angle: float | Array = 0.0
    """Or (n, 1) [rad]; hinges."""
    joint_rate: float | Array = 0.0
    """Or (n, 1) [rad/s]; hinges."""
    wheel_speed: float | Array | None = None
    """Or (wheels,), (n, wheels) [rad/s]; their home unless given."""
    stage_position: float | Array = 0.0
    """Or (stages,), (n, stages) [m]."""
    gimbal_angle: Array | None = None
    """(gimbals,) or (n, gimbals) [rad]; their home unless given."""
    center_of_mass_offset: Array | None = None
    """(3,) or (n, 3) m r at stage position 0 [kg m, body]; as the platform states unless given."""

    def wheel_speeds(self, platform: Platform) -> float | Array:
        """As given, or at home [rad/s]."""
        home = np.array([wheel.home for wheel in platform.wheels])
        return home if self.wheel_speed is None else self.wheel_speed


def hanging(moment: Array, largest_tilt: float = np.inf) -> Array:
    """Attitudes (..., 4) in which m r (..., 3) hangs straight down.

    None is tilted by more than `largest_tilt` [rad]. The body turns about a level axis; one that
    would have to turn upside down stays as it is.
    """
    across = np.stack([-moment[..., 1], moment[..., 0], np.zeros(moment.shape[:-1])], axis=-1)
    size = np.sqrt(moment[..., 0] ** 2 + moment[..., 1] ** 2)
    angle = np.minimum(np.arctan2(size, -moment[..., 2]), largest_tilt)
    # the body turns the other way, so that its m r comes to the room's downwards
    return from_rotation_vector((angle / np.where(size > 0.0, size, 1.0))[..., None] * across)


def check_within_stop(platform: Platform, attitude: Array) -> None:
    """Refuse attitudes (4,) or (n, 4) that lean beyond the machine's stop.

    Raises:
        UsageError: one of them does, and by how much.
    """
    if platform.base.kind != "ball" or not np.isfinite(platform.stop_angle):
        return
    lean = float(np.max(platform.lean(attitude)))
    if lean > platform.stop_angle:
        raise UsageError(
            f"{platform.name} would start at {np.degrees(lean):.3g} deg, beyond the stop at "
            f"{np.degrees(platform.stop_angle):.3g} deg"
        )


def check_velocity(platform: Platform, velocity: Array) -> None:
    """Refuse a velocity (3,) or (n, 3) [m/s] of a machine whose base stays where it is.

    Raises:
        UsageError: it has one.
    """
    if np.any(velocity) and not platform.base.travels:
        given = " ".join(f"{item:g}" for item in np.atleast_2d(velocity)[0])
        raise UsageError(
            f"{platform.name} stays where it is, but would start with a velocity of {given} m/s; "
            "leave it out"
        )
