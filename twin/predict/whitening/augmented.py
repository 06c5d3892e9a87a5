"""A log's small changes of state, carried from instant to instant beside those of its noise.

A state of the noise has variance 1 when nothing is known of it; its size stands in what it does. A
torque that wanders acts as the mean of its values at the ends of a step, half of the step's impulse
before it and half after, as all forces do (`path/tangent.py`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.predict.whitening.noise_model import NoiseModel

Array = NDArray[np.float64]


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
    shown: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """(S, N, k) d(measured / noise) / d(error of each column) of each stream of sensors."""

    def scale(self, noise: NoiseModel) -> Array:
        """(S, N) of each row's white noise, in units of what it was taken to be."""
        scale = np.ones(self.measured.shape[:2])
        for stream, size in noise.scales.items():
            if stream in self.shown:
                scale[self.shown[stream].any(axis=-1)] = size
        return scale


class Augmented:
    """States (y = x + n) of a motion and of its noise."""

    def __init__(self, local: Local, noise: NoiseModel) -> None:
        """Beside each other.

        Args:
            local: of the motion; its rows are of white noise of variance 1.
            noise: of which what is 0 has no state.
        """
        segments, _, x = local.measured.shape
        step, c = local.step, local.pushed.shape[-1]
        pushes, decays, sizes, shown = [np.zeros((segments, x, 0))], [], [], [local.measured]

        def add(count: int, decay: float, size: float) -> None:
            decays.extend([decay] * count)
            sizes.extend([size] * count)

        if noise.torque.rms > 0.0:
            decay = noise.torque.decay(step)
            add(c, decay, float(np.sqrt(1.0 - decay**2)))
            pushes.append(0.5 * step * noise.torque.rms * local.pushed)
            shown.append(np.zeros((*local.measured.shape[:2], c)))
        self.torques = len(decays)
        """How many of the noise's states are torques; they come first."""
        for stream, error in noise.errors.items():
            if error.rms > 0.0 and stream in local.shown:
                decay = error.decay(step)
                shown.append(error.rms * local.shown[stream])
                add(shown[-1].shape[-1], decay, float(np.sqrt(1.0 - decay**2)))
        for stream, walk in noise.walks.items():
            if walk > 0.0 and stream in local.shown:
                shown.append(walk * local.shown[stream])
                add(shown[-1].shape[-1], 1.0, float(np.sqrt(step)))
        self.local, self.x, self.n = local, x, len(decays)
        self.decay, self.size = np.array(decays), np.array(sizes)
        y = x + self.n
        pushes.append(np.zeros((segments, x, self.n - self.torques)))
        self.push = np.concatenate(pushes, axis=-1)
        """(S, x, n) change of the motion by half a step of each at its size."""
        self.measured = with_none(np.concatenate(shown, axis=-1) if self.n else local.measured)
        """(S, N + 1, y); the last is of a slot that holds no sample."""
        force = local.pushed * (noise.white_torque * step)
        self._white = np.zeros((segments, y, y))
        self._white[:, :x, :x] = force @ local.pushed.transpose(0, 2, 1)
        self.moves = np.concatenate(
            [self.push, np.broadcast_to(np.eye(self.n), (segments, self.n, self.n))], axis=1
        )
        self.moves = self.moves * self.size
        """(S, y, n) change of all by a unit of each process's new noise in a step."""
        self._white += self.moves @ self.moves.transpose(0, 2, 1)
        self._carry = np.zeros((segments, y, y))
        self._carry[:, x:, x:] = np.diag(self.decay)

    def carry(self, k: int) -> Array:
        """(S, y, y) from an instant to the next."""
        if not self.n:
            return self.local.carried[:, k]
        carried, x = self.local.carried[:, k], self.x
        carry = self._carry.copy()
        carry[:, :x, :x] = carried
        acting = slice(x, x + self.torques)
        push = self.push[..., : self.torques]
        carry[:, :x, acting] = carried @ push + push * self.decay[: self.torques]
        return carry

    def gained(self, k: int) -> Array:
        """(S, y, y) covariance that the step between them adds."""
        if not self.n:
            return self._white + self.local.wander[:, k]
        gained = self._white.copy()
        gained[:, : self.x, : self.x] += self.local.wander[:, k]
        return gained


def with_none(rows: Array) -> Array:
    """Rows (S, N, ...), and after them one of zeros: of a slot that holds no sample."""
    return np.concatenate([rows, np.zeros_like(rows[:, :1])], axis=1)
