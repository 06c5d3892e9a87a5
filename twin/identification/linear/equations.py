"""The balance of angular momentum, instant by instant, as rows for J and m r.

    J dw/dt + w x J w - m r x g = -dc/dt - w x c + d x g + T        (natural)

and its integral from the first instant, in body axes, which differentiates nothing. J. L. Schwartz
and C. D. Hall (AAS 04-122), eq. 10 to 25; J.-J. Kim and B. N. Agrawal, System identification and
automatic mass balancing of ground-based three-axis spacecraft simulator, eq. 5 to 8, whose wheels'
momentum h is our c.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from twin import rotation
from twin.identification.track import Track
from twin.predict.base import ENTRIES

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Equations:
    """rows @ (Jxx Jyy Jzz Jxy Jxz Jyz, m r) = target."""

    time: Array
    """(m,) [s]."""
    rows: Array
    """(m, k, 9)."""
    target: Array
    """(m, k)."""

    def every(self, stride: int) -> "Equations":
        """Each so many instants."""
        return Equations(self.time[::stride], self.rows[::stride], self.target[::stride])

    def about(self, axis: Array | None) -> "Equations":
        """The component along a hinge's axis; all of them without one, or if there is but one."""
        if axis is None or self.target.shape[1] == 1:
            return self
        rows, target = axis @ self.rows, self.target @ axis
        return Equations(self.time, rows[:, None, :], target[:, None])


def natural(track: Track) -> Equations:
    """As it stands: rates are differentiated by central differences. Eq. 16 of AAS 04-122."""
    turned = _slope(inertia_rows(track.rate), track)
    gained = _slope(track.carried, track)
    return Equations(track.time, _rows(track, turned), _target(track, gained))


def integrated(track: Track) -> Equations:
    """From the first instant on, in body axes. Eq. 17 of AAS 04-122; eq. 8 of Kim and Agrawal."""
    momentum, carried = inertia_rows(track.rate), track.carried
    still = np.zeros_like(momentum), np.zeros_like(carried)
    rows = integral(_rows(track, still[0]), track)
    rows[..., :6] += momentum - momentum[0]
    target = integral(_target(track, still[1]), track) - (carried - carried[0])
    return Equations(track.time, rows, target)


def filtered(track: Track, corner: float) -> Equations:
    """Both sides through 1 / (s + a). Eq. 7 of Kim and Agrawal.

    Args:
        track: the log.
        corner: a [rad/s].
    """
    momentum, carried = inertia_rows(track.rate), track.carried
    through = _low_pass(corner, track.step)
    rows = through(_rows(track, np.zeros_like(momentum))) / corner
    # the filter starts with what it sees first: then no transient is left out
    rows[..., :6] += momentum - momentum[0] - through(momentum - momentum[0])
    change = carried - carried[0]
    target = through(_target(track, np.zeros_like(carried))) / corner - change + through(change)
    return Equations(track.time, rows, target)


def shifted(equations: Equations, attitude: Array, shift: int) -> Equations:
    """Differences between two instants so many samples apart, the first turned into the second's
    axes; each instant is used once. The momentum integral, eq. 19 of AAS 04-122."""
    whole = len(equations.time) // (2 * shift) * 2 * shift
    first = np.arange(whole).reshape(-1, 2, shift)[:, 0].ravel()
    second = first + shift
    turn = rotation.matrix(rotation.multiply(rotation.conjugate(attitude[second]), attitude[first]))
    rows = equations.rows[second] - turn @ equations.rows[first]
    target = equations.target[second] - (turn @ equations.target[first][..., None])[..., 0]
    return Equations(equations.time[second], rows, target)


def power(track: Track) -> Equations:
    """The balance along the rate: what w . (dH/dt + w x H) does. Eq. 20 of AAS 04-122."""
    now = natural(track)
    rows = np.einsum("ni,nik->nk", track.rate, now.rows)
    return Equations(now.time, rows[:, None, :], np.sum(track.rate * now.target, axis=1)[:, None])


def energy(track: Track) -> Equations:
    """Its integral. Eq. 25 of AAS 04-122, its kinetic energy with the factor 1/2 that it lacks.

    What wheels take, the integral of w . dc, is summed over the steps of c: nothing is
    differentiated, though the paper gave the method up for it.
    """
    rate = track.rate
    rows = np.zeros((len(track.time), 9))
    kinetic = 0.5 * np.einsum("ni,nik->nk", rate, inertia_rows(rate))
    rows[:, :6] = kinetic - kinetic[0]
    along = np.einsum("ni,nik->nk", rate, gravity_rows(track.gravity))
    rows[:, 6:] = integral(along, track)
    work = np.sum(rate * (rotation.cross(track.moved, track.gravity) + track.torque), axis=1)
    taken = 0.5 * np.sum((rate[1:] + rate[:-1]) * np.diff(track.carried, axis=0), axis=1)
    target = integral(work, track) - np.concatenate([[0.0], np.cumsum(taken)])
    return Equations(track.time, rows[:, None, :], target[:, None])


def inertia_rows(vectors: Array) -> Array:
    """(m, 3, 6): what the entries of J are multiplied by in J v."""
    rows = np.zeros((len(vectors), 3, len(ENTRIES)))
    for entry, (i, j) in enumerate(ENTRIES):
        rows[:, i, entry] = vectors[:, j]
        rows[:, j, entry] = vectors[:, i]
    return rows


def gravity_rows(gravity: Array) -> Array:
    """(m, 3, 3) [g x], as -(m r) x g has it."""
    return rotation.cross(gravity[:, None, :], np.eye(3)).swapaxes(1, 2)


def _rows(track: Track, turned: Array) -> Array:
    """(m, 3, 9) of the natural form, dJw/dt given."""
    swept = rotation.cross(track.rate[:, None, :], inertia_rows(track.rate).swapaxes(1, 2))
    return np.concatenate([turned + swept.swapaxes(1, 2), gravity_rows(track.gravity)], axis=2)


def _target(track: Track, gained: Array) -> Array:
    """(m, 3) of the natural form, dc/dt given."""
    swept = rotation.cross(track.rate, track.carried)
    return rotation.cross(track.moved, track.gravity) + track.torque - gained - swept


def _slope(values: Array, track: Track) -> Array:
    return np.gradient(values, track.step, axis=0)


def integral(values: Array, track: Track) -> Array:
    """Of (m, ...) from the first instant on, by the trapezoidal rule."""
    summed = cumulative_trapezoid(values, dx=track.step, axis=0, initial=0.0)
    return np.asarray(summed, dtype=np.float64)


def _low_pass(corner: float, step: float) -> Callable[[Array], Array]:
    """a / (s + a), by the trapezoidal rule, from rest."""
    half = 0.5 * corner * step
    ahead, back = [half / (1.0 + half)] * 2, [1.0, (half - 1.0) / (half + 1.0)]

    def through(values: Array) -> Array:
        return np.asarray(lfilter(ahead, back, values, axis=0), dtype=np.float64)

    return through
