"""Attitude and gyro bias from gyro and attitude sensor: a multiplicative Kalman filter in batches.

Inside, samples stand first and runs last but for components, and the covariance is (6, 6, n):
every operation then works on whole runs, and gives a run the same bits in any company.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.estimators.estimator import (
    Agility,
    Estimator,
    accepted_rates,
    agility_of,
    blank,
    encoders,
    instead,
    newest,
    ready_runs,
    scatter_of,
    shared,
    still_awaited,
    variance_of,
)
from twin.platform import Platform
from twin.rotation import (
    conjugate,
    cross,
    from_rotation_vector,
    matrix,
    multiply,
    normalized,
    to_rotation_vector,
)
from twin.signals import Estimate, Mask, Reading, Samples

Array = NDArray[np.float64]


class AttitudeFilterNoise(NamedTuple):
    """Variances of the two sensors and of the walking bias."""

    gyro: Array
    """Of a sample, (3,) [rad^2/s^2]."""
    attitude: Array
    """Of a sample, (3,) [rad^2], about the body axes."""
    bias_walk: float
    """What a second adds to the bias's [rad^2/s^2]."""


@dataclass(slots=True, kw_only=True)
class FilterEstimate(Estimate):
    """The estimate at the tick, and the filter's state at the newest gyro sample."""

    noise: AttitudeFilterNoise
    gyro: Array
    """(n, 3) newest sample, bias included [rad/s]."""
    gyro_time: Array
    """(n,) when it was true [s]; NaN before the first."""
    shown: Array
    """(n, 3) newest gyro sample, refused or not; NaN before the first."""
    refused: Array
    """(n,) gyro samples that were refused."""
    agility: Agility
    """Of the machine."""
    attitude_then: Array
    """(n, 4) attitude at that time."""


@dataclass(frozen=True)
class AttitudeFilter(Estimator):
    """Multiplicative extended Kalman filter of attitude and gyro bias.

    Error state x = (d_theta, d_b): q = q^ exp(d_theta), b = b^ + d_b, both in body axes.

    Gyro samples w_k, joined by straight lines and freed of the bias, turn the attitude by
        phi = sum a_k + 1/2 sum_{j<k} a_j x a_k,   a_k = (w_{k-1} + w_k - 2 b^) dt_k / 2
    and the error by F = [[Phi, -Psi], [0, I]], Phi = R(phi)^T, Psi = (I + Phi) T / 2, with
        Q = diag(sigma_g^2 sum dt_k^2, sigma_u^2 T).
    The attitude samples of a tick enter as one, their mean, each carried from its own time to the
    state's along the gyro's turn. It measures d_theta + L d_b with variance sigma_a^2 / count, L
    their mean age, and knows nothing of the gyro's noise since: that part of Q is added after it.

    - The rate is the mean since the last tick, without the bias: half a tick old, but with five
      samples a tick it has less than half the noise that a derivative gain passes to actuators.
    - The covariance is propagated and corrected once a tick, one axis of the mean after the other.
    - Late samples: the state stands at the newest gyro sample, and the estimate is carried on to
      the tick at the last rate. An attitude sample from before the first of the tick's gyro
      samples, or from after the newest, is carried at that one's rate; where it changes, this errs.
    - A lone gyro sample beyond what the machine's own actuators and weight can do to its rate is
      bridged like a lost one.
    - Lost samples: a gap in the gyro is bridged by a straight line; what is not valid does not
      count, run by run. The covariance does not grow while the gyro is silent.
    - A constant misalignment of the attitude sensor cannot be seen, nor is it in the covariance.
    - Noise, resolution (as r^2 / 12) and bias are those that platform.toml states.

    Source: E. J. Lefferts, F. L. Markley, M. D. Shuster, Kalman filtering for spacecraft attitude
    estimation, J. Guidance 5(5), 1982; the noise of gyro and bias after R. L. Farrenkopf, 1978.
    """

    bias_walk: float = field(default=1e-6, metadata={"unit": "rad/s^1.5"})
    """sigma_u: how far the bias wanders in a second; without it, it would be trusted for good."""

    def init(self, platform: Platform, n: int) -> FilterEstimate:
        """Level and at rest, not valid; attitude unknown, bias within what the gyro's states."""
        missing = [name for name in ("gyro", "attitude") if name not in platform.sensors]
        if missing:
            raise UsageError(
                f"the attitude filter needs gyro and attitude, and {platform.name} has no "
                f"{' and no '.join(missing)}; {instead(platform)}"
            )
        gyro, attitude = platform.sensors["gyro"], platform.sensors["attitude"]
        covariance = np.zeros((6, 6, n))
        covariance[range(3), range(3)] = np.pi**2
        covariance[range(3, 6), range(3, 6)] = gyro.bias[:, None] ** 2
        start = replace(blank(platform, n), covariance=covariance.transpose(2, 0, 1))
        return FilterEstimate(
            **shared(start),
            noise=AttitudeFilterNoise(variance_of(gyro), variance_of(attitude), self.bias_walk**2),
            gyro=np.zeros((n, 3)),
            gyro_time=np.full(n, np.nan),
            shown=np.full((n, 3), np.nan),
            refused=np.zeros(n),
            agility=agility_of(platform),
            attitude_then=start.attitude,
        )

    def remarks(self, estimate: Estimate) -> list[str]:
        """How many gyro samples were bridged."""
        count = int(cast(FilterEstimate, estimate).refused.sum())
        return [f"{count} lone gyro samples were bridged"] if count else []

    def update(self, estimate: Estimate, reading: Reading) -> FilterEstimate:
        """Valid from a run's first attitude sample and positions; it filters from the former."""
        before, streams = cast(FilterEstimate, estimate), reading.streams
        bias, oriented, noise = before.gyro_bias, before.oriented, before.noise

        measured, shown = _believed(before, streams.get("gyro"))
        gyro, times = _joined(before, measured, reading.time)
        rates = gyro - bias
        steps = times[1:] - times[:-1]
        angles = (0.5 * steps)[..., None] * (rates[1:] + rates[:-1])
        total, span = angles.sum(axis=0), steps.sum(axis=0)
        coning = 0.5 * cross(np.cumsum(angles[:-1], axis=0), angles[1:]).sum(axis=0)
        turn = from_rotation_vector(total + coning)
        attitude = multiply(before.attitude_then, turn)
        covariance = cast(Array, before.covariance).transpose(1, 2, 0)
        covariance = _turned(covariance, turn, span, noise)
        squares = steps * steps
        gyro_noise = noise.gyro[:, None] * squares.sum(axis=0)

        fixes = streams.get("attitude")
        if fixes is None:
            _diagonal(covariance)[:3] += gyro_noise
        else:
            if not oriented.all():
                first = normalized(newest(fixes, attitude))
                attitude = np.where(oriented[:, None], attitude, first)
                oriented = oriented | fixes.valid.any(axis=1)
            fix = _mean(fixes, attitude, times, angles, rates, noise)
            since = noise.gyro[:, None] * (fix.after * squares).sum(axis=0)
            _diagonal(covariance)[:3] += gyro_noise - since
            step, covariance = _corrected(covariance, fix)
            _diagonal(covariance)[:3] += since
            attitude = multiply(attitude, from_rotation_vector(step[:3].T))
            bias = bias + step[3:].T

        now, lead = attitude, reading.time - times[-1]
        lead = np.where(np.abs(lead) > 1e-9, lead, 0.0)
        if lead.any():
            now = multiply(attitude, from_rotation_vector((gyro[-1] - bias) * lead[:, None]))
        rate = gyro[-1] - before.gyro_bias
        np.divide(total, span[:, None], out=rate, where=span[:, None] > 0.0)
        awaited = still_awaited(streams, before)
        return replace(
            before,
            time=reading.time,
            attitude=now,
            rate_body=rate + (before.gyro_bias - bias),
            **encoders(streams, before),
            gyro_bias=bias,
            valid=ready_runs(oriented, awaited),
            oriented=oriented,
            awaited=awaited,
            covariance=covariance.transpose(2, 0, 1),
            gyro=gyro[-1],
            gyro_time=times[-1],
            shown=shown,
            refused=before.refused + _lost(streams.get("gyro"), measured),
            attitude_then=attitude,
        )


def _believed(before: FilterEstimate, gyro: Samples | None) -> tuple[Samples | None, Array]:
    """The samples without lone spikes, and the newest as it came."""
    if gyro is None:
        return None, before.shown
    variance, agility = before.noise.gyro, before.agility
    # nearly all ticks: no sample is farther from the one before than a machine at rest could get
    if gyro.valid.all():
        rates = np.concatenate([before.gyro[:, None], gyro.value], axis=1)
        steps = np.diff(gyro.time, axis=1, prepend=before.gyro_time[:, None])
        margin = agility.at_rest * np.maximum(steps, 0.0)[..., None] + scatter_of(variance)
        if (np.abs(np.diff(rates, axis=1)) <= margin).all():
            return gyro, gyro.value[:, -1]
    held, shown, when = before.gyro, before.shown, before.gyro_time
    valid: Mask | None = None
    for k in range(gyro.time.shape[1]):
        value, here = gyro.value[:, k], gyro.valid[:, k]
        step = gyro.time[:, k] - when
        kept = here & accepted_rates(value, held, shown, step, variance, agility)
        if not np.array_equal(kept, here):
            valid = gyro.valid.copy() if valid is None else valid
            valid[:, k] = kept
        if kept.all():
            held = shown = value
            when = gyro.time[:, k]
        else:
            held = np.where(kept[:, None], value, held)
            shown = np.where(here[:, None], value, shown)
            when = np.where(kept, gyro.time[:, k], when)
    return (gyro if valid is None else Samples(gyro.value, gyro.time, valid)), shown


def _lost(came: Samples | None, used: Samples | None) -> Array | float:
    if came is None or used is None or came is used:
        return 0.0
    return (came.valid & ~used.valid).sum(axis=1).astype(np.float64)


class _Fix(NamedTuple):
    """The mean of a tick's attitude samples, carried to the state's time."""

    error: Array
    """Rotation vector from the state, (n, 3) [rad]."""
    variance: Array
    """(3, n) or (3, 1) [rad^2]; infinite where there was none."""
    age: Array
    """Mean, (n,) [s]."""
    after: Array
    """Share of each gyro step that lies after the samples, (steps, n)."""


def _joined(before: FilterEstimate, gyro: Samples | None, time: float) -> tuple[Array, Array]:
    """The last gyro sample and the new ones, (1 + m, n, 3), and their times (1 + m, n).

    A lost sample repeats the one before it, time included, and so adds no turn. In a run that has
    no attitude yet all stand at the newest: its state begins there.
    """
    m = 0 if gyro is None else gyro.time.shape[1]
    n = len(before.oriented)
    rates, times = np.empty((1 + m, n, 3)), np.empty((1 + m, n))
    rates[0], times[0] = before.gyro, before.gyro_time
    if gyro is not None:
        rates[1:], times[1:] = gyro.value.swapaxes(0, 1), gyro.time.T
        if not gyro.valid.all():
            kept = np.zeros((1 + m, n), dtype=np.intp)
            kept[1:] = np.where(gyro.valid.T, np.arange(1, 1 + m)[:, None], 0)
            kept = np.maximum.accumulate(kept, axis=0)
            rates = np.take_along_axis(rates, kept[..., None], axis=0)
            times = np.take_along_axis(times, kept, axis=0)
    if not before.oriented.all():
        start = np.where(np.isnan(times[-1]), time, times[-1])
        times = np.where(before.oriented, times, start)
        rates = np.where(before.oriented[:, None], rates, rates[-1])
    return rates, times


def _mean(
    fixes: Samples,
    attitude: Array,
    times: Array,
    angles: Array,
    rates: Array,
    noise: AttitudeFilterNoise,
) -> _Fix:
    """The normalised sum of the quaternions, all taken on the state's side, as a fix."""
    value, when, valid = fixes.value.swapaxes(0, 1), fixes.time.T, fixes.valid.T
    side = np.copysign(1.0, np.einsum("ni,mni->mn", attitude, value))
    value = side[..., None] * value
    age = times[-1] - when
    # A step of no length turns by nothing, however it is shared.
    steps = np.maximum(times[1:] - times[:-1], 1e-12)
    after = np.minimum(np.maximum((times[1:, None] - when) / steps[:, None], 0.0), 1.0)
    if valid.all():
        share, variance = 1.0 / len(valid), noise.attitude[:, None] / len(valid)
    else:
        count = valid.sum(axis=0)
        share = 1.0 / np.maximum(count, 1)
        with np.errstate(divide="ignore"):
            variance = noise.attitude[:, None] / count
        value = np.where(valid[..., None], value, 0.0)
        age, after = np.where(valid, age, 0.0), np.where(valid, after, 0.0)
    after = share * after.sum(axis=1)
    carried = (after[..., None] * angles).sum(axis=0)
    early, ahead = age - (times[-1] - times[0]), -age
    if (early > 0.0).any() or (ahead > 0.0).any():
        carried += (share * np.maximum(early, 0.0).sum(axis=0))[:, None] * rates[0]
        carried -= (share * np.maximum(ahead, 0.0).sum(axis=0))[:, None] * rates[-1]
    mean = multiply(conjugate(attitude), value.sum(axis=0))
    return _Fix(to_rotation_vector(mean) + carried, variance, share * age.sum(axis=0), after)


def _turned(covariance: Array, turn: Array, span: Array, noise: AttitudeFilterNoise) -> Array:
    """F P F^T, with what the bias walked."""
    upper = np.empty((3, 6, len(span)))
    upper[:, :3] = matrix(turn).transpose(2, 1, 0)
    upper[:, 3:] = upper[:, :3]
    upper.reshape(18, -1)[3::7] += 1.0
    upper[:, 3:] *= -0.5 * span
    moved = np.einsum("ijn,jkn->ikn", upper, covariance)
    out = covariance.copy()
    out[:3, :3] = np.einsum("ijn,kjn->ikn", moved, upper)
    out[:3, 3:] = moved[:, 3:]
    out[3:, :3] = moved[:, 3:].transpose(1, 0, 2)
    _diagonal(out)[3:] += noise.bias_walk * span
    return out


def _corrected(covariance: Array, fix: _Fix) -> tuple[Array, Array]:
    """Correction (6, n), and covariance after it; an infinite variance changes nothing."""
    step = np.zeros(covariance.shape[1:])
    for axis in range(3):
        seen = covariance[:, axis] + fix.age * covariance[:, 3 + axis]
        gain = seen / (seen[axis] + fix.age * seen[3 + axis] + fix.variance[axis])
        surprise = fix.error[:, axis] - step[axis] - fix.age * step[3 + axis]
        step = step + gain * surprise
        covariance = covariance - gain[:, None] * seen
    return step, covariance


def _diagonal(covariance: Array) -> Array:
    """The six variances of each run, (6, n), to be changed in place."""
    return covariance.reshape(36, -1)[::7]
