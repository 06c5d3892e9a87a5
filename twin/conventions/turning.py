"""The gyro against the attitude: a rate is the change of an angle, on any body, without parameters.

The attitude's rate between the centres of two cells minus the gyro's mean leaves noise and a bias
if both are read rightly. Its spectrum is known (white from the gyro, its square rising with
frequency from the attitude), so it is whitened, and the bias projected out. All 48 axes at all lags
cost one correlation matrix each: for a signed permutation S, abs(S w)^2 = abs(w)^2, so only
trace(S' C) differs.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.conventions.correction import read_angles, signed_permutations
from twin.conventions.evidence import (
    ConventionFinding,
    drift,
    forgetting,
    no_fit,
    whitened,
    without,
)
from twin.conventions.grid import (
    FEWEST,
    CellGrid,
    Means,
    attitude_rates,
    between_centres,
    grid_of,
)
from twin.recording import Recording, Series

Array = NDArray[np.float64]

SMALL_LAG = 0.1
"""A lag up to this is a latency or a filter's, no wrong convention [s]."""
NEAR = np.linspace(-SMALL_LAG, SMALL_LAG, 11)
SHIFTS = (-0.408, -0.204, 0.0, 0.204, 0.408)
"""Of a cell: a mean of means over these is the mean of a triangle, as wide as that (1 sigma)."""
STEP = 0.05
"""Between the large lags tried [s]."""
FINE = ((0.005, 4), (0.001, 2))
"""Step between those tried about lags that fit [s], and about how many: over wider steps the misfit
of a clear motion is no parabola, by more than the log as read may be worse."""
BLOCKS = (1, 4, 16)
"""Cells over which motion is summed up, to be compared."""
MOVING = 25.0
"""Power from which on a stream moves beyond doubt, in units of its noise."""
COMMON = 0.5
"""Correlation above which two streams show the same motion in some axes."""
TOGETHER = 0.8
"""Correlation, turned as they correlate best, below which gyro and attitude show two motions: of
two that last a minute and are slow, chance makes more than half."""
FEW = 12
"""Rows of the shorter stretches, at least."""
LEAST = 0.5
"""Share of a stream's power that is taken for motion at least, to be compared beneath the noise."""
BIASED = 0.05
"""A gyro's bias is smaller than this [rad/s], or than what it shows of the motion ..."""
OUTDONE = 3.0
"""... so many times."""
SPINNING = 1.0
"""No gyro has a bias as large as this [rad/s]."""
AMBIGUOUS = 1.0
"""A turn from sample to sample, or from cell to cell, up to which nothing is mistaken for the
shorter way round [rad]."""


def far_lags(longest: float, step: float = STEP) -> Array:
    """Lags beyond the small ones, up to the longest [s]."""
    lags = np.arange(SMALL_LAG + step, longest + 1e-9, step)
    return np.concatenate([-lags[::-1], lags])


@dataclass(frozen=True)
class Match:
    """How well a gyro in axes S at its best lag follows the attitude."""

    misfit: Array
    """(families, 48) squared norm of the whitened residual."""
    lag: Array
    """(families, 48) gyro behind attitude [s]."""


class Turning:
    """Gyro and attitude on one grid. Families: 0, the attitude's body rate; 1, its world rate,
    which is the body rate of the inverse attitude but for the sign."""

    def __init__(self, recording: Recording, grid: CellGrid) -> None:
        self.grid = grid
        self._gyro = Means(recording["gyro"])
        attitude = Means(recording["attitude"])
        self.rates = _rates(attitude, grid)
        self._angle_noise = attitude.cell_noise(grid.cell) / grid.cell
        self._rate_noise = self._gyro.cell_noise(grid.cell)
        self._kept = between_centres(grid, attitude, self._gyro)
        self._white: dict[float, Array] = {}

    def with_attitude(self, series: Series) -> "Turning":
        """The same gyro beside another reading of the same attitude, as noisy as that."""
        other = copy(self)
        other.rates = _rates(Means(series), self.grid)
        return other

    def gyro(self, lag: float) -> Array:
        """(n, 3) rate between the centres of two cells if the gyro is late by `lag` [s]: the mean
        of means, as the difference of two mean attitudes is."""
        edges = self.grid.edges + lag
        return np.mean([self._gyro.over(edges + s * self.grid.cell) for s in SHIFTS], axis=0)

    def whiten(self, rate: Array) -> Array:
        """A rate or rate difference, in units of its noise, without bias."""
        nuisance = drift(self._kept, forgetting(self._angle_noise, self._rate_noise))
        seen = rate * self._kept[:, None]
        return without(nuisance, whitened(seen, self._angle_noise, self._rate_noise))

    def _white_gyro(self, lag: float) -> Array:
        if lag not in self._white:
            self._white[lag] = self.whiten(self.gyro(lag))
        return self._white[lag]

    def residual(self, attitude: Array, gyro: Array, lag: float) -> Array:
        """(n, 3) for a quaternion read as the 4 x 4 and a gyro as the 3 x 3 matrix say."""
        inverse, axes = vector_axes(attitude)
        return self.whiten(self.rates[inverse] @ axes.T - self.gyro(lag) @ gyro.T)

    def noise_apart(self, attitudes: tuple[Array, Array], gyros: tuple[Array, Array]) -> float:
        """By how much the noise of gyro and attitude takes two residuals apart, sum of squares, for
        quaternions read as the 4 x 4 and gyros as the 3 x 3 matrices say."""
        (one, before), (other, after) = (vector_axes(attitude) for attitude in attitudes)
        turned = float(np.sum(np.square(after - before))) if one == other else 0.0
        moved = float(np.sum(np.square(gyros[1] - gyros[0])))
        own = noise_power(self._angle_noise, self._rate_noise)
        return float(np.count_nonzero(self._kept)) * (moved * own + turned * (1.0 - own))

    def bias(self, attitude: Array, gyro: Array, lag: float) -> tuple[Array, float]:
        """(3,) the gyro's mean error over the log, in the body axes that `residual` has, and its
        1 sigma [rad/s]."""
        inverse, axes = vector_axes(attitude)
        off = (self.gyro(lag) @ gyro.T - self.rates[inverse] @ axes.T)[self._kept]
        # the attitude's noise enters at both ends only
        ends = np.sqrt(2.0) * self._angle_noise / len(off)
        return off.mean(axis=0), float(np.hypot(ends, self._rate_noise / np.sqrt(len(off))))

    def match(self, lags: Array) -> Match:
        """Both families and all axes, each at the best of these lags, or between them."""
        turned = [self.whiten(rates) for rates in self.rates]
        misfit, lag = least(lags, self._misfit(turned, lags))
        for step, dips in FINE:
            sought = list[float]()
            for place in np.argsort(misfit, axis=None):
                near = round(float(lag.flat[place]) / step) * step
                if any(abs(near - other) < 1.5 * step for other in sought):
                    continue
                if len(sought) == dips:
                    break
                sought.append(near)
                here = np.abs(lag - near) < step
                tried = np.round(near + step * np.array([-1.0, 0.0, 1.0]), 6)
                finer = least(tried, self._misfit(turned, tried))
                misfit[here], lag[here] = finer[0][here], finer[1][here]
        return Match(misfit, lag)

    def _misfit(self, turned: Sequence[Array], lags: Array) -> Array:
        """(lags, families, 48) squared norm of the residual beside white rates of the attitude."""
        axes = signed_permutations(3)
        gyros = [self._white_gyro(float(lag)) for lag in lags]
        power = np.array([np.sum(np.square(gyro)) for gyro in gyros])
        misfit = np.empty((len(lags), 2, len(axes)))
        for family, rate in enumerate(turned):
            shared = np.array([rate.T @ gyro for gyro in gyros]).reshape(-1, 9)
            together = np.sum(np.square(rate)) + power
            misfit[:, family] = together[:, None] - 2.0 * shared @ axes.reshape(-1, 9).T
        return misfit

    def correlation(self, lags: Array, *, askew: bool = False) -> float | None:
        """The largest of gyro and attitude, over both families, all axes, these lags and stretches
        of time of several lengths; None where the one or the other hardly moves.

        With `askew` over all turns and mirror images, not only over signed permutations.
        """
        turned = [self.whiten(rate) for rate in self.rates]
        axes, best = signed_permutations(3), None
        for block in BLOCKS:
            rates = [_summed(rate, block) for rate in turned]
            # of a log of seconds, whose streams differ in bandwidth, fewer rows show one motion
            if len(rates[0]) < (FEW if block == BLOCKS[1] else FEWEST):
                break
            still = MOVING * rates[0].size * block
            for lag in lags:
                gyro = _summed(self._white_gyro(float(lag)), block)
                power = float(np.sum(np.square(gyro)))
                for rate in rates:
                    own = float(np.sum(np.square(rate)))
                    if min(power, own) < still:
                        continue
                    both = rate.T @ gyro
                    if askew:
                        shared = float(np.linalg.svd(both, compute_uv=False).sum())
                    else:
                        shared = float(np.einsum("sij,ij->s", axes, both).max())
                    best = max(best or 0.0, shared / np.sqrt(power * own))
        return best

    @property
    def agrees(self) -> bool:
        """Whether gyro and attitude as read show one motion."""
        same = np.eye(4), np.eye(3)
        left = min(float(np.sum(np.square(self.residual(*same, float(lag))))) for lag in NEAR)
        return left < (1.0 - COMMON) * float(np.sum(np.square(self.whiten(self.rates[0]))))

    @property
    def strain(self) -> float:
        """Gyro against attitude as read, without the gyro's bias: rms [rad/s]."""
        off = (self.gyro(0.0) - self.rates[0])[self._kept]
        return float(np.sqrt(np.mean(np.square(off - off.mean(axis=0)))))

    def factor(self, lags: Array) -> tuple[float, float, float]:
        """By what the gyro's values must be multiplied to follow the attitude, how many sigmas
        their correlation is, and how large it is between the motions beneath the noise.

        Free of axes and direction: of the reading that correlates best.
        """
        turned = [self.whiten(rate) for rate in self.rates]
        axes = signed_permutations(3)
        sigmas, factor, alike = 0.0, 1.0, 0.0
        count = 3.0 * self.grid.count
        own_noise = count * noise_power(self._angle_noise, self._rate_noise)
        for lag in lags:
            gyro = self._white_gyro(float(lag))
            power = max(float(np.sum(np.square(gyro))), 1e-300)
            for rate in turned:
                shared = float(np.einsum("sij,ij->s", axes, rate.T @ gyro).max())
                if shared > sigmas * np.sqrt(power):
                    sigmas = shared / np.sqrt(power)
                    factor = shared / max(power - own_noise, 0.05 * power)
                    total = float(np.sum(np.square(rate)))
                    moving = max(power - own_noise, LEAST * power)
                    turning = max(total - (count - own_noise), LEAST * total)
                    alike = shared / np.sqrt(moving * turning)
        return factor, sigmas, alike


def least(lags: Array, misfit: Array) -> tuple[Array, Array]:
    """Least of misfits (lags, ...) and where: between evenly spaced lags by the parabola through
    three; at the ends, and across a hole in the lags, at the lag itself."""
    at = np.argmin(misfit, axis=0)
    inner = np.clip(at, 1, len(lags) - 2)
    low, mid, high = (np.take_along_axis(misfit, (inner + k)[None], axis=0)[0] for k in (-1, 0, 1))
    before, after = lags[inner] - lags[inner - 1], lags[inner + 1] - lags[inner]
    even = (at == inner) & np.isclose(before, after)
    bend = np.where(even, low - 2.0 * mid + high, 1.0)
    bend = np.where(bend > 0.0, bend, np.inf)
    share = np.where(even, np.clip(0.5 * (low - high) / bend, -0.5, 0.5), 0.0)
    value = np.take_along_axis(misfit, at[None], axis=0)[0] - 0.25 * (low - high) * share * even
    return value, lags[at] + share * before


def vector_axes(attitude: Array) -> tuple[int, Array]:
    """What a quaternion read as A q does to body rates: (0, S), rate = S rate_body, or (1, S),
    rate = S rate_world, of the quaternion as read.

    rate = 2 vec((A q)* (A dq/dt)), taken at q = 1, where body and world are one.
    """
    start = rotation.conjugate(attitude[:, 0])
    axes = rotation.multiply(start, attitude.T[1:])[:, 1:].T
    return int(np.linalg.det(attitude) < 0.0), axes


def turning_of(recording: Recording) -> Turning | None:
    """None without gyro and attitude, or with too little of them."""
    if "gyro" not in recording or recording["gyro"].columns != ("x", "y", "z"):
        return None
    grid = grid_of(recording, "gyro", "attitude")
    return Turning(recording, grid) if grid is not None else None


def no_common_motion(recording: Recording, turning: Turning) -> ConventionFinding | None:
    """What to say where no reading of gyro and attitude fits; None where one may.

    Either the gyro turns throughout and the attitude does not, or both move clearly, and together
    at no lag, in no axes and in no direction.
    """
    spin, turn = _mean_rates(recording, turning)
    if max(spin, turn) / recording["attitude"].rate < AMBIGUOUS and abs(spin - turn) > SPINNING:
        means = f"{np.degrees(spin):.0f} and {np.degrees(turn):.0f} deg/s"
        return no_fit("gyro", f"gyro and attitude fits: they turn at {means} in the mean")
    fastest = float(np.linalg.norm(turning.gyro(0.0), axis=1).max())
    if fastest * turning.grid.cell > AMBIGUOUS:
        grid = grid_of(recording, "gyro", "attitude", narrowest=AMBIGUOUS / fastest)
        if grid is None or fastest * grid.cell > 1.001 * AMBIGUOUS:
            return None
        turning = Turning(recording, grid)
    lags = np.concatenate([NEAR, far_lags(turning.grid.longest_lag)])
    for tried in (NEAR[::5], lags):
        shared = turning.correlation(tried, askew=True)
        if shared is None or shared > TOGETHER:
            return None
    for change, series in read_angles(recording):
        if change is not None:
            other = turning.with_attitude(series).correlation(lags, askew=True)
            if other is not None and other > TOGETHER:
                return None
    return no_fit("gyro", "gyro and attitude fits: both move, and not together")


def needs_a_bias(recording: Recording, turning: Turning) -> bool:
    """Whether a gyro would follow the attitude only beside a constant much larger than the motion:
    what it shows is not the motion in another unit."""
    spin, turn = _mean_rates(recording, turning)
    moving = float(np.sqrt(np.sum(np.var(turning.gyro(0.0), axis=0))))
    return abs(spin - turn) > max(BIASED, OUTDONE * moving)


def _mean_rates(recording: Recording, turning: Turning) -> tuple[float, float]:
    """Length of the mean rate [rad/s] of the gyro, and of the attitude: of body or world axes,
    whichever is nearer."""
    edges = turning.grid.edges
    attitude = recording["attitude"].between(float(edges[0]), float(edges[-1]))
    q, duration = attitude.value, float(attitude.time[-1] - attitude.time[0])
    step = rotation.to_rotation_vector(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]))
    spin = float(np.linalg.norm(turning.gyro(0.0).mean(axis=0)))
    turns = [
        float(np.linalg.norm(steps.sum(axis=0))) / duration
        for steps in (step, rotation.rotate(q[:-1], step))
    ]
    return spin, min(turns, key=lambda turn: abs(turn - spin))


def _summed(values: Array, block: int) -> Array:
    """Sums over so many rows each, without the rest."""
    count = len(values) // block
    return values[: count * block].reshape(count, block, -1).sum(axis=1)


def _rates(attitude: Means, grid: CellGrid) -> tuple[Array, Array]:
    return attitude_rates(rotation.normalized(attitude.over(grid.around_edges) + 1e-9), grid.cell)


def noise_power(angle_noise: float, rate_noise: float) -> float:
    """Power of the gyro's own noise behind the whitening filter, a sample."""
    pole = forgetting(angle_noise, rate_noise)
    return (1.0 - pole) ** 2 / (1.0 - pole**2)
