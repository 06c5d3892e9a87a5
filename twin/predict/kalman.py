"""Whitening of a linearised prediction: Kalman filters within segments, and the chain of segments.

`Linearised` is a prediction and its derivatives, as arrays over segments; `NoiseProcess` the noise
beside the sensors' white noise, of torques and sensor errors.

`whitened` runs a Kalman filter in each segment, all side by side, from a known initial state. Its
gain depends on the path only, so residual and columns are right-hand sides of one filter, and its
result is affine in the initial state and the shared unknowns. `blocked` condenses a log into blocks
of time within which noise processes are constant: an orthogonal transformation reduces the rows of
a block to as many as there are states and processes, once, and each evaluation of the likelihood
then visits blocks instead of samples.

`chain` eliminates the initial states of the segments by a Kalman filter over them, its mean an
affine function of the shared unknowns; a backward pass returns the states. The first state has no
prior. Nothing grows along the chain, also of an unstable machine.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgeqrf, dgeqrf_lwork

from twin.errors import TwinError

Array = NDArray[np.float64]
TORQUE = "torque"
"""Among the names of what wanders: no stream has it."""
LENGTH = 0.1
"""Of a block [s]."""
_NOTHING = 1e-7
"""What the first segment does not show of its start is known this much worse than its numbers by
themselves, each in its own unit: they may be known to 1 rad/s and to 1e-12 rad."""


def root(covariance: Array) -> Array:
    """Lower triangles L (..., n, n) with L L^T = covariance, of white noise and what is added.

    Raises:
        TwinError: a motion so unstable that its spread exceeds what numbers hold.
    """
    try:
        lower = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError:
        lower = np.full_like(covariance, np.nan)
    return _held(lower)


def root_of_any(covariance: Array) -> Array:
    """(n, n) C with C C^T = covariance, which may have directions without any spread.

    Raises:
        TwinError: as `root`.
    """
    sizes, directions = np.linalg.eigh(_held(covariance))
    return directions * np.sqrt(np.maximum(sizes, 0.0))


def joined_root(*roots: Array) -> Array:
    """Lower triangle L (n, n), its diagonal positive, with L L^T = the sum of all C C^T, C (n, .).

    Numbers of very different size keep their digits, as they do not where squares are added up.

    Raises:
        TwinError: as `root`.
    """
    upper = np.asarray(np.linalg.qr(_held(np.concatenate(roots, axis=1)).T, mode="r"))
    return upper.T * np.where(np.diag(upper) < 0.0, -1.0, 1.0)


def _held(array: Array) -> Array:
    """As it is, if numbers hold it."""
    if not np.isfinite(array).all():
        raise TwinError(
            "the motion of a machine with such parameters cannot be followed: what is uncertain"
            " in it grows beyond all bounds; cut the log into shorter ones, or leave out the part"
            " in which the machine reaches a stop"
        )
    return array


@dataclass(frozen=True)
class Linearised:
    """A prediction and what it depends on: S segments of N rows, x the state at each start.

    residual + state x + shared u is white noise of variance 1 in a row that holds a sample; the
    other rows are zero. The start of a segment is that of the one before it carried on:

        x_{s+1} = jump + transition x_s + jump_shared u + noise of covariance `spread`

    Columns stand one after the other in memory: they are the largest arrays of a diagnosis, and
    are formed, joined and factored column by column.
    """

    residual: Array
    """(S, N)."""
    state: Array
    """(S, N, x)."""
    shared: Array
    """(S, N, u)."""
    jump: Array
    """(S - 1, x)."""
    transition: Array
    """(S - 1, x, x)."""
    jump_shared: Array
    """(S - 1, x, u)."""
    spread: Array
    """(S - 1, x, x)."""
    known: Array
    """(x,) one over the standard deviation about 0 of the first segment's start; 0 of what nothing
    is known of beforehand."""

    def with_columns(self, columns: Array, jumps: Array | None = None) -> "Linearised":
        """With further shared unknowns.

        Args:
            columns: (S, N, c) d residual / d unknown.
            jumps: (S - 1, x, c) d end of a segment / d unknown; None: no motion depends on them.
        """
        if jumps is None:
            jumps = np.zeros((*self.jump_shared.shape[:2], columns.shape[-1]))
        return replace(
            self,
            shared=joined(self.shared, columns),
            jump_shared=joined(self.jump_shared, jumps),
        )

    def with_first(self, columns: Array, jumps: Array) -> "Linearised":
        """With other columns (S, N, c) and (S - 1, x, c) for the first of its shared unknowns."""
        count = columns.shape[-1]
        return replace(
            self,
            shared=joined(columns, self.shared[..., count:]),
            jump_shared=joined(jumps, self.jump_shared[..., count:]),
        )


def joined(*columns: Array) -> Array:
    """Columns (S, N, .) side by side, one after the other in memory."""
    return np.moveaxis(np.concatenate([np.moveaxis(column, -1, 0) for column in columns]), 0, -1)


def among(columns: Array, places: NDArray[np.bool_]) -> Array:
    """Columns (S, N, .) at these places (c,) of as many, which are zero elsewhere."""
    every = np.zeros((len(places), *columns.shape[:2]))
    every[places] = np.moveaxis(columns, -1, 0)
    return np.moveaxis(every, 0, -1)


@dataclass(frozen=True)
class Wander:
    """An Ornstein-Uhlenbeck process: its autocovariance is rms^2 exp(-lag / time)."""

    rms: float
    """Of each axis or column, in its unit (SI)."""
    time: float
    """Correlation time [s]."""


@dataclass(frozen=True)
class NoiseProcess:
    """What disturbs a motion and its sensors, each axis by itself."""

    white: float = 0.0
    """Intensity of a white torque about each base axis of the machine as stated [(N m)^2 s]."""
    torque: Wander | None = None
    """A torque about each base axis of the machine as stated."""
    errors: tuple[tuple[str, Wander], ...] = ()
    """Of each column of a stream, by the stream's name."""
    scales: tuple[tuple[str, float], ...] = ()
    """By how much the white noise of a stream is larger than its sensor's, by its name."""

    @property
    def any(self) -> bool:
        """Whether there is anything beside the sensors' white noise."""
        return self.white > 0.0 or self.wanders or bool(self.scales)

    @property
    def wanders(self) -> bool:
        """Whether anything has a memory."""
        return self.torque is not None or bool(self.errors)

    @property
    def processes(self) -> int:
        """How many there are beside the sensors' white noise, larger white noises among them."""
        torques = (self.white > 0.0) + (self.torque is not None)
        return torques + len(self.errors) + len(self.scales)

    def with_error(self, stream: str, wander: Wander | None) -> "NoiseProcess":
        """With another error of a stream; None: without any."""
        rest = tuple(error for error in self.errors if error[0] != stream)
        more = () if wander is None else ((stream, wander),)
        return replace(self, errors=(*rest, *more))


EXACT = NoiseProcess()
"""Of a motion that nothing disturbs."""


@dataclass(frozen=True)
class Local:
    """How noise travels: S segments of N rows and K grid instants, W slots an instant, x numbers of
    a state."""

    measured: Array
    """(S, N, x) d(measured / noise) / d(state at the instant)."""
    row: NDArray[np.int32]
    """(S, K, W) which row each slot of each instant is; N where it holds no sample."""
    carried: Array
    """(S, K - 1, x, x) from one instant to the next."""
    pushed: Array
    """(S, x, c) change of the state by a unit impulse on each of c degrees of freedom."""
    step: float
    """[s]."""
    wander: Array
    """(S, K - 1, x, x) covariance that a state gains in each step whatever else is at work: wheels'
    unknown torques, gimbals' unknown rates."""
    drift: Array
    """(S, K - 1, x) by how much the expected motion leaves the nominal path in each step."""
    driven: Array
    """(S, K - 1 or 1, x, c) change of the state in each step by a constant unit force."""
    errors: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """(S, N, k) d(measured / noise) / d error of each of a stream's k columns, by its name; of
    `TORQUE` by a force on each degree of freedom, the state at the instant as it is."""


def whitened(
    linear: Linearised, local: Local, intensity: Array, wandering: NoiseProcess | None = None
) -> tuple[Linearised, float]:
    """With random generalised forces and sensor errors at work.

    Args:
        linear: of a motion without noise.
        local: along the same paths.
        intensity: (c,) of the white forces [(N m)^2 s].
        wandering: what else wanders; its n numbers join the states of a segment's start.

    Returns:
        The same with innovations for residuals, and the log-determinant of their covariance.
    """
    x = local.measured.shape[-1]
    known = np.zeros(x)
    force = local.pushed * (intensity * local.step)
    noise = local.wander + (force @ local.pushed.transpose(0, 2, 1))[:, None]
    if wandering is not None:
        local, noise, known = _augmented(local, noise, wandering)
    segments, count, width = local.measured.shape
    # all of a row together, as the filter goes through them, and one more that holds no sample
    white = np.zeros((segments, count + 1, width + 1 + linear.shared.shape[-1]))
    white[:, :count, :x] = linear.state
    white[:, :count, width] = linear.residual
    white[:, :count, width + 1 :] = linear.shared
    measured = with_none(local.measured)
    telling = np.any(measured != 0.0, axis=-1)
    every = np.arange(segments)[:, None]
    mean = np.zeros((segments, width, white.shape[-1]))
    # the path starts from x, and has what wanders nowhere in it yet
    mean[:, x:, x:width] = np.eye(width - x)
    spread = np.zeros((segments, width, width))
    logarithm = 0.0
    for k in range(local.row.shape[1]):
        if k:
            carry = local.carried[:, k - 1]
            mean = carry @ mean
            mean[..., width] += local.drift[:, k - 1]
            spread = carry @ spread @ carry.transpose(0, 2, 1) + noise[:, k - 1]
        slots = local.row[:, k]
        at = every, slots[:, np.any(telling[every, slots], axis=0)]
        h = measured[at]
        if not h.size:
            continue
        across = h @ spread
        covariance = across @ h.transpose(0, 2, 1) + np.eye(h.shape[1])
        lower = root(covariance)
        # many small triangles: a third of the time that solving takes
        inverse = np.linalg.inv(lower)
        told = inverse @ (white[at] - h @ mean)
        white[at] = told
        gain = (inverse @ across).transpose(0, 2, 1)
        mean = mean + gain @ told
        spread = spread - gain @ gain.transpose(0, 2, 1)
        logarithm += 2.0 * float(np.log(np.diagonal(lower, axis1=1, axis2=2)).sum())
    white = white[:, :count]
    ends = mean[:-1].copy()
    ends[:, :x, :x] += linear.transition
    ends[:, :x, width] += linear.jump
    ends[:, :x, width + 1 :] += linear.jump_shared
    return (
        replace(
            linear,
            state=white[..., :width],
            residual=white[..., width],
            shared=white[..., width + 1 :],
            transition=ends[..., :width],
            jump=ends[..., width],
            jump_shared=ends[..., width + 1 :],
            spread=spread[:-1],
            known=known,
        ),
        logarithm,
    )


def _augmented(local: Local, noise: Array, wandering: NoiseProcess) -> tuple[Local, Array, Array]:
    """The same with the numbers that wander behind those of the state: (S, ., x + n).

    Returns:
        How noise travels, the covariance (S, K - 1, x + n, x + n) that each step adds, and (x + n,)
        one over the standard deviation of what is known of them beforehand.
    """
    x, c = local.measured.shape[-1], local.pushed.shape[-1]
    parts = [np.zeros((*local.measured.shape[:2], 0))]
    rms, times = list[float](), list[float]()
    acting = 0
    if wandering.torque is not None:
        parts.append(local.errors.get(TORQUE, np.zeros((*local.measured.shape[:2], c))))
        rms += [wandering.torque.rms] * c
        times += [wandering.torque.time] * c
        acting = c
    for stream, item in wandering.errors:
        if stream in local.errors:
            seen = local.errors[stream]
            parts.append(seen)
            rms += [item.rms] * seen.shape[-1]
            times += [item.time] * seen.shape[-1]
    kept, variance = np.exp(-local.step / np.array(times)), np.square(np.array(rms))
    n = len(kept)
    segments, steps = local.carried.shape[:2]
    carried = np.zeros((segments, steps, x + n, x + n))
    carried[..., :x, :x] = local.carried
    carried[..., :x, x : x + acting] = local.driven[..., :acting]
    places = np.arange(x, x + n)
    carried[..., places, places] = kept
    added = np.zeros_like(carried)
    added[..., :x, :x] = noise
    added[..., places, places] = variance * (1.0 - np.square(kept))
    drift = np.concatenate([local.drift, np.zeros((*local.drift.shape[:2], n))], axis=-1)
    measured = np.concatenate([local.measured, *parts], axis=-1)
    known = np.concatenate([np.zeros(x), 1.0 / np.sqrt(variance)])
    return replace(local, measured=measured, carried=carried, drift=drift), added, known


def scaled(
    linear: Linearised, local: Local, scales: Sequence[tuple[str, float]]
) -> tuple[Linearised, Local, float]:
    """With the white noise of some streams so many times larger; and by how much the
    log-determinant of the covariance grows."""
    each = np.ones(linear.residual.shape)
    logarithm = 0.0
    for stream, factor in scales:
        if stream in local.errors:
            own = np.any(local.errors[stream] != 0.0, axis=-1)
            each[own] /= factor
            logarithm += 2.0 * float(np.log(factor)) * np.count_nonzero(own)
    rows = each[..., None]
    linear = replace(
        linear,
        residual=linear.residual * each,
        state=linear.state * rows,
        shared=linear.shared * rows,
    )
    errors = {stream: seen * rows for stream, seen in local.errors.items()}
    return linear, replace(local, measured=local.measured * rows, errors=errors), logarithm


def with_none(rows: Array) -> Array:
    """Rows (S, N, ...), and after them one of zeros: of a slot that holds no sample."""
    return np.concatenate([rows, np.zeros_like(rows[:, :1])], axis=1)


def blocked(linear: Linearised, local: Local, length: float = LENGTH) -> tuple[Linearised, Local]:
    """The same log in blocks; what wanders is constant in each.

    Args:
        linear: of a motion without noise.
        local: along the same paths.
        length: of a block [s].
    """
    steps = max(round(length / local.step), 1)
    if steps == 1:
        return linear, local
    x, c = local.measured.shape[-1], local.pushed.shape[-1]
    names = [TORQUE, *local.errors]
    widths = [c, *(error.shape[-1] for error in local.errors.values())]
    n, segments, instants = sum(widths), *local.row.shape[:2]
    right = np.concatenate([linear.residual[..., None], linear.state, linear.shared], axis=-1)
    parts = [with_none(item) for item in (local.measured, *local.errors.values(), right)]
    every = np.arange(segments)[:, None]
    # the last instant by itself: there the next segment begins
    edges = [*range(0, instants - 1, steps), instants - 1, instants]
    triangles: list[Array] = []
    carried: list[Array] = []
    driven: list[Array] = []
    added: list[Array] = []
    drifts: list[Array] = []
    for first, last in zip(edges, edges[1:], strict=False):
        moved = np.zeros((segments, x, x + c))
        moved[:, :, :x] = np.eye(x)
        drift, noise = np.zeros((segments, x)), np.zeros((segments, x, x))
        rows: list[Array] = []
        for k in range(first, last):
            slots = local.row[:, k]
            measured, *errors, affine = (part[every, slots] for part in parts)
            affine[..., 0] -= np.einsum("swx,sx->sw", measured, drift)
            rows.append(np.concatenate([measured @ moved, *errors, affine], axis=-1))
            if k == instants - 1:
                break
            carry = local.carried[:, k]
            moved = carry @ moved
            moved[:, :, x:] += local.driven[:, min(k, local.driven.shape[1] - 1)]
            drift = np.einsum("sxy,sy->sx", carry, drift) + local.drift[:, k]
            noise = carry @ noise @ carry.transpose(0, 2, 1) + local.wander[:, k]
        stacked = np.concatenate(rows, axis=1)
        triangles.append(np.asarray(np.linalg.qr(_taller(stacked, x + n), mode="r")))
        carried.append(moved[:, :, :x])
        driven.append(moved[:, :, x:])
        drifts.append(drift)
        added.append(noise)
    tall = max(triangle.shape[1] for triangle in triangles)
    whole = np.stack([_taller(triangle, tall) for triangle in triangles], axis=1)
    flat = whole.reshape(segments, -1, whole.shape[-1])
    telling = np.zeros(tall, dtype=bool)
    telling[: x + n] = True
    row = np.arange(len(triangles) * tall, dtype=np.int32).reshape(1, -1, tall)[..., telling]
    ends = np.cumsum([x, *widths])
    own = [flat[..., i:j] for i, j in zip(ends, ends[1:], strict=False)]
    unseen = ~np.tile(telling, len(triangles))
    for item in (flat[..., :x], *own):
        item[:, unseen] = 0.0
    right = flat[..., x + n :]
    return (
        replace(
            linear,
            residual=right[..., 0],
            state=right[..., 1 : 1 + x],
            shared=right[..., 1 + x :],
        ),
        Local(
            flat[..., :x],
            np.broadcast_to(row, (segments, *row.shape[1:])),
            np.stack(carried[:-1], 1),
            local.pushed,
            local.step * steps,
            np.stack(added[:-1], 1),
            np.stack(drifts[:-1], 1),
            np.stack(driven[:-1], 1),
            dict(zip(names, own, strict=True)),
        ),
    )


def _taller(rows: Array, height: int) -> Array:
    """(S, N, k) with so many rows at least."""
    return np.pad(rows, ((0, 0), (0, max(height - rows.shape[1], 0)), (0, 0)))


@dataclass(frozen=True)
class Chain:
    """residual + columns u is white noise of variance 1, the states gone.

    An affine function of u is kept as a matrix (x, 1 + u), its constant first.
    """

    rows: Array
    """(m, 1 + u) residual and columns."""
    segment: NDArray[np.intp]
    """(m,) the segment that each row comes from."""
    seen: list[Array]
    """Mean of each start, when its segment has been seen but none after it."""
    seen_spread: list[Array]
    """Likewise, its covariance (x, x)."""
    pull: list[Array]
    """h^T S^-1 times the innovation of each start."""
    keep: list[Array]
    """I - K h of each start."""
    told: list[Array]
    """(x, x) h^T S^-1 h of each start: what its segment says of it."""
    transition: Array
    logarithm: float
    """Log-determinant of the covariance that was divided out."""

    def states(self, change: Array) -> Array:
        """(S, x) smoothed starts for a change (u,) of the shared unknowns."""
        return self.backward(change)[0]

    def backward(self, change: Array) -> tuple[Array, Array]:
        """Smoothed starts (S, x), and their adjoints (S, x): what all from a start on says of it.

        A start is its mean before it was seen, and its covariance then times its adjoint. Bryson
        and Frazier's backward pass, which inverts no covariance: without noise in the motion these
        become singular.
        """
        u = np.concatenate([[1.0], change])
        adjoint = np.zeros(len(self.seen[0]))
        states: list[Array] = []
        adjoints: list[Array] = []
        for s in range(len(self.seen) - 1, -1, -1):
            after = self.transition[s].T @ adjoint if states else adjoint
            states.append(self.seen[s] @ u + self.seen_spread[s] @ after)
            adjoint = self.keep[s].T @ after - self.pull[s] @ u
            adjoints.append(adjoint)
        return np.stack(states[::-1]), np.stack(adjoints[::-1])

    def hindsight(self) -> Array:
        """(S, x, x) covariance of what later segments still change in each start, once seen."""
        says = np.zeros_like(self.seen_spread[0])
        result: list[Array] = []
        for s in range(len(self.seen) - 1, -1, -1):
            after = self.transition[s].T @ says @ self.transition[s] if result else says
            result.append(self.seen_spread[s] @ after @ self.seen_spread[s])
            says = self.keep[s].T @ after @ self.keep[s] + self.told[s]
        return np.stack(result[::-1])


def growth(linear: Linearised) -> float:
    """Logarithm of how much a volume of states grows along those directions in which it grows."""
    basis = np.eye(linear.state.shape[-1])
    total = np.zeros(len(basis))
    for transition in linear.transition:
        basis, triangle = np.linalg.qr(transition @ basis)
        total += np.log(np.abs(np.diag(triangle)))
    return float(np.sum(np.maximum(total, 0.0)))


def chain(linear: Linearised) -> Chain:
    """Eliminate the states of one log."""
    x = linear.state.shape[-1]
    triangle = np.stack([_triangle(linear, s) for s in range(len(linear.residual))])
    of_state, affine = triangle[:, :x, :x], triangle[:, :x, x:]
    rows = list(triangle[:, x:, x:])
    segment = [np.full(len(block), s) for s, block in enumerate(rows)]
    first = _regular(np.concatenate([of_state[0], affine[0]], axis=1))
    inverse = np.linalg.inv(first[:, :x])
    # The covariance's root is carried on: a heading that nothing tells may be open by radians where
    # the tilt is known to 1e-9, and their squares lie farther apart than a number has digits.
    mean: Array = -inverse @ first[:, x:]
    root: Array = np.asarray(inverse, dtype=np.float64)
    seen, seen_spread = [mean], [root @ root.T]
    logarithm = 2.0 * float(np.log(np.abs(np.diag(first))).sum())
    logarithm -= 2.0 * float(np.log(linear.known[linear.known > 0.0]).sum())
    pull, kept, told = [np.zeros_like(mean)], [np.zeros_like(root)], [np.zeros_like(root)]
    for s in range(1, len(of_state)):
        step = linear.transition[s - 1]
        push = np.column_stack([linear.jump[s - 1], linear.jump_shared[s - 1]])
        mean = step @ mean + push
        root = joined_root(step @ root, root_of_any(linear.spread[s - 1]))
        h = of_state[s]
        lower, gain, root = _updated(h, root)
        logarithm += 2.0 * float(np.log(np.diag(lower)).sum())
        white = np.linalg.solve(lower, affine[s] + h @ mean)
        rows.append(white)
        segment.append(np.full(x, s))
        mean = mean - gain @ white
        shown = np.linalg.solve(lower, h)
        keep = np.eye(x) - gain @ shown
        seen.append(mean)
        seen_spread.append(root @ root.T)
        pull.append(h.T @ np.linalg.solve(lower.T, white))
        kept.append(keep)
        told.append(shown.T @ shown)
    return Chain(
        np.concatenate(rows),
        np.concatenate(segment),
        seen,
        seen_spread,
        pull,
        kept,
        told,
        linear.transition,
        logarithm,
    )


def _updated(h: Array, root: Array) -> tuple[Array, Array, Array]:
    """Root of the covariance of what h shows in white noise; how far a unit of its innovation moves
    the state; and the root of the state's covariance then.

    Args:
        h: (x, x).
        root: (x, x) of the covariance before.
    """
    x = len(h)
    lower = joined_root(np.block([[np.eye(x), h @ root], [np.zeros((x, x)), root]]))
    return lower[:x, :x], lower[x:, :x], lower[x:, x:]


def _triangle(linear: Linearised, segment: int) -> Array:
    """(k, k) of a segment's k = x + 1 + u columns: all that its rows say, and of the first one
    what is known of its start beforehand.

    LAPACK called in place: as `np.linalg.qr`, which copies the rows twice, and there are many.
    """
    x = linear.state.shape[2]
    shared = linear.shared[segment].T
    # not all that is shared does anything in it
    acting = np.flatnonzero(shared.any(axis=1))
    kept = np.concatenate([np.arange(x + 1), x + 1 + acting])
    n, k = shared.shape[1], len(kept)
    known = np.flatnonzero(linear.known) if segment == 0 else np.zeros(0, dtype=np.intp)
    columns = np.zeros((max(n + len(known), k), k), order="F")
    columns.T[:x, :n] = linear.state[segment].T
    columns.T[x, :n] = linear.residual[segment]
    columns.T[x + 1 :, :n] = shared[acting]
    columns[n + np.arange(len(known)), known] = linear.known[known]
    work = int(dgeqrf_lwork(*columns.shape)[0])
    factored = dgeqrf(columns, lwork=work, overwrite_a=True)[0]
    width = x + 1 + linear.shared.shape[-1]
    triangle = np.zeros((width, width))
    triangle[:k, kept] = np.triu(factored[:k])
    return triangle


def _regular(triangle: Array) -> Array:
    """(x, x + 1 + u) rows, with what they do not show of the state held weakly where it is."""
    x = len(triangle)
    shown = np.linalg.norm(triangle[:, :x], axis=0)
    least = np.min(shown[shown > 0.0], initial=1.0)
    floor = _NOTHING * np.where(shown > 0.0, shown, least)
    weak = np.column_stack([np.diag(floor), np.zeros((x, triangle.shape[1] - x))])
    joined: Array = np.asarray(np.linalg.qr(np.concatenate([triangle, weak]), mode="r"))
    return joined[:x]
