"""Unit quaternions, scalar first, any leading batch axes.

A quaternion q = (w, x, y, z) turns body components into world components: v_world = R(q) v_body,
as in MuJoCo. Functions take and return float64 arrays of shape (..., 4), (..., 3) or (..., 3, 3).
SciPy's Rotation is the peer in the tests; building one costs too much for a loop at n = 1.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

IDENTITY: Array = np.array([1.0, 0.0, 0.0, 0.0])


def _hamilton() -> Array:
    """(4, 16) that spreads a quaternion l into the matrix L of l r = L r, row by row."""
    spread = np.zeros((4, 4, 4))
    rows = ((0, -1, -2, -3), (1, 0, -3, 2), (2, 3, 0, -1), (3, -2, 1, 0))
    for k, row in enumerate(rows):
        for j, entry in enumerate(row):
            spread[abs(entry), k, j] = -1.0 if entry < 0 else 1.0
    return spread.reshape(4, 16)


_HAMILTON = _hamilton()


def multiply(first: Array, second: Array) -> Array:
    """Hamilton product: R(multiply(a, b)) = R(a) R(b)."""
    # two calls instead of twenty: this runs ten times a tick; the first product is exact
    rows = (first @ _HAMILTON).reshape(*first.shape[:-1], 4, 4)
    return np.einsum("...kj,...j->...k", rows, second)


def conjugate(q: Array) -> Array:
    """Inverse of a unit quaternion."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def normalized(q: Array) -> Array:
    """q scaled to unit length."""
    return q / np.sqrt(np.einsum("...i,...i->...", q, q))[..., None]


def continuous(q: Array, out: Array | None = None) -> Array:
    """Quaternions (m, 4) of one motion, without jumps of sign from one to the next; into `out`,
    which may be `q` itself, where it is given."""
    flips = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0.0
    turned = np.concatenate([[False], np.logical_xor.accumulate(flips)])
    out = q.copy() if out is None else out
    if out is not q:
        out[...] = q
    return np.negative(out, out=out, where=turned[:, None])


def rotate(q: Array, v: Array) -> Array:
    """R(q) v: body components of a vector into world components."""
    scalar, axis = q[..., :1], q[..., 1:]
    twice = 2.0 * cross(axis, v)
    return v + scalar * twice + cross(axis, twice)


def cross(a: Array, b: Array) -> Array:
    """a x b; ten times quicker than numpy.cross on small batches."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    out = np.empty((*x.shape, 3))
    out[..., 0] = x
    out[..., 1] = az * bx - ax * bz
    out[..., 2] = ax * by - ay * bx
    return out


def skew(v: Array) -> Array:
    """(..., 3, 3) that give the cross product with (..., 3) from the left."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2] = -z, y
    out[..., 1, 0], out[..., 1, 2] = z, -x
    out[..., 2, 0], out[..., 2, 1] = -y, x
    return out


def matrix(q: Array) -> Array:
    """R(q), shape (..., 3, 3)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[..., 0, 1] = 2.0 * (x * y - w * z)
    out[..., 0, 2] = 2.0 * (x * z + w * y)
    out[..., 1, 0] = 2.0 * (x * y + w * z)
    out[..., 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[..., 1, 2] = 2.0 * (y * z - w * x)
    out[..., 2, 0] = 2.0 * (x * z - w * y)
    out[..., 2, 1] = 2.0 * (y * z + w * x)
    out[..., 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return out


def vertical_body(q: Array) -> Array:
    """The world's z axis in body components (third row of R), shape (..., 3)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty((*q.shape[:-1], 3))
    out[..., 0] = 2.0 * (x * z - w * y)
    out[..., 1] = 2.0 * (y * z + w * x)
    out[..., 2] = 1.0 - 2.0 * (x * x + y * y)
    return out


def tilt(q: Array) -> Array:
    """Angle [rad] between the body's z axis and the vertical, shape (...)."""
    return 2.0 * np.arcsin(np.clip(np.hypot(q[..., 1], q[..., 2]), 0.0, 1.0))


def from_rotation_vector(phi: Array) -> Array:
    """exp(phi / 2) as a quaternion; phi [rad] is axis times angle."""
    half = 0.5 * np.sqrt(np.einsum("...i,...i->...", phi, phi))
    out = np.empty((*phi.shape[:-1], 4))
    out[..., 0] = np.cos(half)
    # sin(x) / x is 1 to the last bit long before x is so small
    nonzero = np.maximum(half, 1e-150)
    out[..., 1:] = phi * (0.5 * np.sin(nonzero) / nonzero)[..., None]
    return out


def to_rotation_vector(q: Array) -> Array:
    """Axis times angle [rad], the shorter way round, shape (..., 3)."""
    shortest = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.sqrt(np.einsum("...i,...i->...", shortest[..., 1:], shortest[..., 1:]))
    angle = 2.0 * np.arctan2(sine, shortest[..., 0])
    # angle / sine -> 2 as both vanish; below 1e-8 the series is exact to the last bit
    factor = np.where(sine > 1e-8, angle / np.where(sine > 1e-8, sine, 1.0), 2.0)
    return shortest[..., 1:] * factor[..., None]


def from_euler_zyx(yaw: Array, pitch: Array, roll: Array) -> Array:
    """Intrinsic z-y'-x'' angles [rad] to a quaternion, shape (..., 4)."""
    cy, sy = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    cp, sp = np.cos(0.5 * pitch), np.sin(0.5 * pitch)
    cr, sr = np.cos(0.5 * roll), np.sin(0.5 * roll)
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def to_euler_zyx(q: Array) -> Array:
    """Intrinsic z-y'-x'' angles (yaw, pitch, roll) [rad], shape (..., 3)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    pitch = np.arcsin(np.clip(2.0 * (w * y - x * z), -1.0, 1.0))
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return np.stack([yaw, pitch, roll], axis=-1)


def least_turn(turn: Array, axis: Array) -> Array:
    """The smallest rotation vectors (..., 3) that take a unit axis (3,) where `turn` (..., 3)
    takes it."""
    there = rotate(from_rotation_vector(turn), np.broadcast_to(axis, turn.shape))
    across = cross(np.broadcast_to(axis, there.shape), there)
    sine = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (there @ axis)[..., None])
    return np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0) * across
