"""Where a machine that travels is and how fast it goes, from a camera and its thrusters."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from twin.drives import travelling_mass
from twin.estimators.estimator import variance_of
from twin.platform import Platform
from twin.rotation import rotate
from twin.signals import Command, Estimate, Reading, Samples

Array = NDArray[np.float64]

_FAR = np.array([1e2, 0.1, 0.003])
"""1 sigma of position [m], velocity [m/s] and disturbance [m/s^2] before the first sample."""


@dataclass
class PlaceFilter:
    """Kalman filter of position, velocity and disturbance of n runs, each axis of the room apart.

    x = (p, v, d):  dp/dt = v,  dv/dt = u + d + white noise,  dd/dt = white noise

    u is what the thrusters are told to push with, turned into the room by the estimated attitude,
    over the mass of all that travels, and held over a tick. d is what no command explains: a slope
    of the floor, a draft, a mass that is not as stated. The samples of a tick enter as one, their
    mean, at their mean age L, by which H = (1, -L, L^2 / 2).

    The state stands at the tick, so a late camera is allowed for as far as u held over its age. A
    delay of the valves is not allowed for: it shows in d.
    """

    scatter: float = 3e-4
    """White noise of the acceleration [m/s^1.5]."""
    wander: float = 1e-4
    """Of the disturbance [m/s^2.5]."""
    directions: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(thrusters, 3) of the force per force, body axes, over the mass [1/kg]."""
    moves: Array = field(default_factory=lambda: np.ones(3))
    """(3,) 1 along the room's axes in which the CR moves."""
    variance: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) of a sample [m^2]."""
    time: float = 0.0
    """Of the state [s]."""
    state: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    """(n, axes, 3) position [m], velocity [m/s] and disturbance [m/s^2]."""
    covariance: Array = field(default_factory=lambda: np.zeros((0, 3, 3, 3)))
    """(n, axes, 3, 3)."""
    pushed: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(n, 3) u, world [m/s^2]."""
    located_runs: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """(n,) runs of which a sample has come."""

    @classmethod
    def of(cls, platform: Platform, n: int) -> Self | None:
        """For n runs of a machine; None where it stays in its place, or no camera shows that."""
        if not platform.base.travels or "position" not in platform.sensors:
            return None
        thrusters = platform.thrusters
        force = np.array([thruster.direction for thruster in thrusters]).reshape(-1, 3)
        return cls(
            directions=force / travelling_mass(platform),
            moves=_moves(platform),
            variance=variance_of(platform.sensors["position"]),
            state=np.zeros((n, 3, 3)),
            covariance=np.tile(np.diag(_FAR**2), (n, 3, 1, 1)),
            pushed=np.zeros((n, 3)),
            located_runs=np.zeros(n, dtype=np.bool_),
        )

    def located(self, estimate: Estimate, reading: Reading) -> Estimate:
        """The estimate with position, velocity and disturbance at the tick of a reading."""
        self._advance(reading.time)
        samples = reading.streams.get("position")
        if samples is not None:
            self._correct(samples)
        shown = (
            self.state
            if self.located_runs.all()
            else np.where(self.located_runs[:, None, None], self.state, np.nan)
        )
        return replace(
            estimate,
            position=shown[..., 0].copy(),
            velocity=shown[..., 1].copy(),
            disturbance=shown[..., 2].copy(),
        )

    def command(self, attitude: Array, applied: Command) -> None:
        """What is applied from this tick on, at the attitudes (n, 4) of the runs."""
        force = applied.get("command_thruster")
        if force is not None and len(self.directions):
            # einsum rather than @: a row's last bits must not depend on how many runs there are.
            push = np.einsum("nt,ti->ni", force, self.directions)
            self.pushed = self.moves * rotate(attitude, push)

    def _advance(self, time: float) -> None:
        step = time - self.time
        self.time = time
        if step <= 0.0:
            return
        move = np.array([[1.0, step, 0.5 * step**2], [0.0, 1.0, step], [0.0, 0.0, 1.0]])
        state = np.einsum("ij,naj->nai", move, self.state)
        state[..., 0] += 0.5 * step**2 * self.pushed
        state[..., 1] += step * self.pushed
        covariance = np.einsum("ij,najk,lk->nail", move, self.covariance, move)
        white, walk = self.scatter**2, self.wander**2
        covariance += white * np.array(
            [[step**3 / 3.0, step**2 / 2.0, 0.0], [step**2 / 2.0, step, 0.0], [0.0, 0.0, 0.0]]
        )
        covariance[..., 2, 2] += walk * step
        self.state, self.covariance = state, covariance

    def _correct(self, samples: Samples) -> None:
        valid = samples.valid
        count = valid.sum(axis=1)
        share = valid / np.maximum(count, 1)[:, None]
        value = np.where(valid[..., None], samples.value, 0.0)
        mean = np.einsum("nm,nma->na", share, value)
        age = np.where(count > 0, self.time - np.einsum("nm,nm->n", share, samples.time), 0.0)
        row = np.stack([np.ones_like(age), -age, 0.5 * age**2], axis=-1)
        with np.errstate(divide="ignore"):
            noise = self.variance / count[:, None]
        crossed = np.einsum("naij,nj->nai", self.covariance, row)
        gain = crossed / (np.einsum("nai,ni->na", crossed, row) + noise)[..., None]
        expected = np.einsum("nai,ni->na", self.state, row) + row[:, 2:] * self.pushed
        surprise = np.where(count[:, None] > 0, mean - expected, 0.0)
        self.state = self.state + gain * surprise[..., None]
        self.covariance = self.covariance - gain[..., :, None] * crossed[..., None, :]
        self.located_runs = self.located_runs | (count > 0)


def _moves(platform: Platform) -> Array:
    base = platform.base
    if base.kind == "free":
        return np.ones(3)
    along = [float(name not in base.locked) for name in base.planar[:2]]
    return np.array([*along, 0.0])
