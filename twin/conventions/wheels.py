"""How wheel speeds may have been misread, for a given motion of the body."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.conventions.axes import cost_of, signed_permutations
from twin.conventions.drive import drive_of
from twin.conventions.evidence import inflation
from twin.conventions.momentum import PRIORS, Exchange, Momentum
from twin.conventions.turning import NEAR, SMALL_LAG, far_lags, least
from twin.platform import Platform
from twin.recording import Recording

Array = NDArray[np.float64]

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


class Wheels:
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
        same, found = self._axes[0], list[WheelReading]()
        for axes in self._axes:
            left = moments.misfit(self._axes[:1], axes)
            misfit, lag = least(near, 0.5 * left / self.drive.inflation)
            found.append(WheelReading(same, axes, float(lag[0]), float(misfit[0])))
        as_read, *others = found
        best = min(others, key=lambda one: one.misfit + cost_of(one.command))
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
