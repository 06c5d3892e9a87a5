"""What is wrong with a gyro, by an attitude that was measured beside it.

The gyro's turns are summed up in world axes, where their error is a random walk, and held against
the attitude by a Kalman filter. Errors of the sensor are columns that go through the same filter;
the innovations are regressed on them, and the gyro corrected, until nothing changes. The errors, as
the effects of these names say it (docs/design.md 4.4):

    shown(t) = (1 + e + s) R(phi)^T w(t - tau) + b

with e on the diagonal and s symmetric off it: axes that are not square to each other, which no
mounting explains.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh, null_space, solve_banded
from scipy.stats import t as student

from twin import rotation
from twin.errors import UsageError
from twin.noise import noise_of
from twin.noise.cleaning import cleaned
from twin.recording import Recording
from twin.shown import Shown

Array = NDArray[np.float64]
PAIRS = ((0, 1), (0, 2), (1, 2))
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
ROUGHER = tuple(2.0**power for power in range(8))
"""How many times rougher than from sample to sample the attitude may be: a camera's errors last."""
ITERATIONS = 5
SMALL = 0.02
"""Of an interval: a step below this changes nothing."""
SHORTEST_BLOCK = 1.0
"""Errors that last less than this are seen in the scatter between blocks [s]."""
BLOCKS = 150
HORIZONS = (1.0, 10.0, 60.0)
"""Over which a gyro alone is let run [s]."""
SPACINGS = (0.0, 0.02, 0.04, 0.08, 0.16, 0.32)
"""Attitudes are taken no closer than this, the first that leaves what is expected [s]."""
EXPECTED = 1.5
"""Innovations this much larger than the noise from sample to sample gives are not yet white."""
MOVES = 5.0
"""An attitude that turns by so many times its noise moves."""
UNLIKE = 0.5
"""A gyro that strays by this share of the motion itself does not show it."""
WORSE = 1.1
"""A corrected gyro that strays by this many times as far as the raw one is not corrected."""
HIDDEN = 0.01
"""Squared part of a parameter that may lie along directions that no turn shows."""
FEWEST = 100
"""Turns without which nothing is said."""
_STREAMS = ("gyro", "attitude")


@dataclass(frozen=True)
class GyroError:
    """Some of the numbers of a gyro's error."""

    name: str
    unit: str
    columns: tuple[str, ...]
    words: str


FAULTS = (
    GyroError("gyro_bias", "rad/s", ("x", "y", "z"), "it shows too much by"),
    GyroError(
        "gyro_scale_factor", "1", ("x", "y", "z"), "it shows too much in proportion to the rate"
    ),
    GyroError(
        "gyro_misalignment", "rad", ("x", "y", "z"), "its axes are turned from the attitude's by"
    ),
    GyroError("gyro_axes_not_square", "rad", ("xy", "xz", "yz"), "its axes are not square by"),
    GyroError("clock_lag", "s", ("",), "it is late by"),
)


NAMES = tuple((fault, column) for fault in FAULTS for column in fault.columns)
"""Of every parameter, in order."""


def corrected(time: Array, shown: Array, theta: Array) -> tuple[Array, Array]:
    """Times and rates (m, 3) of the body, of a gyro with these errors (13,)."""
    bias, scale, turn, skew, lag = np.split(theta, [3, 6, 9, 12])
    gain = np.diag(1.0 + scale)
    for (i, j), value in zip(PAIRS, skew, strict=True):
        gain[i, j] = gain[j, i] = value
    body_from_gyro = rotation.matrix(rotation.from_rotation_vector(turn)) @ np.linalg.inv(gain)
    return time - lag[0], (shown - bias) @ body_from_gyro.T


def columns(rate: Array, acceleration: Array) -> Array:
    """(m, 3, 13) by how much more is shown a parameter, at body rates (m, 3)."""
    shown = np.zeros((len(rate), 3, len(NAMES)))
    shown[:, :, 0:3] = np.eye(3)
    x, y, z = rate.T
    zero = np.zeros_like(x)
    for axis in range(3):
        shown[:, axis, 3 + axis] = rate[:, axis]
    cross = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]  # w x phi
    shown[:, :, 6:9] = np.moveaxis(np.array(cross), 2, 0)
    for place, (i, j) in enumerate(PAIRS):
        shown[:, i, 9 + place] = rate[:, j]
        shown[:, j, 9 + place] = rate[:, i]
    shown[:, :, 12] = -acceleration
    return shown


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


@dataclass(frozen=True)
class GyroComparison(Shown):
    """A gyro's errors, in the order of `faults.NAMES`, and what they cost."""

    value: Array
    """(13,) SI."""
    half_width: Array
    """(13,) of 95 % intervals; infinite where the motion does not show it."""
    gyro_noise: float
    """1 sigma a sample [rad/s]."""
    attitude_noise: float
    """1 sigma a sample, of what lasts [rad]."""
    chi2_before: float
    """Squared innovations a sample of the gyro as it is, in units of what the corrected one
    leaves."""
    drift: tuple[tuple[float, float, float], ...]
    """(horizon [s], rms error of the gyro as it is, of the corrected one [rad])."""

    @property
    def certain(self) -> NDArray[np.bool_]:
        """(13,) whose interval leaves out 0."""
        return np.abs(self.value) > self.half_width


def compare_gyro(recording: Recording) -> GyroComparison:
    """Hold the gyro against the attitude.

    Raises:
        UsageError: without a gyro about three axes and an attitude beside it, or where the two do
            not show the same motion.
    """
    if any(name not in recording for name in ("gyro", "attitude")) or (
        recording["gyro"].columns != ("x", "y", "z")
    ):
        raise UsageError("the log has no gyro about x, y and z beside an attitude; nothing to hold")
    recording = cleaned(recording)
    if "gyro" not in recording:
        raise UsageError(f"{recording.repairs[-1]}; nothing to hold")
    gyro_noise, attitude_noise = (
        float(np.sqrt(np.mean(np.square(noise_of(recording[name]))))) for name in _STREAMS
    )
    result: _Solution | None = None
    for spacing in SPACINGS:
        turns = turns_of(recording, gyro_noise, spacing)
        if len(turns.time) <= FEWEST:
            break
        result = _solve(turns, attitude_noise)
        if result.unit < EXPECTED**2:
            break
    if result is None:
        raise UsageError(f"gyro and attitude share fewer than {FEWEST} attitudes; log longer")
    fit, unit = result.fit, result.unit
    unit_noise = fit.attitude_noise * float(np.sqrt(unit))
    drift = tuple(_drift(result.turns, result.theta))
    for horizon, raw, mended in drift[:1]:
        turned = _turned(result.turns, horizon)
        moves = turned > MOVES * attitude_noise
        if moves and mended > min(UNLIKE * turned, WORSE * max(raw, attitude_noise)):
            raise UsageError(
                f"gyro and attitude do not show the same motion: in {horizon:g} s the attitude "
                f"turns by {np.degrees(turned):.3g} deg rms, and the gyro strays from it by "
                f"{np.degrees(mended):.3g} deg with the errors that fit best and by "
                f"{np.degrees(raw):.3g} deg as it was read; `twin show` says how each stream "
                "reads: look at their columns, units and clocks in log.toml"
            )
    before = _filtered(result.turns, result.raw.errors[:, :, None], fit.attitude_noise)[0]
    return GyroComparison(
        value=result.theta,
        half_width=_half_width(result.turns, fit),
        gyro_noise=gyro_noise * float(np.sqrt(unit)),
        attitude_noise=unit_noise,
        chi2_before=float(np.mean(np.square(before))) / unit,
        drift=drift,
    )


@dataclass(frozen=True)
class _Solution:
    turns: Turns
    theta: Array
    raw: "_Fit"
    """The first regression, of the gyro as it is."""
    fit: "_Fit"
    """The last."""

    @property
    def unit(self) -> float:
        """Squared innovations a sample, in units of the noise from sample to sample."""
        return float(np.mean(np.square(self.fit.after)))


def _solve(turns: Turns, attitude_noise: float) -> _Solution:
    theta = np.zeros(len(NAMES))
    raw = fit = _likeliest(turns, theta, attitude_noise, ROUGHER)
    for _ in range(ITERATIONS):
        theta = theta + fit.step
        fit = _likeliest(turns, theta, attitude_noise, ROUGHER)
        variance = np.diag(fit.shown @ fit.inverse @ fit.shown.T)
        if (np.square(fit.step) <= np.square(SMALL) * variance).all():
            break
    return _Solution(turns, theta + fit.step, raw, fit)


def _likeliest(
    turns: Turns, theta: Array, attitude_noise: float, rougher: Sequence[float]
) -> "_Fit":
    errors, columns = turns.errors(theta), turns.columns(theta)
    shown = turns.shown(theta)
    tried = [_Fit.of(turns, errors, columns, shown, factor * attitude_noise) for factor in rougher]
    return max(tried, key=lambda item: item.likelihood)


@dataclass(frozen=True)
class _Fit:
    """Innovations on columns, both through the filter that a noise of the attitude gives."""

    errors: Array
    """(K, 3) of the turns [rad]."""
    attitude_noise: float
    """[rad]."""
    shown: Array
    """(13, k) directions of the parameters that the turns show, orthonormal."""
    design: Array
    """(K, 3, k) along these."""
    inverse: Array
    """(k, k) of the normal matrix."""
    step: Array
    """(13,)."""
    after: Array
    """(K, 3) innovations without what the columns explain."""
    likelihood: float
    """Its logarithm, at the best size of all noise together."""

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """(13,) parameters of which a part shows in no turn."""
        return np.sum(np.square(self.shown), axis=1) < 1.0 - HIDDEN

    @classmethod
    def of(
        cls, turns: Turns, errors: Array, columns: Array, shown: Array, attitude_noise: float
    ) -> "_Fit":
        both = np.concatenate([errors[:, :, None], columns @ shown], axis=2)
        white, spread = _filtered(turns, both, attitude_noise)
        residual, design = white[:, :, 0], white[:, :, 1:]
        flat = design.reshape(-1, design.shape[2])
        normal = flat.T @ flat
        size = np.sqrt(np.diag(normal))
        scale = np.outer(size, size)
        inverse = np.linalg.pinv(normal / scale, hermitian=True) / scale
        # of the restricted likelihood: what the columns take up is no noise
        taken = float(np.linalg.slogdet(normal)[1])
        step = inverse @ (flat.T @ residual.ravel())
        after = residual - design @ step
        free = after.size - len(step)
        size_of_noise = np.log(np.sum(np.square(after)) / free)
        likelihood = -0.5 * free * size_of_noise - spread - 0.5 * taken
        return cls(
            errors, attitude_noise, shown, design, inverse, shown @ step, after, float(likelihood)
        )


def _filtered(turns: Turns, both: Array, attitude_noise: float) -> tuple[Array, float]:
    """(K, 3, ...) sums of these through the filter, in units of their noise; and half the logarithm
    of its determinant."""
    rate = 1.0 / float(np.median(np.diff(turns.gyro_time)))
    walk = np.square(turns.gyro_noise) / rate * turns.lasts
    known = float(np.square(attitude_noise))
    lost = turns.lasts > LONGEST
    spread, kept = np.empty(len(both)), np.empty(len(both))
    variance = known
    for k, grown in enumerate(walk.tolist()):
        spread[k] = variance + grown + known
        kept[k] = known / spread[k]
        variance = (1.0 - kept[k]) * known
        if lost[k]:
            variance, kept[k] = known, 0.0
    # innovation[k] = both[k] + kept[k - 1] innovation[k - 1]
    bands = np.stack([np.ones(len(both)), -kept])
    flat = np.where(lost[:, None], 0.0, both.reshape(len(both), -1))
    innovations = solve_banded((1, 0), bands, flat).reshape(both.shape)
    innovations[lost] = 0.0
    white = innovations / np.sqrt(spread).reshape(-1, *[1] * (both.ndim - 1))
    return white, 1.5 * float(np.sum(np.log(spread[~lost])))


def _half_width(turns: Turns, fit: _Fit) -> Array:
    """Of 95 % intervals: by the innovations' size, or by the scatter of the gradient from block to
    block where that is wider, which it is where they are not white."""
    after, design, inverse = fit.after, fit.design, fit.inverse
    parameters = design.shape[2]
    plain = inverse * np.sum(np.square(after)) / (after.size - parameters)
    factor, variance = 1.96, np.diag(fit.shown @ plain @ fit.shown.T)
    length = float(turns.time[-1] - turns.time[0])
    blocks = int(min(BLOCKS, length / SHORTEST_BLOCK))
    if blocks >= 3 * parameters:
        since = (turns.time[1:] - turns.time[0]) / length
        each = np.minimum((since * blocks).astype(int), blocks - 1)
        scores = np.zeros((blocks, parameters))
        np.add.at(scores, each, np.einsum("kip,ki->kp", design, after))
        sandwich = inverse @ (scores.T @ scores) @ inverse * blocks / (blocks - parameters)
        variance = np.maximum(variance, np.diag(fit.shown @ sandwich @ fit.shown.T))
        factor = float(student.ppf(0.975, blocks - parameters))
    return np.where(fit.unknown, np.inf, factor * np.sqrt(variance))


def _turned(turns: Turns, horizon: float) -> float:
    """By how much the attitude turns within a time [s], rms [rad]."""
    last = np.searchsorted(turns.time, turns.time + horizon)
    first = np.flatnonzero(last < len(turns.time))
    turn = rotation.multiply(rotation.conjugate(turns.attitude[first]), turns.attitude[last[first]])
    return float(np.sqrt(np.mean(np.sum(np.square(rotation.to_rotation_vector(turn)), axis=1))))


def _drift(turns: Turns, theta: Array) -> Iterator[tuple[float, float, float]]:
    """Errors of the raw and of the corrected gyro alone, from every attitude on."""
    chains = [chained(turns.by_gyro(given)) for given in (np.zeros_like(theta), theta)]
    length = float(turns.time[-1] - turns.time[0])
    for horizon in HORIZONS:
        if 2.0 * horizon > length + 1.0:
            return
        last = np.searchsorted(turns.time, turns.time + horizon)
        first = np.flatnonzero(last < len(turns.time))
        last = last[first]
        turned = rotation.multiply(rotation.conjugate(turns.attitude[first]), turns.attitude[last])
        rms: list[float] = []
        for chain in chains:
            alone = rotation.multiply(rotation.conjugate(chain[first]), chain[last])
            off = rotation.to_rotation_vector(rotation.multiply(rotation.conjugate(alone), turned))
            rms.append(float(np.sqrt(np.mean(np.sum(np.square(off), axis=1)))))
        yield horizon, rms[0], rms[1]
