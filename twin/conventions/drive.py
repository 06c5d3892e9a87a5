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
    wanted: Array
    """(lags,) torque squared."""
    gained: float
    """Acceleration squared."""

    def misfit(self, wheels: Array, command: Array) -> Array:
        """(lags, axes) squared norm of the residual for axes (axes, k, k) and command (k, k)."""
        together = np.einsum("sij,ik->sjk", wheels, command)
        shared = np.einsum("sjk,ljk->ls", together, self.shared)
        return self.gained + self.wanted[:, None] - 2.0 * shared


class Drive:
    """Commanded torque and wheel speed on one grid.

    It is the commands that are shifted: they have no noise, so what every lag is held against is
    one draw of it.
    """

    def __init__(self, recording: Recording, platform: Platform, grid: Grid) -> None:
        self.grid = grid
        speed = Means(recording["wheel_speed"])
        self._inertia = np.array([wheel.inertia for wheel in platform.wheels])
        self._torque = Means(recording["command_wheel_torque"], held=True)
        wanted = self._torque.over(grid.edges) / self._inertia
        self._rate_noise = max(UNKNOWN * float(np.sqrt(np.mean(np.square(wanted)))), 1e-9)
        self._angle_noise = speed.cell_noise(grid.cell) / grid.cell
        self._gained = self._whiten(np.diff(speed.over(grid.around_edges), axis=0) / grid.cell)
        self.inflation = 1.0

    def residual(self, wheels: Array, command: Array, lag: float) -> Array:
        """(n, wheels) for speeds and commands in these axes, the speeds late by `lag` [s]."""
        return self._gained @ wheels.T - self._wanted(lag) @ command.T

    def moments(self, lags: Array) -> Moments:
        """What every pair of axes needs to be judged, at each of these lags."""
        wanted = [self._wanted(float(lag)) for lag in lags]
        return Moments(
            np.array([self._gained.T @ w for w in wanted]),
            np.array([np.sum(np.square(w)) for w in wanted]),
            float(np.sum(np.square(self._gained))),
        )

    def believed(self) -> bool:
        """Whether the wheels follow the commands at all, in some axes and at some lag; if so, what
        the best of them leaves unexplained is taken into account from now on."""
        lags = np.concatenate([NEAR, far_lags(self.grid.longest_lag)])
        axes, same = signed_permutations(len(self._inertia)), np.eye(len(self._inertia))
        misfit = self.moments(lags).misfit(axes, same)
        row, best = np.unravel_index(int(np.argmin(misfit)), misfit.shape)
        gained, wanted = self._gained @ axes[best].T, self._wanted(float(lags[row]))
        shared, power = float(np.sum(gained * wanted)), float(np.sum(np.square(wanted)))
        self.inflation = inflation(gained - wanted)
        seen = shared > SIGNIFICANT * np.sqrt(power * self.inflation)
        return seen and RIGHT[0] < shared / max(power, 1e-300) < RIGHT[1]

    def _wanted(self, lag: float) -> Array:
        """(n, wheels) acceleration that the commands ask for, as the speeds show it."""
        return self._whiten(self._torque.over(self.grid.edges - lag) / self._inertia)

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
