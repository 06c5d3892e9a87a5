"""The wheels against their commanded torque: a second witness for their axes and their clock.

I dOmega/dt = command, but for friction and for the body's own acceleration, a hundredth of it. The
commands are stamped by the host when they are applied, so theirs is the clock that is believed.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.conventions.axes import signed_permutations
from twin.conventions.evidence import drift, forgetting, inflation, whitened, without
from twin.conventions.grid import Grid, Means, grid_of
from twin.conventions.turning import NEAR, far_lags
from twin.platform import Platform
from twin.recording import Recording

Array = NDArray[np.float64]

CELL = 0.1
"""[s]: torques change from tick to tick, and that is what tells the time."""
UNKNOWN = 0.1
"""Friction and an error of the inertia, as a share of the torque."""
SIGNIFICANT = 8.0
"""Sigmas of correlation without which the commands are no witness."""


RIGHT = (0.6, 1.6)
"""Gain of the wheels over their commands outside of which these are in no unit we know."""


@dataclass(frozen=True)
class Moments:
    """Squares and products of acceleration and torque, one a lag."""

    shared: Array
    """(lags, wheels, wheels) acceleration times torque."""
    gained: Array
    """(lags,) acceleration squared."""
    wanted: float
    """Torque squared."""

    def misfit(self, wheels: Array, command: Array) -> Array:
        """(lags, axes) squared norm of the residual for axes (axes, k, k) and command (k, k)."""
        together = np.einsum("sij,ik->sjk", wheels, command)
        shared = np.einsum("sjk,ljk->ls", together, self.shared)
        return self.gained[:, None] + self.wanted - 2.0 * shared


class Drive:
    """Commanded torque and wheel speed on one grid."""

    def __init__(self, recording: Recording, platform: Platform, grid: Grid) -> None:
        self.grid = grid
        self._speed = Means(recording["wheel_speed"])
        inertia = np.array([wheel.inertia for wheel in platform.wheels])
        torque = Means(recording["command_wheel_torque"], held=True)
        self._wanted = torque.over(grid.edges) / inertia
        self._rate_noise = max(UNKNOWN * float(np.sqrt(np.mean(np.square(self._wanted)))), 1e-9)
        self._angle_noise = self._speed.cell_noise(grid.cell) / grid.cell
        self._white = self._whiten(self._wanted)
        self.inflation = 1.0

    def residual(self, wheels: Array, command: Array, lag: float) -> Array:
        """(n, wheels) for speeds and commands in these axes, the speeds late by `lag` [s]."""
        return self._whiten(self._gained(lag)) @ wheels.T - self._white @ command.T

    def moments(self, lags: Array) -> "Moments":
        """What every pair of axes needs to be judged, at each of these lags."""
        gained = [self._whiten(self._gained(float(lag))) for lag in lags]
        return Moments(
            np.array([g.T @ self._white for g in gained]),
            np.array([np.sum(np.square(g)) for g in gained]),
            float(np.sum(np.square(self._white))),
        )

    def believed(self) -> bool:
        """Whether the wheels follow the commands at all, in some axes and at some lag; if so, what
        the best of them leaves unexplained is taken into account from now on."""
        lags = np.concatenate([NEAR, far_lags(self.grid.longest_lag)])
        axes, same = signed_permutations(self._wanted.shape[1]), np.eye(self._wanted.shape[1])
        misfit = self.moments(lags).misfit(axes, same)
        row, best = np.unravel_index(int(np.argmin(misfit)), misfit.shape)
        gained = self._whiten(self._gained(float(lags[row]))) @ axes[best].T
        shared, power = float(np.sum(gained * self._white)), float(np.sum(np.square(self._white)))
        self.inflation = inflation(gained - self._white)
        seen = shared > SIGNIFICANT * np.sqrt(power * self.inflation)
        return seen and RIGHT[0] < shared / max(power, 1e-300) < RIGHT[1]

    def _gained(self, lag: float) -> Array:
        """(n, wheels) acceleration between the centres of two cells."""
        return np.diff(self._speed.over(self.grid.around_edges + lag), axis=0) / self.grid.cell

    def _whiten(self, rate: Array) -> Array:
        pole = forgetting(self._angle_noise, self._rate_noise)
        return without(drift(len(rate), pole), whitened(rate, self._angle_noise, self._rate_noise))


def drive_of(recording: Recording, platform: Platform) -> Drive | None:
    """None without wheels, commands and speeds that have to do with each other."""
    names = ("wheel_speed", "command_wheel_torque")
    width = len(platform.wheels)
    if any(n in recording and recording[n].value.shape[1] != width for n in names):
        return None
    grid = grid_of(recording, *names, narrowest=CELL)
    if grid is None:
        return None
    drive = Drive(recording, platform, grid)
    return drive if drive.believed() else None
