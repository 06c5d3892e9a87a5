"""Thrusters as actuators: from a torque to forces that only push, with the least gas."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

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

    def reach_all_round(self, left: Array, wanted: Array) -> bool:
        """Whether the forces give a torque along every axis, and nothing else, either way."""
        axes = np.eye(3)[np.any(wanted != 0.0, axis=0)]
        along = np.concatenate([axes, -axes])
        whole = along @ wanted.T
        lost = whole - whole @ left @ left.T
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
