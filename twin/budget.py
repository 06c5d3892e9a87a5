"""What a manoeuvre asks of wheels and gyros, before it is flown: the balance of angular momentum.

A platform that follows its reference exactly has its whole angular momentum dictated by gravity:
dH/dt = (R m r) x g in world axes. What the body does not carry, the wheels must:
h(t) = R^T H(t) - J w(t). The offset's torque is not taken away by any law, so its integral decides
when a wheel reaches its limit. Stages are taken at 0 and contacts are left out.

An array of control moment gyros has no limit of a single part: it is used up where no turn of its
gimbals gives a torque along some direction. Within the sphere without singular states it never is.
A law without an integral lets the body lean until law and gravity hold each other, which turns
part of the torque away; over minutes that decides (`leaning`).
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from twin.controller.exchange import Gyros
from twin.estimators.estimator import blank
from twin.platform import Platform
from twin.reference import Reference
from twin.rotation import (
    conjugate,
    cross,
    from_rotation_vector,
    multiply,
    rotate,
    vertical_body,
)
from twin.signals import Estimate

Array = NDArray[np.float64]

_GRID = 0.1
"""[s]; references move in seconds, not in tenths of one."""
_ROUNDS = 4
"""Of Newton's method."""
_SMALL = 1e-4
"""Of a numerical derivative [rad]."""
_SINGULAR = 1e8
"""Condition beyond which law and gravity hold nothing."""
_NEAR = 0.5
"""Lean beyond which it is none that a law holds [rad]."""
SINGULAR = 0.1
"""Margin of an array below which it is as good as singular: for a torque of H / 100 a second the
gimbals then turn by more than 0.1 rad/s."""
_COARSE = 60
"""Directions to each quarter turn of the search for the smallest singular momentum."""


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
    axes = np.stack([wheel.axis for wheel in platform.wheels])
    inertia = np.array([wheel.inertia for wheel in platform.wheels])
    start = (inertia * wheel_speed) @ axes
    of_wheels = _carried(platform, time, target.attitude, target.rate_body, start)
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


def _carried(
    platform: Platform, time: Array, attitude: Array, rate_body: Array, start: Array
) -> Array:
    """What wheels or gyros hold of the momentum along a motion, (m, 3) [N m s, body].

    Args:
        platform: whose J and m r count.
        time: (m,) [s].
        attitude: (m, 4).
        rate_body: (m, 3) [rad/s].
        start: what they hold at first, (3,) [N m s, body].
    """
    gravity_world = np.array([0.0, 0.0, -platform.gravity])
    torque_world = cross(rotate(attitude, platform.center_of_mass_offset[None]), gravity_world)
    steps = 0.5 * (torque_world[1:] + torque_world[:-1]) * np.diff(time)[:, None]
    gained_world = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    of_body = rate_body @ platform.inertia
    total_world = rotate(attitude[:1], (of_body[0] + start)[None]) + gained_world
    return rotate(conjugate(attitude), total_world) - of_body


@dataclass(frozen=True)
class GyroBudget:
    """Momentum of an array of gyros that a manoeuvre needs, and how near it comes to singular."""

    time: Array
    """(m,) [s]."""
    momentum: Array
    """(m, 3) of the array [N m s, body]."""
    margin: Array
    """(m,) as `singular_margin`; NaN after it has fallen below `SINGULAR`."""
    radius: float
    """Of the sphere of momenta without singular states [N m s]."""
    lean: float
    """By which the body stands off the reference at first, for want of an integral [rad]."""
    singular_at: float | None
    """When its margin falls below `SINGULAR` [s]; None if it does not."""


def gyro_budget(
    platform: Platform,
    reference: Reference,
    duration: float,
    angles: Array,
    stiffness: Array | None = None,
) -> GyroBudget:
    """Momentum and gimbal angles while `reference` is followed for `duration` [s].

    The gimbals turn by the least-squares inverse, as long as the array is not singular.

    Args:
        platform: whose gimbals carry rotors at constant speed.
        reference: what is to be followed.
        duration: [s].
        angles: of the gimbals at first, (gimbals,) [rad].
        stiffness: the law's torque on the body per rotation of it off its target, (3, 3) [N m/rad];
            None: it stands off by nothing.
    """
    time = np.linspace(0.0, duration, max(int(np.ceil(duration / _GRID)), 1) + 1)
    target = reference.at(time)
    lean = np.zeros((len(time), 3))
    if stiffness is not None:
        lean = leaning(platform, target.attitude, stiffness)
    attitude = multiply(target.attitude, from_rotation_vector(lean))
    array = Gyros.of(platform, "the forecast")
    estimate = blank(platform, 1)
    estimate.gimbal_angle = np.array(angles, dtype=np.float64)[None]
    start = array.momentum(estimate)[0]
    momentum = _carried(platform, time, attitude, target.rate_body, start)
    margin = np.full(len(time), np.nan)
    for row in range(len(time)):
        margin[row] = singular_margin(array, estimate)[0]
        if margin[row] < SINGULAR or row + 1 == len(time):
            break
        # towards what the array has to hold at the next row, whatever it errs by at this one
        missing = momentum[row + 1] - array.momentum(estimate)[0]
        inverse = np.linalg.pinv(array.columns(estimate)[0].T)
        estimate.gimbal_angle = estimate.gimbal_angle + inverse @ missing
    late = np.flatnonzero(margin < SINGULAR)
    axes = np.array([gimbal.axis for gimbal in platform.gimbals])
    return GyroBudget(
        time=time,
        momentum=momentum,
        margin=margin,
        radius=singularity_free_radius(axes, np.abs(array.fixed)),
        lean=float(np.linalg.norm(lean[0])),
        singular_at=float(time[late[0]]) if late.size else None,
    )


def singular_margin(array: Gyros, estimate: Estimate) -> Array:
    """Distance of an array from a singular state, (n,) [-].

    The smallest singular value of A, dh/dt = A d(delta)/dt, in parts of H = (mean H_i^2)^(1/2): 0
    in a singular state; three gyros at right angles have 1 at most.
    """
    scale = np.sqrt(np.mean(array.sizes(estimate) ** 2, axis=1))
    values = np.linalg.svd(array.columns(estimate), compute_uv=False)
    return values[:, -1] / np.maximum(scale, 1e-12)


def constant_gyros(platform: Platform) -> bool:
    """Whether a machine has gyros that turn it about three axes, all at constant speed."""
    constant = bool(platform.rotors) and all(wheel.gimbal is None for wheel in platform.wheels)
    return constant and len(platform.gimbals) >= 3


def leaning(platform: Platform, attitude: Array, stiffness: Array) -> Array:
    """Rotation (m, 3) [rad] off targets (m, 4) at which a law's torque and gravity's cancel.

    K phi + (m r) x g_body(q exp(phi)) = 0 by Newton's method; 0 where the law leaves the body to
    gravity, so that there is no such attitude near by.
    """

    def pull(phi: Array) -> Array:
        down = -platform.gravity * vertical_body(multiply(attitude, from_rotation_vector(phi)))
        return cross(np.broadcast_to(platform.center_of_mass_offset, down.shape), down)

    phi = np.zeros((len(attitude), 3))
    for _ in range(_ROUNDS):
        slope = np.stack(
            [(pull(phi + step) - pull(phi - step)) / (2.0 * _SMALL) for step in _SMALL * np.eye(3)],
            axis=-1,
        )
        matrix = stiffness + slope
        if np.linalg.cond(matrix).max() > _SINGULAR:
            return np.zeros_like(phi)
        force = pull(phi) + np.einsum("ij,mj->mi", stiffness, phi)
        phi = phi - np.linalg.solve(matrix, force[..., None])[..., 0]
    near = np.isfinite(phi).all() and np.linalg.norm(phi, axis=1).max() < _NEAR
    return phi if near else np.zeros_like(phi)


def singular_momenta(axes: Array, along: Array, sizes: Array | None = None) -> Array:
    """Momenta of an array's singular states, (n, 2^(gimbals - 1), 3).

    In a singular state the array gives no torque along some u: each rotor stands as far along u, or
    against it, as its gimbal lets it (G. Margulies, J. N. Aubrun, Geometric theory of single-gimbal
    control moment gyro systems, 1978),

    h(u, s) = sum s_i H_i (u - (u . g_i) g_i) / |u - (u . g_i) g_i|,  s_i = +-1.

    Along a gimbal's own axis the rotor may stand anywhere; the directions round about cover that.

    Args:
        axes: of the gimbals, (gimbals, 3).
        along: directions u, (n, 3).
        sizes: momentum of each rotor, (gimbals,) [N m s]; 1 each unless given.
    """
    across = along[:, None, :] - np.einsum("ni,gi->ng", along, axes)[..., None] * axes
    size = np.linalg.norm(across, axis=2, keepdims=True)
    rotors = across / np.maximum(size, 1e-12)
    if sizes is not None:
        rotors = sizes[:, None] * rotors
    return np.einsum("sg,ngi->nsi", singular_signs(len(axes)), rotors)


def singular_signs(gimbals: int) -> Array:
    """(2^(gimbals - 1), gimbals): which rotors stand along u, and which against it.

    Those with all signs turned are the same states from behind.
    """
    return np.array([(1.0, *rest) for rest in product((1.0, -1.0), repeat=gimbals - 1)])


def singularity_free_radius(axes: Array, sizes: Array | None = None) -> float:
    """The smallest momentum of a singular state, in the unit of `sizes`, by search over u.

    Args:
        axes: of the gimbals, (gimbals, 3).
        sizes: momentum of each rotor, (gimbals,); 1 each unless given.
    """
    from scipy.optimize import minimize

    def size(angles: Array) -> float:
        surface = singular_momenta(axes, directions(angles[None]), sizes)
        return float(np.linalg.norm(surface, axis=2).min())

    polar, around = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, 2 * _COARSE), np.linspace(0.0, 2.0 * np.pi, 4 * _COARSE)
    )
    grid = np.stack([polar.ravel(), around.ravel()], axis=1)
    found = np.linalg.norm(singular_momenta(axes, directions(grid), sizes), axis=2).min(axis=1)
    starts = grid[np.argsort(found)[:5]]
    options = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 400}
    result = [minimize(size, start, method="Nelder-Mead", options=options).fun for start in starts]
    return float(min(*result, found.min()))


def directions(angles: Array) -> Array:
    """(n, 3) from (n, 2) polar and azimuth."""
    polar, around = angles[:, 0], angles[:, 1]
    across = np.sin(polar)
    return np.stack([across * np.cos(around), across * np.sin(around), np.cos(polar)], axis=1)
