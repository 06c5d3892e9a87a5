"""Whitened innovations of logs, their columns, and the motion of a fit.

Unknowns that all logs share are the base and the strengths of perturbations. Each log has its own
constant errors of sensors, with the prior that platform.toml states, rest angles of springs that
rest where it began, and states, without a prior. The states are eliminated.

The unexplained torque of a fit under a white torque follows from a Kalman smoother within each
segment; no second derivative of data is taken. The motion of a fit (`retraced`) contains the
response to commands, which smoothed data lack where it is faster than their window, and takes from
the data only that torque. Forces of effects are formed along it, because the noise of smoothed data
would be in every column.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.predict.added import Added, formed, with_formed
from twin.predict.base import BaseParameters
from twin.predict.body import Body, Exact
from twin.predict.columns import rests_of
from twin.predict.forces import Perturbation
from twin.predict.kalman import (
    EXACT,
    Chain,
    Linearised,
    NoiseProcess,
    chain,
    growth,
    root,
    scaled,
    whitened,
    with_none,
)
from twin.predict.states import PathForces, States

Array = NDArray[np.float64]
HELD = 1e-9
"""Standard deviation of a base that is not to move, in its scales."""
NO_GROWTH = 0.1
"""The log-determinant has no slope worth its cost along a base parameter where the growth of the
motion times its uncertainty, in its scale, is less: it moves that by so many standard deviations at
most."""
NEARBY = 0.3
"""Standard deviations to the other end of a finite difference of the log-determinant."""


class Eliminated(Protocol):
    """A log whose states are gone."""

    @property
    def rows(self) -> Array:
        """(m, 1 + u) residual and columns."""
        ...

    @property
    def segment(self) -> NDArray[np.intp]:
        """(m,) the segment that each row comes from."""
        ...

    def states(self, change: Array) -> Array:
        """(S, x) best starts for a change (u,) of the shared unknowns, then what else wanders."""
        ...


@dataclass(frozen=True)
class Unknowns:
    """Where a prediction stands."""

    theta: Array
    """(p,) base parameters."""
    biases: tuple[Array, ...]
    """(b,) of each log: of its sensors, then turns of springs that rest where it began."""
    starts: tuple[States, ...]
    """(segments, .) of each log."""
    strengths: Array
    """(a,) of the perturbations."""

    def moved(self, change: Array, links: Sequence[Eliminated]) -> "Unknowns":
        """After a change of theta, biases and strengths, the states at their best for it."""
        p, a = len(self.theta), len(self.strengths)
        edges = p + np.cumsum([0, *map(len, self.biases)])
        own = [change[i:j] for i, j in zip(edges, edges[1:], strict=False)]
        added = change[edges[-1] : edges[-1] + a]
        return Unknowns(
            self.theta + change[:p],
            tuple(b + d for b, d in zip(self.biases, own, strict=True)),
            tuple(
                start.moved(link.states(np.concatenate([change[:p], d, added]))[:, : start.width])
                for start, link, d in zip(self.starts, links, own, strict=True)
            ),
            self.strengths + added,
        )


@dataclass(frozen=True)
class Innovations:
    """A prediction linearised: rows + columns (change of theta, biases, strengths) is white,
    variance 1."""

    at: Unknowns
    exact: tuple[Exact, ...]
    """Of each log."""
    noise: NoiseProcess
    """What disturbs the motion and the sensors, beside their white noise."""
    linear: tuple[Linearised, ...]
    """Of each log, with that torque and its states."""
    chains: tuple[Chain, ...]
    """Of each log, without."""
    residual: Array
    """(m,)."""
    columns: Array
    """(m, p + all biases + a), then what was only added to be scored."""
    cluster: NDArray[np.intp]
    """(m,) which segment of which log a row comes from; -1: what was known beforehand."""
    samples: int
    """Numbers predicted."""
    logarithm: float
    """Log-determinant of the covariance that was divided out."""
    tilt: Array
    """(.,) how it grows with each unknown; see `Problem.tilted`."""

    @property
    def intensity(self) -> float:
        """Of the white torque about each base axis of the machine as stated [(N m)^2 s]."""
        return self.noise.white

    @property
    def covariance(self) -> Array:
        """Of all that has a column; the variance of what changes no row is infinite."""
        size = self._size
        triangle = np.array(np.linalg.qr(self.columns * size, mode="r"))
        idle = np.flatnonzero(size == 0.0)
        triangle[idle, idle] = 1.0
        inverse = np.linalg.inv(triangle)
        result = inverse @ inverse.T * np.outer(size, size)
        result[idle, idle] = np.inf
        return result

    @property
    def determined(self) -> bool:
        """Whether each unknown changes a row."""
        return bool((self._size > 0.0).all())

    @property
    def _size(self) -> Array:
        """(u,) what makes each column as long as 1; 0 for one that is 0."""
        norm = np.linalg.norm(self.columns, axis=0)
        return np.divide(1.0, norm, out=np.zeros_like(norm), where=norm > 0.0)

    @property
    def chi2(self) -> float:
        """Of the states' best values, all else as it stands."""
        return float(self.residual @ self.residual)

    @property
    def cost(self) -> float:
        """Twice the negative log-likelihood, up to a constant, after a Gauss-Newton step."""
        step = self.step()
        left = self.residual + self.columns @ step
        return float(left @ left + self.tilt @ step) + self.logarithm

    def step(self) -> Array:
        """Gauss-Newton's change of theta, biases and strengths."""
        size = self._size
        step = -np.linalg.lstsq(self.columns * size, self.residual, rcond=None)[0] * size
        return step - 0.5 * self.covariance @ self.tilt if self.tilt.any() else step

    def moved(self, change: Array) -> Unknowns:
        """The unknowns after a change of them, the states at their best for it."""
        return self.at.moved(change, self.chains)

    def residuals_of_logs(self, step: Array | None = None) -> list[Array]:
        """(S, N) what is left of each log's rows when its states are at their best.

        Args:
            step: a change of theta, biases and strengths that comes first; None: none.
        """
        step = np.zeros(self.columns.shape[1]) if step is None else step
        p, a = len(self.at.theta), len(self.at.strengths)
        edges = p + np.cumsum([0, *map(len, self.at.biases)])
        result: list[Array] = []
        ends = zip(edges, edges[1:], strict=False)
        for line, link, (i, j) in zip(self.linear, self.chains, ends, strict=True):
            own = np.concatenate([step[:p], step[i:j], step[edges[-1] : edges[-1] + a]])
            own = np.pad(own, (0, line.shared.shape[-1] - len(own)))
            states = np.einsum("snx,sx->sn", line.state, link.states(own))
            result.append(line.residual + states + line.shared @ own)
        return result


class Problem:
    """Logs of one machine, predicted together."""

    def __init__(
        self,
        bodies: Sequence[Body],
        base: BaseParameters,
        perturbations: Sequence[Perturbation] = (),
        *,
        held: bool = False,
        strengths_held: bool = False,
    ) -> None:
        """Pose it.

        Args:
            bodies: the logs.
            base: what is fitted of the machine.
            perturbations: what is fitted besides, each by its strength.
            held: leave the base where a fit starts.
            strengths_held: likewise the strengths of which nothing is known beforehand.
        """
        self.bodies = tuple(bodies)
        self.base = base
        self.perturbations = tuple(perturbations)
        self.held = held
        self.strengths_held = strengths_held
        self._rests = [rests_of(body) for body in self.bodies]
        self._added = [
            Added.to(body, (*rests, *self.perturbations))
            for body, rests in zip(self.bodies, self._rests, strict=True)
        ]

    def start(
        self, theta: Array, biases: Sequence[Array], strengths: Array | None = None
    ) -> Unknowns:
        """With the states as smoothed, and strengths of 0 unless given; likewise springs' turns."""
        if strengths is None:
            strengths = np.zeros(len(self.perturbations))
        own = tuple(
            np.pad(bias, (0, len(self._scale_of_log(log)) - len(bias)))
            for log, bias in enumerate(biases)
        )
        return Unknowns(theta, own, tuple(body.start for body in self.bodies), strengths)

    def innovations(self, at: Unknowns, noise: NoiseProcess = EXACT) -> Innovations:
        """Predict and linearise.

        Raises:
            TwinError: no rigid body has such a base, or no number holds where its motion leads.
        """
        # what overflows on the way is told by the columns at its end
        with np.errstate(over="ignore", invalid="ignore"):
            there = self.whiten(at, self.exact(at), noise)
            beyond = not np.isfinite(np.linalg.norm(there.columns, axis=0)).all()
        if beyond or not np.isfinite(there.chi2):
            raise TwinError(
                "the motion of a machine with such parameters cannot be followed: it is so unstable"
                " that it runs away from the log within a moment; look at what the platform states,"
                " and cut the log into shorter ones"
            )
        return there

    def exact(self, at: Unknowns) -> tuple[Exact, ...]:
        """Predict and linearise each log, as if the motion were exact.

        Raises:
            TwinError: no rigid body has such a base.
        """
        exact: list[Exact] = []
        for log, (body, added, start) in enumerate(
            zip(self.bodies, self._added, at.starts, strict=True)
        ):
            biases, strengths = self._parted(log, at)
            item = body.linearise(self.base, at.theta, biases, start, added.push(strengths))
            if added.any:
                faulty = added.rows(item.path, strengths) - body.rows(item.path)[0]
                residual = item.linear.residual + faulty
                item = replace(item, linear=replace(item.linear, residual=residual))
            exact.append(_with(item, added, strengths))
        return tuple(exact)

    def push(self, log: int, at: Unknowns, *, stated: bool = True) -> PathForces:
        """What the perturbations add to the forces on a log's machine, with the effects that its
        platform states or without."""
        _, strengths = self._parted(log, at)
        if not stated:
            strengths[: len(self._rests[log])] = 0.0
        return self._added[log].push(strengths, stated=stated)

    def pushes(self, log: int, at: Unknowns) -> dict[str, Array]:
        """The same, of each perturbation by its name."""
        return self._added[log].pushes(self._parted(log, at)[1])

    def _parted(self, log: int, at: Unknowns) -> tuple[Array, Array]:
        """(b,) of its sensors, and the strengths of all that is added to it."""
        biases, turns = np.split(at.biases[log], [len(self.bodies[log].bias_scale)])
        return biases, np.concatenate([turns, at.strengths])

    def _scale_of_log(self, log: int) -> Array:
        """(b,) 1 sigma of a log's own unknowns."""
        spreads = [rest.spread for rest in self._rests[log]]
        return np.concatenate([self.bodies[log].bias_scale, spreads])

    def with_perturbations(
        self, exact: Sequence[Exact], perturbations: Sequence[Perturbation]
    ) -> tuple[Exact, ...]:
        """What was linearised there with further columns, of strengths that are 0; to be whitened.

        The last entries of a step over their standard deviations are score tests.
        """
        return with_formed(exact, formed(self.bodies, exact, perturbations))

    def with_columns(self, innovations: Innovations, columns: Sequence[Array]) -> Innovations:
        """With further unknowns, shared by all logs, that no motion depends on: a sensor's.

        The last entries of its step over their standard deviations are score tests.

        Args:
            innovations: where to add them.
            columns: of each log (S, N, c), d residual / d unknown.
        """
        exact = [
            replace(item, linear=item.linear.with_columns(more))
            for item, more in zip(innovations.exact, columns, strict=True)
        ]
        more = self.whiten(innovations.at, exact, innovations.noise)
        none = np.zeros(more.columns.shape[1] - len(innovations.tilt))
        return replace(more, tilt=np.concatenate([innovations.tilt, none]))

    def tilted(self, innovations: Innovations) -> Innovations:
        """With the slope of the log-determinant, which Gauss-Newton leaves out.

        Where a motion is unstable, each sample of it is predicted from those before it the worse
        the faster it grows, so a likelihood that leaves this out takes its base for one that grows
        faster than it does: by a standard deviation where the sensors are coarse. A stable one has
        no such slope, and is given none; nor is one that a torque disturbs, where the intensity of
        that torque takes its share of it.
        """
        if innovations.noise.any:
            return innovations
        sigma = np.sqrt(np.diag(innovations.covariance))[: len(innovations.at.theta)]
        growing = sum(growth(item.linear) for item in innovations.exact)
        tilt = np.zeros(innovations.columns.shape[1])
        for index in np.flatnonzero(growing * sigma / self.base.scale >= NO_GROWTH):
            change = np.zeros(len(tilt))
            change[index] = NEARBY * sigma[index]
            nearby = self._logarithm(innovations.moved(change), innovations.noise)
            tilt[index] = (nearby - innovations.logarithm) / change[index]
        return replace(innovations, tilt=tilt)

    def _logarithm(self, at: Unknowns, noise: NoiseProcess) -> float:
        """Log-determinant of the covariance at some unknowns."""
        total = 0.0
        for log, (body, start) in enumerate(zip(self.bodies, at.starts, strict=True)):
            exact = body.along(self.base, at.theta, start, self.push(log, at))
            linear, own = _disturbed(exact, noise)
            total += own + chain(linear).logarithm
        return total

    def whiten(self, at: Unknowns, exact: Sequence[Exact], noise: NoiseProcess) -> Innovations:
        """What was linearised at some unknowns, under some noise."""
        linear: list[Linearised] = []
        logarithm = 0.0
        for item in exact:
            white, own = _disturbed(item, noise)
            logarithm += own
            linear.append(white)
        chains = [chain(item) for item in linear]
        logarithm += sum(link.logarithm for link in chains)
        added = exact[0].linear.shared.shape[-1] - len(at.theta) - len(at.biases[0])
        stacked, cluster = self.stacked(at, chains, added)
        return Innovations(
            at,
            tuple(exact),
            noise,
            tuple(linear),
            tuple(chains),
            stacked[:, 0],
            stacked[:, 1:],
            cluster,
            sum(body.samples for body in self.bodies),
            logarithm,
            np.zeros(stacked.shape[1] - 1),
        )

    def stacked(
        self, at: Unknowns, links: Sequence[Eliminated], added: int
    ) -> tuple[Array, NDArray[np.intp]]:
        """Rows (m, 1 + unknowns) of all logs and of what is known beforehand; see `Innovations`.

        Args:
            at: where they were linearised.
            links: the logs.
            added: how many columns they have after theta and their biases.

        Returns:
            The rows, and which segment of which log each comes from.
        """
        p, biases = len(at.theta), sum(map(len, at.biases))
        weak = HELD * self.base.scale if self.held else self.base.prior
        away = 0.0 * at.theta if self.held else at.theta - self.base.as_stated
        width = p + biases + added
        blocks = [np.column_stack([away / weak, np.diag(1.0 / weak)] + [np.zeros((p, width - p))])]
        cluster = [np.full(p, -1)]
        rows = self._known_strengths(at)
        if len(rows):
            known = np.zeros((len(rows), 1 + width))
            known[:, 0] = rows[:, 0]
            known[:, 1 + p + biases : p + biases + rows.shape[1]] = rows[:, 1:]
            blocks.append(known)
            cluster.append(np.full(len(rows), -1))
        first, before = p, 0
        for log, (body, link, bias) in enumerate(zip(self.bodies, links, at.biases, strict=True)):
            rows = np.concatenate([link.rows, _prior(bias, self._scale_of_log(log), p, added)])
            own = np.zeros((len(rows), 1 + width))
            own[:, : 1 + p] = rows[:, : 1 + p]
            own[:, 1 + first : 1 + first + len(bias)] = rows[:, 1 + p : 1 + p + len(bias)]
            own[:, 1 + p + biases :] = rows[:, 1 + p + len(bias) :]
            blocks.append(own)
            cluster += [link.segment + before, np.full(len(bias), -1)]
            first += len(bias)
            before += body.grid.segments
        return np.concatenate(blocks), np.concatenate(cluster)

    def _known_strengths(self, at: Unknowns) -> Array:
        """Rows (k, 1 + a) of what is known of the strengths beforehand."""
        spread = np.array([perturbation.spread for perturbation in self.perturbations])
        away = np.where(np.isfinite(spread), at.strengths / spread, 0.0)
        if self.strengths_held:
            spread = np.where(np.isfinite(spread), spread, HELD)
        return np.column_stack([away, np.diag(1.0 / spread)])[np.isfinite(spread)]


def _with(item: Exact, added: Added, strengths: Array) -> Exact:
    """With the columns of perturbations."""
    if not len(strengths):
        return item
    return replace(item, linear=item.linear.with_columns(*added.columns(item, strengths)))


def _disturbed(item: Exact, noise: NoiseProcess) -> tuple[Linearised, float]:
    """Under some noise; the log-determinant."""
    linear, local, own = item.linear, item.local, 0.0
    if noise.scales:
        linear, local, own = scaled(linear, local, noise.scales)
    if noise.white == 0.0 and not noise.wanders and not local.wander.any():
        return linear, own
    white = np.full(local.pushed.shape[-1], noise.white)
    result, logarithm = whitened(linear, local, white, noise if noise.wanders else None)
    return result, own + logarithm


def _prior(bias: Array, scale: Array, p: int, added: int) -> Array:
    """Rows (b, 1 + p + b + added) that hold a log's own unknowns at 0 by what is known of them."""
    none = np.zeros((len(bias), p)), np.zeros((len(bias), added))
    return np.column_stack([bias / scale, none[0], np.diag(1.0 / scale), none[1]])


@dataclass(frozen=True)
class Unexplained:
    """Of one log, at the instants of its grid."""

    time: Array
    """(m,) [s]."""
    rate: Array
    """(m, k) [rad/s], body axes, of the smoothed motion."""
    torque: Array
    """(m, k) [N m], body axes; 0 where nothing is left to explain."""


def unexplained_torque(problem: Problem, innovations: Innovations, log: int) -> Unexplained:
    """Smooth the white torque of a fit over one of its logs."""
    body = problem.bodies[log]
    grid = body.grid
    time = grid.starts[:, None] + grid.step * np.arange(grid.steps)
    torque = np.zeros((*time.shape, innovations.exact[log].local.pushed.shape[-1]))
    if innovations.intensity > 0.0:
        torque = smoothed_torque(innovations, log)
    inside = time.ravel() <= body.motion.time[-1]
    return Unexplained(
        time.ravel()[inside],
        body.motion.at(time.ravel()[inside]).rate,
        torque.reshape(-1, torque.shape[-1])[inside],
    )


def smoothed_torque(innovations: Innovations, log: int) -> Array:
    """(S, steps, k) mean of the white torque over each step, of the machine as stated [N m]."""
    chain = innovations.chains[log]
    linear, local = innovations.exact[log].linear, innovations.exact[log].local
    segments, instants, width = local.row.shape
    x = local.measured.shape[-1]
    starts, adjoints = chain.backward(np.zeros(linear.shared.shape[-1]))
    residual = linear.residual + np.einsum("snx,sx->sn", linear.state, starts)
    residual, measured = with_none(residual), with_none(local.measured)
    every = np.arange(segments)[:, None]
    noise = innovations.intensity * local.step * local.pushed @ local.pushed.transpose(0, 2, 1)
    mean = np.zeros((segments, x))
    spread = np.zeros((segments, x, x))
    eye = np.eye(width)
    pull = np.zeros((segments, instants, x))
    keep = np.zeros((segments, instants, x, x))
    for k in range(instants):
        if k:
            carry = local.carried[:, k - 1]
            mean = np.einsum("sxy,sy->sx", carry, mean) + local.drift[:, k - 1]
            spread = carry @ spread @ carry.transpose(0, 2, 1) + noise + local.wander[:, k - 1]
        at = every, local.row[:, k]
        h = measured[at]
        across = h @ spread
        lower = root(across @ h.transpose(0, 2, 1) + eye)
        left = (residual[at] - np.einsum("swx,sx->sw", h, mean))[..., None]
        white = np.linalg.solve(lower, np.concatenate([left, h, across], axis=-1))
        left, seen, gain = white[..., 0], white[..., 1 : 1 + x], white[..., 1 + x :]
        pull[:, k] = np.einsum("swx,sw->sx", seen, left)
        keep[:, k] = np.eye(x) - gain.transpose(0, 2, 1) @ seen
        mean = mean + np.einsum("swx,sw->sx", gain, left)
        # squared, so that it stays symmetric: else errors of rounding would grow along a segment
        spread = spread - gain.transpose(0, 2, 1) @ gain
    adjoint = np.concatenate([adjoints[1:], np.zeros((1, x))])
    torque = np.zeros((segments, instants - 1, local.pushed.shape[-1]))
    for k in range(instants - 1, 0, -1):
        adjoint = np.einsum("syx,sy->sx", keep[:, k], adjoint) + pull[:, k]
        torque[:, k - 1] = innovations.intensity * np.einsum("sxc,sx->sc", local.pushed, adjoint)
        adjoint = np.einsum("syx,sy->sx", local.carried[:, k - 1], adjoint)
    return torque


def retraced(problem: Problem, innovations: Innovations, log: int) -> Body:
    """The predictor of a log, following the motion that a fit gives it, and starting there.

    Where nobody recorded what drove the wheels or the gimbals, a prediction knows no more of their
    kicks than smoothed data do: there the predictor is returned as it is.

    Args:
        problem: the logs.
        innovations: their fit, exact or disturbed.
        log: which of them.
    """
    body = problem.bodies[log]
    gimbals = body.start.gimbal_angle.shape[-1] > 0
    if body.inputs.wheels_undriven or (gimbals and body.inputs.gimbals_undriven):
        return body
    path = _path(problem, innovations, log)
    pushes = None if innovations.intensity > 0.0 else problem.pushes(log, innovations.at)
    followed = body.following(path, pushes)
    followed.start = path[0, :, 0]
    return followed


def _path(problem: Problem, innovations: Innovations, log: int) -> States:
    """(1, S, ...) from starts at their best, under the torque that the fit leaves unexplained."""
    body, exact = problem.bodies[log], innovations.exact[log]
    none = np.zeros(exact.linear.shared.shape[-1])
    starts = innovations.at.starts[log]
    start = starts.moved(innovations.chains[log].states(none)[:, : starts.width])
    push = problem.push(log, innovations.at)
    if innovations.intensity > 0.0:
        base, k = body.machine.base_dof, exact.path.rate.shape[-1]
        # It is a torque on the machine as stated, and the path is that of the machine as fitted.
        rate = slice(k, 2 * k)
        alike = np.linalg.solve(exact.answer[:, 0, rate, base], exact.local.pushed[:, rate])
        force = push.force.copy()
        force[..., base] += np.einsum("sij,stj->sti", alike, smoothed_torque(innovations, log))
        push = replace(push, force=force)
    return body.rollouts.paths(problem.base.model(innovations.at.theta), start.batched(), push)
