"""Thrusters as actuators: from a torque, or force and torque, to forces that only push, with the
least gas.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from twin.errors import ControllerError
from twin.platform import Platform

Array = NDArray[np.float64]

_SMALL = 1e-9


@dataclass(frozen=True)
class Nozzles:
    """The thrusters of one platform, and every set of them that may be the cheapest.

    Least gas for a torque: minimise sum F_i over F >= 0 with M F = w. At the optimum only as many
    thrusters push as M has rank, F_B = B^-1 w. Whether a set B can be optimal, for some w, depends
    on M alone: its prices y = 1^T B^-1 must not undercut any thruster, y^T M <= 1 (linear duality).
    Of those sets the one with F_B >= 0 is the answer, so that a batch needs no solver.
    """

    effect: Array
    """(rank, thrusters) M: what a unit of force does, by independent rows."""
    rows: Array
    """(rank, 3) from a torque to those rows."""
    sets: NDArray[np.intp]
    """(sets, rank) thrusters."""
    inverse: Array
    """(sets, rank, rank) B^-1."""
    limit: Array
    """(thrusters,) [N]."""

    @classmethod
    def of(cls, platform: Platform, law: str) -> "Nozzles":
        """Those of the platform: couples without a net force where its base can slide away.

        Raises:
            ControllerError: they do not turn the body both ways about three axes, on a floor about
                the vertical, as `law` does.
        """
        base, thrusters = platform.base, platform.thrusters
        refused = ControllerError(
            f"{law} turns the body both ways about all its axes by thrusters that only push, but "
            f"the {len(thrusters)} of {platform.name} do not; choose a platform whose thrusters do"
        )
        if not thrusters:
            raise refused
        force = np.array([thruster.direction for thruster in thrusters]).reshape(-1, 3)
        arms = np.array([thruster.point for thruster in thrusters]).reshape(-1, 3)
        whole, wanted = np.cross(arms, force).T, np.eye(3)
        if base.on_floor:
            wanted = np.diag([0.0, 0.0, 1.0])
        if base.kind == "free" or set(base.planar) - set(base.locked):
            whole = np.vstack([whole, force.T])
            wanted = np.vstack([wanted, np.zeros((3, 3))])
        left, sizes, _ = np.linalg.svd(whole, full_matrices=False)
        left = left[:, sizes > _SMALL * float(sizes[0])]
        effect, rows = left.T @ whole, left.T @ wanted
        rank = len(effect)
        sets = np.array(list(combinations(range(len(thrusters)), rank)), dtype=np.intp)
        sets = sets.reshape(-1, rank)
        square = effect[:, sets].transpose(1, 0, 2)
        regular = np.abs(np.linalg.det(square)) > _SMALL
        sets = sets[regular]
        inverse = np.asarray(np.linalg.inv(square[regular]), dtype=np.float64)
        cheap = (inverse.sum(axis=1) @ effect <= 1.0 + _SMALL).all(axis=1)
        nozzles = cls(
            effect,
            rows,
            sets[cheap],
            inverse[cheap],
            np.array([thruster.force_limit for thruster in thrusters]),
        )
        if not len(nozzles.sets) or not nozzles.reach_all_round(left, wanted):
            raise refused
        return nozzles

    def reach_all_round(self, basis: Array, wanted: Array) -> bool:
        """Whether the forces give a torque along every axis, and nothing else, either way."""
        axes = np.eye(3)[np.any(wanted != 0.0, axis=0)]
        along = np.concatenate([axes, -axes])
        whole = along @ wanted.T
        lost = whole - whole @ basis @ basis.T
        given = np.einsum("nt,rt->nr", self.forces(along), self.effect)
        asked = along @ self.rows.T
        return bool(np.abs(lost).max() < 1e-6 and np.abs(given - asked).max() < 1e-6)

    def forces(self, torque: Array) -> Array:
        """Force of each thruster (n, thrusters) [N], for a torque (n, 3) [N m, body]; no limit."""
        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        asked = np.einsum("ri,ni->nr", self.rows, torque)
        push = np.einsum("kbr,nr->nkb", self.inverse, asked)
        best = np.argmax(push.min(axis=2), axis=1)
        run = np.arange(len(torque))
        out = np.zeros((len(torque), len(self.limit)))
        out[run[:, None], self.sets[best]] = np.maximum(push[run, best], 0.0)
        return out

    def torque(self, force: Array) -> Array:
        """What the forces (n, thrusters) [N] give, (n, 3) [N m, body]."""
        given = np.einsum("rt,nt->nr", self.effect, force)
        return np.einsum("ri,nr->ni", self.rows, given)


class Allocated(NamedTuple):
    """Who gives a wrench."""

    force: Array
    """(n, thrusters) [N]."""
    exchange: Array
    """(n, 3) torque on the body left to wheels or gyros [N m, body]."""
    scale: Array
    """(n,) part of the wrench that is given: below 1 where it is beyond the limits."""


_PIVOTS = 200
"""Of a program; some ten do."""
_SPLIT = 1e-6
"""By which the prices of alike thrusters differ: the best set is then one, and no pivot repeats."""
_FIRST = 1e4
"""Gas [N] that the whole wrench is worth, per unit of the wrench: more than it ever costs."""


@dataclass(frozen=True)
class Wrenches:
    """Force and torque by the thrusters of one platform, and by wheels or gyros beside them.

    minimise  sum F_i + price sum |g_j| - K s
    with      M F + (0, g) = s w,  0 <= F_i <= limit_i,  |g_j| <= exchange limit,  0 <= s <= 1

    w is force and torque on the body, K so large that as much of w as the limits let through comes
    first, then the least gas. g is a torque by wheels or gyros about the body's axes, at a price
    in gas for what it uses up of their momentum.

    The linear program is solved for all runs at once by the dual simplex method with bounded
    variables: a set of rank-many columns whose prices undercut no other is known once for all, s
    stands at 1, and each pivot brings the worst column back within its bounds.

    Source: C. E. Lemke, The dual method of solving the linear programming problem, 1954; for
    bounded variables A. Koberstein, The dual simplex method, Paderborn 2005, section 3.
    """

    effect: Array
    """(rank, columns) of thrusters, torques by wheels or gyros either way, and s (0 here)."""
    rows: Array
    """(rank, 6) from force and torque to these rows."""
    cost: Array
    """(columns,) gas."""
    limit: Array
    """(columns,)."""
    start: NDArray[np.intp]
    """(rank,) columns whose prices y undercut none: y^T M <= cost."""
    thrusters: int
    whole: Array
    """(6, columns) force and torque of each column."""
    counts: Array
    """(6,) 1 along what the base is free in."""
    on_off: NDArray[np.bool_]
    """(thrusters,) whether a valve is open or shut for a whole tick."""
    tick: float
    """[s]."""

    @classmethod
    def of(cls, platform: Platform, law: str, *, price: float = np.inf) -> "Wrenches":
        """Those of the platform: torque alone where its base stays, on a floor about the vertical.

        Args:
            platform: the machine.
            law: that asks.
            price: of a torque by wheels or gyros [N of thrust / N m]; infinite: there are none.

        Raises:
            ControllerError: they do not push and turn the body both ways along all that it is free
                in, as `law` does.
        """
        base, thrusters = platform.base, platform.thrusters
        force = np.array([thruster.direction for thruster in thrusters]).reshape(-1, 3)
        arms = np.array([thruster.point for thruster in thrusters]).reshape(-1, 3)
        columns = np.vstack([force.T, np.cross(arms, force).T])
        cost = np.ones(len(thrusters))
        limit = np.array([thruster.force_limit for thruster in thrusters])
        if np.isfinite(price):
            turning = np.vstack([np.zeros((3, 3)), np.eye(3)])
            columns = np.hstack([columns, turning, -turning])
            cost = np.append(cost, np.full(6, price))
            limit = np.append(limit, np.full(6, np.inf))
        counts = np.zeros(6)
        counts[3:] = 1.0
        if base.on_floor:
            counts[:] = (1.0, 1.0, 0.0, 0.0, 0.0, 1.0)
        elif base.travels:
            counts[:] = 1.0
        effect = counts[:, None] * columns
        left, sizes, _ = np.linalg.svd(effect, full_matrices=False)
        left = left[:, sizes > _SMALL * float(np.max(sizes, initial=1.0))]
        missed = np.diag(counts) - left @ (left.T @ np.diag(counts))
        reached = left.T @ effect
        cost = cost * (1.0 + _SPLIT * np.sin(1.0 + np.arange(len(cost))))
        start = None if np.abs(missed).max() > _SMALL else _cheapest(reached, cost)
        if start is None:
            raise ControllerError(
                f"{law} pushes and turns the body both ways along all that it is free in, by "
                f"thrusters that only push, but the {len(thrusters)} of {platform.name} do not; "
                "choose a platform whose thrusters do"
            )
        return cls(
            effect=np.hstack([reached, np.zeros((len(reached), 1))]),
            rows=left.T @ np.diag(counts),
            cost=np.append(cost, 0.0),
            limit=np.append(np.where(np.isinf(limit), _FIRST, limit), 1.0),
            start=start,
            thrusters=len(thrusters),
            whole=np.hstack([columns, np.zeros((6, 1))]),
            counts=counts,
            on_off=np.array([thruster.on_off for thruster in thrusters]),
            tick=platform.tick,
        )

    def allocate(self, wrench: Array, exchange: Array | None = None) -> Allocated:
        """Least gas for a wrench.

        Args:
            wrench: (n, 6) force [N] and torque [N m], body axes.
            exchange: (n,) largest torque about each axis by wheels or gyros [N m]; None: any.
        """
        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        asked = np.einsum("ri,ni->nr", self.rows, wrench)
        n, width = len(wrench), len(self.cost)
        limit = np.tile(self.limit, (n, 1))
        if exchange is not None:
            limit[:, self.thrusters : -1] = exchange[:, None]
        columns = np.tile(self.effect, (n, 1, 1))
        columns[:, :, -1] = -asked
        cost = np.tile(self.cost, (n, 1))
        cost[:, -1] = -_FIRST * (1.0 + np.abs(asked).sum(axis=1))
        value = np.zeros((n, width))
        rows = np.arange(n)
        basis = np.tile(self.start, (n, 1))
        upper = np.zeros((n, width), dtype=np.bool_)
        upper[:, -1] = True
        for _ in range(_PIVOTS):
            part = _Program(columns[rows], cost[rows], limit[rows], basis[rows], upper[rows])
            value[rows] = part.value
            moved = part.worst > _SMALL * 1e-2
            if not moved.any():
                break
            rows = rows[moved]
            basis[rows], upper[rows] = part.pivoted(moved)
        value = np.clip(value, 0.0, limit)
        given = value[:, self.thrusters : -1]
        count = given.shape[1] // 2
        turning = given[:, :count] - given[:, count:] if count else np.zeros((n, 3))
        return Allocated(value[:, : self.thrusters], turning, value[:, -1])

    def pulsed(self, force: Array, pulse: float) -> Array:
        """What valves give of mean forces over a tick (n, thrusters) [N].

        A valve opens for `pulse` [s] at least or not at all, an on-off valve for the whole tick.
        """
        limit = self.limit[: self.thrusters]
        opened = np.where(force < limit * min(pulse / self.tick, 1.0), 0.0, force)
        return np.where(self.on_off, np.where(force < 0.5 * limit, 0.0, limit), opened)

    def counted(self, wrench: Array) -> Array:
        """Of a wrench (n, 6) the part along what the base is free in."""
        return self.counts * wrench

    def wrench(self, force: Array) -> Array:
        """Force and torque (n, 6) [N, N m, body] of thrusters (n, thrusters) [N]."""
        return np.einsum("it,nt->ni", self.whole[:, : self.thrusters], force)


class _Program:
    """Linear programs A x = 0 with 0 <= x <= limit at a basis each, dual feasible."""

    def __init__(
        self,
        columns: Array,
        cost: Array,
        limit: Array,
        basis: NDArray[np.intp],
        upper: NDArray[np.bool_],
    ) -> None:
        self._columns, self._basis, self._upper = columns, basis, upper
        run = np.arange(len(basis))
        self._run = run
        square = np.take_along_axis(columns, basis[:, None, :], axis=2)
        self._inverse = np.linalg.inv(square)
        held = np.where(upper, limit, 0.0)
        held[run[:, None], basis] = 0.0
        based = -np.einsum("nbr,nr->nb", self._inverse, np.einsum("nrc,nc->nr", columns, held))
        self.value = held
        self.value[run[:, None], basis] = based
        most = np.take_along_axis(limit, basis, axis=1)
        outside = np.maximum(-based, based - most)
        self._row = np.argmax(outside, axis=1)
        self.worst = outside[run, self._row]
        self._below = based[run, self._row] < 0.0
        price = np.einsum("nb,nbr->nr", np.take_along_axis(cost, basis, axis=1), self._inverse)
        self._reduced = cost - np.einsum("nr,nrc->nc", price, columns)

    def pivoted(self, moved: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """The next basis and bounds of some runs: the worst column leaves to the bound it broke."""
        run, row = self._run[moved], self._row[moved]
        basis, upper = self._basis[moved], self._upper[moved]
        along = np.einsum("nr,nrc->nc", self._inverse[run, row], self._columns[run])
        sign = np.where(self._below[moved], -1.0, 1.0)[:, None] * along
        can = np.where(upper, sign < -_SMALL, sign > _SMALL)
        at = np.arange(len(run))
        can[at[:, None], basis] = False
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(can, np.abs(self._reduced[run] / along), np.inf)
        entering = np.argmin(ratio, axis=1)
        leaving = basis[at, row]
        basis, upper = basis.copy(), upper.copy()
        upper[at, leaving] = ~self._below[moved]
        upper[at, entering] = False
        basis[at, row] = entering
        return basis, upper


def _cheapest(effect: Array, cost: Array) -> NDArray[np.intp] | None:
    """Columns of a set that is the cheapest for some push; None: they do not reach all round.

    All round they reach where positive forces of all of them cancel.
    """
    if not len(effect):
        return None
    width = effect.shape[1]
    still = linprog(cost, A_eq=effect, b_eq=np.zeros(len(effect)), bounds=(1.0, None))
    if still.status != 0:
        return None
    some = effect @ (1.0 + np.sin(1.0 + np.arange(width)) ** 2)
    best = linprog(cost, A_eq=effect, b_eq=some, bounds=(0.0, None), method="highs-ds")
    chosen = np.flatnonzero(best.x > _SMALL)
    return chosen.astype(np.intp) if len(chosen) == len(effect) else None
