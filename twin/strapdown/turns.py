"""From one attitude to the next: the turn that was measured, and the one that the gyro gives."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh, null_space

from twin import rotation
from twin.recording import Recording
from twin.strapdown.faults import columns, corrected

Array = NDArray[np.float64]

LONGEST = 0.5
"""Between two attitudes further apart the attitude is lost, and found anew [s]."""
SMALL_ANGLE = 0.5
"""Errors up to this add up as vectors [rad]."""
WIDTHS = (1, 3, 7, 15, 31, 63)
"""Samples that a gyro is smoothed over."""
NOISE_SHARE = 0.05
"""Largest share of noise in the power of a column whose parameter is fitted."""
NOISE_ONLY = 1.2
"""Smoothing that takes away more than this times the noise takes away motion."""


@dataclass(frozen=True)
class Turns:
    """K + 1 attitudes and the K turns between them."""

    time: Array
    """(K + 1,) [s]."""
    attitude: Array
    """(K + 1, 4)."""
    gyro_time: Array
    gyro: Array
    """(m, 3) as read [rad/s]."""
    gyro_noise: float
    """1 sigma a sample [rad/s]."""

    @cached_property
    def lasts(self) -> Array:
        """(K,) [s]."""
        return np.diff(self.time)

    @cached_property
    def measured(self) -> Array:
        """(K, 4) by the attitude, in body axes."""
        return rotation.multiply(rotation.conjugate(self.attitude[:-1]), self.attitude[1:])

    def by_gyro(self, theta: Array) -> Array:
        """(K, 4) by a gyro with these errors: the rate linear between samples."""
        edges, rates, first = self._steps(theta)
        step = np.diff(edges)[:, None]
        # two terms of Magnus' series: the mean rate, and how its direction turns
        turn = 0.5 * (rates[1:] + rates[:-1]) * step
        turn += rotation.cross(rates[:-1], rates[1:]) * np.square(step) / 12.0
        steps = rotation.from_rotation_vector(turn)
        total = np.tile([1.0, 0.0, 0.0, 0.0], (len(self.lasts), 1))
        counts = np.diff(first)
        for place in range(int(counts.max())):
            has = counts > place
            total[has] = rotation.multiply(total[has], steps[first[:-1][has] + place])
        return total

    def errors(self, theta: Array) -> Array:
        """(K, 3) measured turn beyond the gyro's, in world axes [rad]."""
        turned = self.by_gyro(theta)
        alone = rotation.multiply(self.attitude[:1], chained(turned))
        away = rotation.to_rotation_vector(
            rotation.multiply(self.attitude, rotation.conjugate(alone))
        )
        if np.abs(away).max() < SMALL_ANGLE:
            return np.diff(away, axis=0)
        # Of a gyro that strays far the turns themselves; noisy ones do not quite sum up.
        beyond = rotation.multiply(rotation.conjugate(turned), self.measured)
        return rotation.rotate(self.attitude[1:], rotation.to_rotation_vector(beyond))

    def shown(self, theta: Array) -> Array:
        """(13, k) orthonormal directions of the parameters that the turns show.

        A column that is mostly the noise that it is to explain pulls its parameter by the noise's
        share of it, whatever its interval says (errors in variables): directions in which that
        share exceeds `NOISE_SHARE` are left out. About one axis alone, say, no turn shows the
        scales of the others, nor tells turned axes from those that are not square.
        """
        _, rate = corrected(self.gyro_time, self.gyro, theta)
        smooth, width = smoothed(rate, self.gyro_noise)
        power, noise = _gram(smooth), _gram(np.eye(3)) * np.square(self.gyro_noise) / width
        size = np.sqrt(np.maximum(np.diag(power), np.diag(noise)))
        ridge = 1e-12 * np.eye(len(power))
        share, direction = eigh(noise / np.outer(size, size), power / np.outer(size, size) + ridge)
        hidden = direction[:, share >= NOISE_SHARE] / size[:, None]
        basis = null_space(hidden.T) if hidden.size else np.eye(len(power))
        return block_diag(np.eye(3), basis, np.eye(1))

    def columns(self, theta: Array) -> Array:
        """(K, 3, 13) by how much `errors` grow a parameter."""
        time, rate = corrected(self.gyro_time, self.gyro, theta)
        smooth, _ = smoothed(rate, self.gyro_noise)
        shown = columns(smooth, np.gradient(smooth, time, axis=0))
        flat = shown.reshape(len(time), -1)
        summed = np.zeros((len(time), flat.shape[1]))
        summed[1:] = np.cumsum(0.5 * (flat[1:] + flat[:-1]) * np.diff(time)[:, None], axis=0)
        at = np.stack([np.interp(self.time, time, column) for column in summed.T], axis=-1)
        over = np.diff(at, axis=0).reshape(-1, 3, shown.shape[2])
        middle = rotation.matrix(rotation.normalized(self.attitude[:-1] + self.attitude[1:]))
        return -np.einsum("kij,kjp->kip", middle, over)

    def _steps(self, theta: Array) -> tuple[Array, Array, NDArray[np.intp]]:
        """Instants at which the rate bends or an attitude stands, the rates there, and where among
        them the attitudes are."""
        time, rate = corrected(self.gyro_time, self.gyro, theta)
        inside = time[(time > self.time[0]) & (time < self.time[-1])]
        edges = np.union1d(self.time, inside)
        rates = np.stack([np.interp(edges, time, column) for column in rate.T], axis=-1)
        return edges, rates, np.searchsorted(edges, self.time)


def chained(turns: Array) -> Array:
    """(K + 1, 4) one after the other, from no turn: by doubling the reach of each product."""
    chain = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], turns])
    reach = 1
    while reach < len(chain):
        chain[reach:] = rotation.multiply(chain[:-reach].copy(), chain[reach:])
        reach *= 2
    return rotation.normalized(chain)


def _gram(rate: Array) -> Array:
    """(9, 9) mean products of the columns of scale, misalignment and skew at body rates (m, 3)."""
    shown = columns(rate, np.zeros_like(rate))[:, :, 3:12]
    return np.einsum("mip,miq->pq", shown, shown) / (len(rate) if len(rate) > 3 else 1)


def smoothed(rate: Array, noise: float) -> tuple[Array, int]:
    """Means over as many samples as take away noise and no motion, and how many these are.

    A column made of the noise that it shall explain would be believed too much.
    """
    best, samples = rate, WIDTHS[0]
    for width in WIDTHS[1:]:
        if width > len(rate) // 4:
            break
        kernel = np.ones(width) / width
        padded = np.pad(rate, ((width // 2, width // 2), (0, 0)), mode="edge")
        wider = np.stack([np.convolve(c, kernel, mode="valid") for c in padded.T], axis=-1)
        taken = float(np.mean(np.square(rate - wider)))
        if taken > NOISE_ONLY * noise**2 * (1.0 - 1.0 / width):
            break
        best, samples = wider, width
    return best, samples


def turns_of(recording: Recording, gyro_noise: float, spacing: float = 0.0) -> Turns:
    """The attitudes during which the gyro ran, no closer together than `spacing` [s].

    A camera's errors last from one picture to the next; the fewer are as good as all.
    """
    gyro, attitude = recording["gyro"], recording["attitude"]
    inside = (attitude.time >= gyro.time[0]) & (attitude.time <= gyro.time[-1])
    inside &= _sparse(attitude.time, spacing)
    q = rotation.continuous(attitude.value[inside])
    return Turns(attitude.time[inside], q, gyro.time, gyro.value, gyro_noise)


def _sparse(time: Array, spacing: float) -> NDArray[np.bool_]:
    """The first row of every cell of this width."""
    if not spacing:
        return np.ones(len(time), dtype=bool)
    cell = np.floor((time - time[0]) / spacing + 1e-6)
    return np.diff(cell, prepend=-1.0) > 0.0
