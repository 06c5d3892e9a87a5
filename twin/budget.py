"""What a manoeuvre asks of the wheels, before it is flown: the balance of angular momentum.

A platform that follows its reference exactly has its whole angular momentum dictated by gravity:
dH/dt = (R m r) x g in world axes. What the body does not carry, the wheels must:
h(t) = R^T H(t) - J w(t). The offset's torque is not taken away by any law, so its integral decides
when a wheel reaches its limit. Stages are taken at 0 and contacts are left out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.reference import Reference
from twin.rotation import conjugate, cross, rotate

Array = NDArray[np.float64]

_GRID = 0.1
"""[s]; references move in seconds, not in tenths of one."""


@dataclass(frozen=True)
class MomentumBudget:
    """Wheel momentum that a manoeuvre needs."""

    time: Array
    """(m,) [s]."""
    momentum: Array
    """(m, wheels) [N m s], along each spin axis."""
    peak: dict[str, float]
    """Largest magnitude of each wheel [N m s]."""
    saturates_at: float | None
    """When the first wheel reaches its limit [s]; None if none does."""
    first: str | None
    """Its name."""


def momentum_budget(
    platform: Platform, reference: Reference, duration: float, wheel_speed: Array | float = 0.0
) -> MomentumBudget:
    """Momentum of the wheels while `reference` is followed for `duration` [s].

    Args:
        platform: with at least one wheel, and none in a gimbal.
        reference: what is to be followed.
        duration: [s].
        wheel_speed: at the start, (wheels,) or one for all [rad/s].
    """
    time = np.linspace(0.0, duration, max(int(np.ceil(duration / _GRID)), 1) + 1)
    target = reference.at(time)
    attitude, rate_body = target.attitude, target.rate_body

    gravity_world = np.array([0.0, 0.0, -platform.gravity])
    torque_world = cross(rotate(attitude, platform.center_of_mass_offset[None]), gravity_world)
    steps = 0.5 * (torque_world[1:] + torque_world[:-1]) * np.diff(time)[:, None]
    gained_world = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])

    axes = np.stack([wheel.axis for wheel in platform.wheels])
    inertia = np.array([wheel.inertia for wheel in platform.wheels])
    of_body = rate_body @ platform.inertia
    start_body = of_body[0] + (inertia * wheel_speed) @ axes
    total_world = rotate(attitude[:1], start_body[None]) + gained_world
    of_wheels = rotate(conjugate(attitude), total_world) - of_body
    momentum = of_wheels @ np.linalg.pinv(axes)

    limit = np.array([wheel.momentum_limit for wheel in platform.wheels])
    over = np.abs(momentum) >= limit
    late = np.flatnonzero(over.any(axis=1))
    names = [wheel.name for wheel in platform.wheels]
    return MomentumBudget(
        time=time,
        momentum=momentum,
        peak=dict(zip(names, np.abs(momentum).max(axis=0).tolist(), strict=True)),
        saturates_at=float(time[late[0]]) if late.size else None,
        first=names[int(np.argmax(over[late[0]]))] if late.size else None,
    )
