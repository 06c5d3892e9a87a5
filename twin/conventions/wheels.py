"""How wheel speeds may be misread: against the motion, the momentum and the commands.

The wheels against their commanded torque: a second witness for their axes and their clock.
I dOmega/dt = command, but for friction and for the body's own acceleration, a hundredth of it. The
commands are stamped by the host when they are applied, so theirs is the clock that is believed.

The wheels against the body: what one gains in momentum the other gives.
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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.conventions.correction import cost_of, signed_permutations
from twin.conventions.evidence import drift, forgetting, inflation, whitened, without
from twin.conventions.grid import CellGrid, Means, between_centres, grid_of
from twin.conventions.turning import NEAR, SMALL_LAG, far_lags, least
from twin.platform import Platform
from twin.recording import Recording, Series

Array = NDArray[np.float64]


CELL = 0.1
"""[s]: torques change from tick to tick, and that is what tells the time."""
UNKNOWN = 0.1
"""Friction and an error of the inertia, as a share of the torque."""
SIGNIFICANT_CORRELATION = 8.0
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


class WheelDrive:
    """Commanded torque and wheel speed on one grid.

    It is the commands that are shifted: they have no noise, so what every lag is held against is
    one draw of it.
    """

    def __init__(self, recording: Recording, platform: Platform, grid: CellGrid) -> None:
        self.grid = grid
        speed = Means(recording["wheel_speed"])
        self._kept = between_centres(grid, speed, None)
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
        seen = shared > SIGNIFICANT_CORRELATION * np.sqrt(power * self.inflation)
        return seen and RIGHT[0] < shared / max(power, 1e-300) < RIGHT[1]

    def _wanted(self, lag: float) -> Array:
        """(n, wheels) acceleration that the commands ask for, as the speeds show it."""
        return self._whiten(self._torque.over(self.grid.edges - lag) / self._inertia)

    def _whiten(self, rate: Array) -> Array:
        pole = forgetting(self._angle_noise, self._rate_noise)
        seen = rate * self._kept[:, None]
        return without(drift(self._kept, pole), whitened(seen, self._angle_noise, self._rate_noise))


def drive_of(recording: Recording, platform: Platform) -> WheelDrive | None:
    """None without wheels, commands and speeds that have to do with each other."""
    names = ("wheel_speed", "command_wheel_torque")
    width = len(platform.wheels)
    if any(n in recording and recording[n].value.shape[1] != width for n in names):
        return None
    grid = grid_of(recording, *names, narrowest=CELL)
    if grid is None:
        return None
    drive = WheelDrive(recording, platform, grid)
    return drive if drive.believed() else None


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

    def __init__(self, recording: Recording, platform: Platform, grid: CellGrid) -> None:
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


SIGNIFICANT = 8.0
"""Sigmas without which no factor of the wheels is spoken of."""


ANSWERED = 0.7
"""Share of the body's momentum without which the wheels are not believed to answer it."""
NOISY = 2.0
"""Mean square, in units of its noise, of what a right reading may leave without that."""
POLISHED = 0.045
"""A lag found on the grid is sought again within this [s]."""
NEAR_LAGS = np.linspace(-SMALL_LAG, SMALL_LAG, 5)


@dataclass(frozen=True)
class WheelReading:
    """Axes and lag of the wheels, and what they leave unexplained."""

    axes: Array
    """(wheels, wheels) right = axes @ read."""
    command: Array
    """(wheels, wheels) the same of their commanded torque."""
    lag: float
    """Behind the body and the commands [s]."""
    misfit: float
    """[nats]."""

    @property
    def plain(self) -> bool:
        """Whether wheels and commands are in the axes in which they were read."""
        same = np.eye(len(self.axes))
        return bool((self.axes == same).all() and (self.command == same).all())


class WheelStreams:
    """Wheels held against the body, and against their commands where there are some."""

    def __init__(self, recording: Recording, platform: Platform, momentum: Momentum) -> None:
        self.momentum = momentum
        self.drive = drive_of(recording, platform)
        longest = momentum.grid.longest_lag
        if self.drive is not None:
            longest = min(longest, self.drive.grid.longest_lag)
        self.lags = np.concatenate([NEAR_LAGS, far_lags(longest)])
        self.inflation = 1.0
        self._axes = signed_permutations(momentum.wheels)
        self._driven, self._command = self._by_command()

    def judge(self, exchange: Exchange) -> bool:
        """Take what the best reading leaves unexplained for what every reading cannot explain.

        Returns:
            Whether the wheels are a witness at all: where they answer little of what the body does
            and leave more than noise, something else turns it, which a wrong reading may hide best.
        """
        tried = self._tried(exchange, self.lags) + 2.0 * self._driven
        row, best = np.unravel_index(int(np.argmin(tried)), tried.shape)
        left = self._left(exchange, self._axes[best], float(self.lags[row]))
        self.inflation = inflation(left[:-PRIORS].reshape(-1, 3))
        least, body = float(left @ left), float(exchange.body @ exchange.body)
        return least < NOISY * len(left) or least < (1.0 - ANSWERED) * body

    def readings(self, exchange: Exchange, *, far: bool) -> list[WheelReading]:
        """Every axes of the wheels, each at its best lag, near or far; the likeliest first."""
        chosen = (np.abs(self.lags) > SMALL_LAG + 1e-9) == far
        lags = self.lags[chosen]
        if not len(lags):  # too short a log for any
            return []
        tried = 0.5 * self._tried(exchange, lags) / self.inflation + self._driven[chosen]
        misfit, best = least(lags, tried)
        cost = np.array([cost_of(axes) for axes in self._axes])
        order = np.argsort(misfit + cost)
        misfit = misfit - [cost_of(command) for command in self._command]
        return [
            WheelReading(self._axes[i], self._command[i], float(best[i]), float(misfit[i]))
            for i in order
        ]

    def as_read(self, exchange: Exchange) -> WheelReading:
        """Wheels and commands as they are, late by no more than a latency."""
        near = np.abs(self.lags) <= SMALL_LAG + 1e-9
        tried = 0.5 * self._tried(exchange, self.lags[near])[:, :1] / self.inflation
        if self.drive is not None:
            driven = self.drive.moments(self.lags[near]).misfit(self._axes[:1], self._axes[0])
            tried = tried + 0.5 * driven / self.drive.inflation
        misfit, lag = least(self.lags[near], tried)
        return WheelReading(self._axes[0], self._axes[0], float(lag[0]), float(misfit[0]))

    def commanded(self) -> list[WheelReading]:
        """Wheels and commands as read, and the one or the other in the best other axes, between
        which commands alone do not tell; none without commands that the wheels follow."""
        if self.drive is None:
            return []
        near = self.lags[np.abs(self.lags) <= SMALL_LAG + 1e-9]
        moments = self.drive.moments(near)
        same, result = self._axes[0], list[WheelReading]()
        for axes in self._axes:
            left = moments.misfit(self._axes[:1], axes)
            misfit, lag = least(near, 0.5 * left / self.drive.inflation)
            result.append(WheelReading(same, axes, float(lag[0]), float(misfit[0])))
        as_read, *others = result
        best = min(others, key=lambda other: other.misfit + cost_of(other.command))
        return [as_read, best, replace(best, axes=best.command.T, command=same)]

    def polished(self, exchange: Exchange, reading: WheelReading) -> WheelReading:
        """The same at a finer lag: torques that change at every tick tell it to milliseconds."""
        lags = reading.lag + np.linspace(-POLISHED, POLISHED, 7)
        tried = np.empty((len(lags), 1))
        for row, lag in zip(tried, lags, strict=True):
            row[0] = self.misfit(exchange, replace(reading, lag=float(lag)))
        misfit, best = least(lags, tried)
        return replace(reading, lag=float(best[0]), misfit=float(misfit[0]))

    def misfit(self, exchange: Exchange, reading: WheelReading) -> float:
        """[nats] against the body, and against the commands where there are some."""
        left = self.residual(exchange, reading)
        misfit = 0.5 * float(left @ left) / self.inflation
        return misfit + self.driven(reading)

    def driven(self, reading: WheelReading) -> float:
        """[nats] against the commands; 0 without."""
        if self.drive is None:
            return 0.0
        left = self.drive.residual(reading.axes, reading.command, reading.lag)
        return 0.5 * float(np.sum(np.square(left))) / self.drive.inflation

    def residual(self, exchange: Exchange, reading: WheelReading) -> Array:
        """(rows,) momentum of body and wheels, in units of its noise."""
        return self._left(exchange, reading.axes, reading.lag)

    def _left(self, exchange: Exchange, axes: Array, lag: float) -> Array:
        columns = exchange.wheels(self.momentum.speed(lag))
        return exchange.body + np.einsum("nij,ij->n", columns, axes)

    def _tried(self, exchange: Exchange, lags: Array) -> Array:
        """(lags, axes) squared norm of the residual."""
        tried = np.empty((len(lags), len(self._axes)))
        for row, lag in zip(tried, lags, strict=True):
            shared, power = _products(exchange, self.momentum.speed(float(lag)), self._axes)
            row[:] = float(exchange.body @ exchange.body) - 2.0 * shared + power
        return tried

    def _by_command(self) -> tuple[Array, Array]:
        """(lags, axes) misfit [nats] against the commands, in the commands' own best axes, which
        (axes, wheels, wheels) come with it; their cost is in it."""
        same = np.broadcast_to(np.eye(self.momentum.wheels), self._axes.shape).copy()
        if self.drive is None:
            return np.zeros((len(self.lags), len(self._axes))), same
        moments = self.drive.moments(self.lags)
        best, command = np.full((len(self.lags), len(self._axes)), np.inf), same
        for axes in self._axes:
            tried = 0.5 * moments.misfit(self._axes, axes) / self.drive.inflation + cost_of(axes)
            better = tried.min(axis=0) < best.min(axis=0)
            best[:, better], command[better] = tried[:, better], axes
        return best, command


def factor_of(momentum: Momentum, exchange: Exchange) -> tuple[float, float]:
    """By what the wheel speeds must be multiplied to answer the body, whatever their axes, and
    which share of the body's momentum they answer; (1, 0) where they answer nothing."""
    axes = signed_permutations(momentum.wheels)
    best, factor = SIGNIFICANT**2, 1.0
    for lag in (*NEAR[::5], *far_lags(momentum.grid.longest_lag, 0.25)):
        shared, power = _products(exchange, momentum.speed(float(lag)), axes)
        explained = np.where(shared > 0.0, shared**2 / np.maximum(power, 1e-300), 0.0)
        top = int(np.argmax(explained))
        if explained[top] > best:
            best, factor = float(explained[top]), float(shared[top] / power[top])
    beyond_noise = float(exchange.body @ exchange.body) - len(exchange.body)
    share = best / max(beyond_noise, best)
    return (factor, share) if best > SIGNIFICANT**2 else (1.0, 0.0)


def _products(exchange: Exchange, speed: Array, axes: Array) -> tuple[Array, Array]:
    """For each axes, minus body times wheels, and wheels squared: the body alone is the least."""
    columns = exchange.wheels(speed).reshape(len(exchange.body), -1)
    flat = axes.reshape(len(axes), -1)
    gram = columns.T @ columns
    return -flat @ (columns.T @ exchange.body), np.einsum("si,ij,sj->s", flat, gram, flat)
