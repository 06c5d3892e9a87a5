"""The balance of angular momentum as equations that are linear in J and m r: the papers' methods.

Each takes the gyro as it was read. Noise in the columns biases the estimate, and intervals
that come from the scatter of the residual do not contain that bias.

The balance of angular momentum, instant by instant, as rows for J and m r.

    J dw/dt + w x J w - m r x g = -dc/dt - w x c + d x g + T        (natural)

and its integral from the first instant, in body axes, which differentiates nothing. J. L. Schwartz
and C. D. Hall (AAS 04-122), eq. 10 to 25; J.-J. Kim and B. N. Agrawal, System identification and
automatic mass balancing of ground-based three-axis spacecraft simulator, eq. 5 to 8, whose wheels'
momentum h is our c.

m r from where the body hangs at several positions of its masses: for machines without wheels.
At rest gravity asks for no torque: (m r + d) x g = 0, g in body axes, d what the masses add. Known
moves of known masses set the scale, so all three components are seen. A body on air does not come
to rest, so g is its mean over pieces of the time in which the masses stand still.

Recursive least squares with forgetting, over the integrated balance.
K = P A^T (lambda I + A P A^T)^-1,  x += K (B - A x),  P = (P - K A P) / lambda

from where platform.toml states the base, three rows at a time. Source: G. Sharifi, M. Mirshams,
H. Shahmohamadi Ousaloo, Mass properties identification and automatic mass balancing system, 2019,
eq. 9 to 11; their lambda is 0.95 or 0.99 a step of 0.2 s.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter
from scipy.stats import t as student

from twin import rotation
from twin.errors import UsageError
from twin.identification.prediction_error import NORMAL
from twin.identification.track import Track
from twin.predict.base import ENTRIES, BaseParameters

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
        """Instants per block."""
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
    equations = natural(track)
    rows = np.einsum("ni,nik->nk", track.rate, equations.rows)
    return Equations(
        equations.time, rows[:, None, :], np.sum(track.rate * equations.target, axis=1)[:, None]
    )


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


BLOCK = 10.0
"""[s]."""
HELD = 1e-6
"""Weight with which what does not show is held where it was stated."""
UNSURE = 10.0
"""1 sigma of what does not show, in parts of its scale."""


@dataclass(frozen=True)
class LinearEstimate:
    """The base, as a method has it."""

    theta: Array
    """(p,) base parameters."""
    covariance: Array
    """(p, p)."""
    quantile: float
    """Half a 95 % interval is this many standard deviations."""

    @property
    def half_widths(self) -> Array:
        """(p,) half the 95 % intervals."""
        return self.quantile * np.sqrt(np.diag(self.covariance))


def least_squares(
    logs: Sequence[Equations], base: BaseParameters, constants: int = 0, block: float = BLOCK
) -> LinearEstimate:
    """Fit logs together.

    The covariance is that of the blocks' own gradients (sandwich estimate): it knows that what is
    left is not white, not that noise in the rows biases the answer.

    Args:
        logs: the equations of each.
        base: the parameters sought.
        constants: of each log, that were fitted and taken out beforehand.
        block: what is left is taken for independent between blocks of this length [s].

    Raises:
        UsageError: nothing that could be sought shows in the logs, be they too short or still.
    """
    if not len(base.as_stated):
        return LinearEstimate(base.as_stated, np.zeros((0, 0)), 1.96)
    parts = [based(log, base) for log in logs]
    columns = np.concatenate([rows for rows, _ in parts])
    target = np.concatenate([value for _, value in parts])
    places = _blocks(logs, block)
    if not np.any(columns):
        raise UsageError(
            f"the logs are too short to tell anything of the motion of {base.machine.platform.name}"
            ", or nothing moves in them; record some ten seconds of motion"
        )
    weak = np.diag(HELD * np.linalg.norm(columns * base.scale, axis=0).max() / base.scale)
    stacked = np.concatenate([columns, weak])
    right = np.concatenate([target - columns @ base.as_stated, np.zeros(len(weak))])
    change = np.linalg.lstsq(stacked * base.scale, right, rcond=None)[0] * base.scale
    residual = right[: len(target)] - columns @ change
    scaled = stacked * base.scale
    inverse = np.linalg.inv(scaled.T @ scaled) * np.outer(base.scale, base.scale)
    scores = np.zeros((int(places[-1]) + 1, len(change)))
    np.add.at(scores, places, columns * residual[:, None])
    freedom = max(len(scores) - len(change) - constants * len(logs), 1)
    # what only the weak rows hold is as unsure as they are
    unsure = np.diag(np.square(np.square(np.diag(weak)) * UNSURE * base.scale))
    covariance = inverse @ (scores.T @ scores * len(scores) / freedom + unsure) @ inverse
    return LinearEstimate(base.as_stated + change, covariance, float(student.ppf(0.975, freedom)))


def based(equations: Equations, base: BaseParameters) -> tuple[Array, Array]:
    """Rows (m k, p) for theta, and the target (m k,): entries = stated + map (theta - stated)."""
    rest = base.entries(base.as_stated) - base.map @ base.as_stated
    target = equations.target - equations.rows @ rest
    return (equations.rows @ base.map).reshape(-1, base.map.shape[1]), target.ravel()


def _blocks(logs: Sequence[Equations], block: float) -> NDArray[np.intp]:
    """(rows,) to which block of which log each belongs."""
    blocks, first = list[NDArray[np.intp]](), 0
    for log in logs:
        of_block = ((log.time - log.time[0]) / block).astype(np.intp) + first
        blocks.append(np.repeat(of_block, log.target.shape[1]))
        first = int(of_block[-1]) + 1
    return np.concatenate(blocks)


STANDING = 1e-5
"""[kg m/s]: masses stand still while d changes no faster."""
RESOLUTION = 1e-5
"""[kg m] between two places of the masses."""
SETTLING = 1.0
"""[s] left out after a move."""
FEWEST = 3
"""Positions of the masses that determine m r."""


def equilibria(tracks: Sequence[Track], base: BaseParameters) -> LinearEstimate:
    """Of all rests of all logs.

    Raises:
        UsageError: the masses stand still in too few places.
    """
    logs = [_hanging(track) for track in tracks]
    places = np.concatenate([moved for _, moved in logs])
    count = len(np.unique(np.round(places / RESOLUTION), axis=0))
    if count < FEWEST:
        raise UsageError(
            f"the sliding masses stand still for {BLOCK + SETTLING:g} s in {count} places; "
            f"equilibria needs {FEWEST} or more, as far apart as the tilt allows: move a mass, let "
            "the swing die down, move on"
        )
    return least_squares([equations for equations, _ in logs], base)


def _hanging(track: Track) -> tuple[Equations, Array]:
    """A row of equations for each piece of standing masses, and where they stood, (m, 3) [kg m]."""
    changed = np.linalg.norm(np.diff(track.moved, axis=0), axis=1) > STANDING * track.step
    edges = np.concatenate([[0], np.flatnonzero(changed) + 1, [len(track.time)]])
    skip, size = round(SETTLING / track.step), round(BLOCK / track.step)
    pieces = [
        slice(first, first + size)
        for begin, end in zip(edges, edges[1:], strict=False)
        for first in range(begin + skip * (begin > 0), end - size + 1, size)
    ]
    gravity = np.array([track.gravity[piece].mean(axis=0) for piece in pieces]).reshape(-1, 3)
    moved = np.array([track.moved[piece].mean(axis=0) for piece in pieces]).reshape(-1, 3)
    rows = np.zeros((len(pieces), 3, 9))
    rows[:, :, 6:] = gravity_rows(gravity)
    # one piece is one block
    time = BLOCK * np.arange(len(pieces), dtype=np.float64)
    return Equations(time, rows, rotation.cross(moved, gravity)), moved


STEP = 0.2
"""Between updates [s]."""
DOUBT = 1e3
"""Of what is stated, in parts of a parameter's scale."""


def recursive(tracks: Sequence[Track], base: BaseParameters, forgetting: float) -> LinearEstimate:
    """One log after the other.

    Args:
        tracks: of the logs.
        base: the parameters sought.
        forgetting: lambda, the weight that a step of 0.2 s leaves to what came before it.
    """
    theta, p = base.as_stated.copy(), np.diag(np.square(DOUBT * base.scale))
    squares, weight = 0.0, 0.0
    for track in tracks:
        stride = max(round(STEP / track.step), 1)
        equations = integrated(track).about(track.axis).every(stride)
        rows, target = based(equations, base)
        k = equations.target.shape[1]
        pairs = zip(rows.reshape(-1, k, len(theta)), target.reshape(-1, k), strict=True)
        for a, b in pairs:
            across = p @ a.T
            gain = np.linalg.solve(forgetting * np.eye(k) + a @ across, across.T).T
            theta = theta + gain @ (b - a @ theta)
            p = (p - gain @ across.T) / forgetting
            p = 0.5 * (p + p.T)
            residual = b - a @ theta
            squares = forgetting * squares + float(residual @ residual)
            weight = forgetting * weight + k
    return LinearEstimate(theta, p * squares / max(weight, 1.0), NORMAL)
