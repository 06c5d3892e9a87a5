"""The wheels against the body: what one gains in momentum the other gives.

H = R (J w + sum a_i I_i Omega_i) in world axes changes by gravity alone, dH/dt = (R m r) x g. With
J from the platform that leaves, linear in what is unknown: H at the start, m r, a constant torque,
friction that grows with the rate, a cable's pull, the gyro's bias, and what J is off by. They are
projected out (J's error, with its prior, is held to
a few tenths; the bias to what the attitude says of it, else a wheel at constant speed could hide in
it), and what the wheels do beyond that must answer the body.

J. L. Schwartz and C. D. Hall, System identification of a spherical air-bearing spacecraft
simulator, AAS 04-122: the momentum integral.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.conventions.grid import Grid, Means, grid_of
from twin.platform import Platform
from twin.recording import Recording, Series

Array = NDArray[np.float64]

INERTIA_ERROR = 0.15
"""1 sigma of an entry of J, of its mean moment: what a CAD model or an old payload leaves."""
BIAS_DOUBT = 3.0
"""The gyro's bias drifts: so many times its formal sigma is left to it."""
RIGID = 0.02
"""Likewise for finding the unit of the wheels: J is held nearly as it is stated."""
OWN = 2.0
"""Mean square, in units of its noise, from which on a speed is the wheels' own."""
PRIORS = 9
"""Rows of what is known of the bias and of J."""
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class Exchange:
    """Body motion on a grid, and what of the wheels it can and cannot tell."""

    body: Array
    """(rows,) momentum of the body in world axes, in units of its noise, unknowns projected out."""
    basis: Array
    """(rows, c) of the unknowns."""
    share: Array
    """(n, 3, wheels) world momentum per wheel speed, in units of the noise."""

    def wheels(self, speed: Array) -> Array:
        """(rows, wheels, wheels): what wheel i gives if it turned as column j of (n, wheels)."""
        product = self.share[:, :, :, None] * speed[:, None, None, :]
        count = speed.shape[1]
        flat = np.zeros((len(self.body), count * count))
        flat[: product[..., 0, 0].size] = product.reshape(-1, count * count)
        return (flat - self.basis @ (self.basis.T @ flat)).reshape(-1, count, count)


class Momentum:
    """Wheels and body on one grid."""

    def __init__(self, recording: Recording, platform: Platform, grid: Grid) -> None:
        self.grid = grid
        self._platform = platform
        self._gyro = Means(recording["gyro"])
        self._attitude = Means(recording["attitude"])
        self._angle_noise = self._attitude.cell_noise(grid.cell)
        self._wheels = Means(recording["wheel_speed"])
        self._stages = (
            Means(recording["stage_position"])
            if platform.stages and "stage_position" in recording
            else None
        )
        self._axes = np.array([wheel.axis for wheel in platform.wheels])
        self._inertia = np.array([wheel.inertia for wheel in platform.wheels])

    def with_attitude(self, series: Series) -> "Momentum":
        """The same beside another reading of the attitude, as noisy as that."""
        other = copy(self)
        other._attitude = Means(series)
        return other

    @property
    def wheels(self) -> int:
        """How many."""
        return len(self._axes)

    def speed(self, lag: float) -> Array:
        """(n, wheels) mean speed in each cell if it is late by `lag` [s]."""
        return self._wheels.over(self.grid.edges + lag)

    @property
    def follows_body(self) -> bool:
        """Whether the wheels only lag behind the body that turns under them, as those do that
        nothing drives: so does a body whose J is off, and they tell nothing of their unit."""
        speed, rate = self.speed(0.0), self._gyro.over(self.grid.edges)
        own = speed - rate @ np.linalg.lstsq(rate, speed, rcond=None)[0]
        noise = self._wheels.cell_noise(self.grid.cell)
        return float(np.mean(np.square(own))) < OWN * noise**2

    def exchange(
        self,
        attitude: Array,
        gyro: Array,
        bias: tuple[Array, float],
        *,
        gyro_lag: float = 0.0,
        attitude_lag: float = 0.0,
        rough: bool = False,
    ) -> Exchange:
        """The body's side, read as the 4 x 4 `attitude` and the 3 x 3 `gyro` say, whose `bias`
        comes with its 1 sigma [rad/s].

        `rough`: no more is asked than the common scale of body and wheels, to a factor; J is held,
        and nothing brakes or pulls, which would hide that scale in a short log.
        """
        edges = self.grid.edges
        q = rotation.normalized(self._attitude.over(edges + attitude_lag) + 1e-9) @ attitude.T
        q = rotation.normalized(q)
        turn = rotation.matrix(q)
        rate = self._gyro.over(edges + gyro_lag) @ gyro.T - bias[0]
        inertia = self._platform.inertia
        body = _apply(turn, rate @ inertia.T) - self._stage_impulse(turn)
        noise = self._noise()
        unknown = [] if rough else [self._outside(q, turn, rate)]
        # what something is known of stands last
        columns = np.concatenate([*unknown, self._unknowns(turn, rate)], axis=2) / noise
        # within a gap of a stream its values are interpolated, and no evidence of the wheels
        covered = self._gyro.covers(edges + gyro_lag) & self._wheels.covers(edges)
        covered = (covered & self._attitude.covers(edges + attitude_lag))[:, None].astype(
            np.float64
        )
        columns = columns * covered[:, None]
        size = 3 * len(turn)
        moment = float(np.trace(inertia)) / 3.0
        off = (RIGID if rough else INERTIA_ERROR) * moment
        spread = np.r_[np.full(3, BIAS_DOUBT * bias[1] * moment), np.full(len(ENTRIES), off)]
        rows = np.zeros((size + len(spread), columns.shape[2]))
        rows[:size] = columns.reshape(size, -1)
        rows[size:, -len(spread) :] = np.diag(1.0 / spread)
        basis = np.linalg.qr(rows)[0]
        flat = np.zeros(len(rows))
        flat[:size] = (covered * body / noise).ravel()
        share = np.einsum("nij,wj->niw", turn, self._axes) * (self._inertia / noise)
        share = share * covered[:, None]
        return Exchange(flat - basis @ (basis.T @ flat), basis, share)

    def _outside(self, attitude: Array, turn: Array, rate: Array) -> Array:
        """(n, 3, 2): friction, a cable."""
        # seen in the room from where the log begins; from elsewhere it is a constant torque more
        away = rotation.multiply(attitude, rotation.conjugate(attitude[:1]))
        acting = np.stack([_apply(turn, rate), rotation.to_rotation_vector(away)], axis=2)
        return _up_to_centres(acting, self.grid.cell)

    def _unknowns(self, turn: Array, rate: Array) -> Array:
        """(n, 3, 18): start, steady torque, m r, gyro bias, error of J."""
        count = len(turn)
        along = np.linspace(-1.0, 1.0, count)[:, None, None] * np.eye(3)
        # (R m r) x g with g = (0, 0, -g), summed up; columns scaled to be of the order of one
        summed = _up_to_centres(turn, self.grid.cell)
        gravity = np.zeros_like(summed)
        gravity[:, 0], gravity[:, 1] = -summed[:, 1], summed[:, 0]
        basis = np.zeros((len(ENTRIES), 3, 3))
        for entry, (i, j) in zip(basis, ENTRIES, strict=True):
            entry[i, j] = entry[j, i] = 1.0
        error = np.einsum("nij,ejk,nk->nie", turn, basis, rate)
        constant = np.broadcast_to(np.eye(3), (count, 3, 3))
        return np.concatenate([constant, along, gravity, turn, error], axis=2)

    def _stage_impulse(self, turn: Array) -> Array:
        """(n, 3) momentum that gravity gave through the stages away from 0."""
        if self._stages is None:
            return np.zeros((len(turn), 3))
        masses = np.array([stage.mass for stage in self._platform.stages])
        axes = np.array([stage.axis for stage in self._platform.stages])
        offset = _apply(turn, self._stages.over(self.grid.edges) * masses @ axes)
        torque = np.cross(offset, [0.0, 0.0, -self._platform.gravity])
        return _up_to_centres(torque, self.grid.cell)

    def _noise(self) -> float:
        """1 sigma of H in a cell [N m s]."""
        cell = self.grid.cell
        moments = np.diag(self._platform.inertia)
        body = np.sqrt(np.mean(moments**2)) * self._gyro.cell_noise(cell)
        wheels = np.sqrt(np.mean(self._inertia**2)) * self._wheels.cell_noise(cell)
        speed = self._wheels.over(self.grid.edges)
        held = np.sqrt(np.mean(np.sum(np.square(self._inertia * speed), axis=1)))
        # an attitude error turns what the wheels hold
        return float(np.sqrt(body**2 + wheels**2 + (held * self._angle_noise) ** 2))


def momentum_of(recording: Recording, platform: Platform | None) -> Momentum | None:
    """None without a platform with wheels on a ball, or without the streams."""
    if platform is None or platform.base.kind != "ball" or not platform.wheels:
        return None
    wheels = recording.streams.get("wheel_speed")
    if wheels is None or wheels.value.shape[1] != len(platform.wheels):
        return None
    if "gyro" not in recording or recording["gyro"].columns != ("x", "y", "z"):
        return None
    grid = grid_of(recording, "gyro", "attitude", "wheel_speed")
    return Momentum(recording, platform, grid) if grid is not None else None


def _apply(turn: Array, vectors: Array) -> Array:
    return np.einsum("nij,nj->ni", turn, vectors)


def _up_to_centres(means: Array, cell: float) -> Array:
    """Integral up to the centre of each cell."""
    return (np.cumsum(means, axis=0) - 0.5 * means) * cell
