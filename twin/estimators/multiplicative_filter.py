"""Attitude from whatever a machine measures: gyro and gravity, field, inclinometer, camera.

A multiplicative extended Kalman filter in batches, runs first. Its error state stands in the room's
axes, so that what no sensor shows (the heading, where only gravity is measured) stays unknown: in
body axes the small steps of a linearised filter would leak knowledge into it.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from twin.estimators.aids import (
    AIDS,
    UP,
    Aid,
    Known,
    Spin,
    due,
    felt_by_turning,
    first_attitude,
    in_order,
    known_of,
    look,
    off_field,
    shows_heading,
)
from twin.estimators.estimator import (
    Estimator,
    accepted_rates,
    blank,
    encoders,
    ready_runs,
    shared,
    still_awaited,
)
from twin.platform import Platform
from twin.rotation import (
    IDENTITY,
    from_rotation_vector,
    matrix,
    multiply,
    normalized,
    skew,
)
from twin.signals import Estimate, Mask, Quantity, Reading, Samples

Array = NDArray[np.float64]

_EPS = 1e-9
_AGES = 0.5
"""How old a sample may be that is still compared with the attitude of its own time [s]."""
_DEAD = 0.5
"""A magnetometer that shows less or more than the field by this share of it shows another thing."""
_CALM = 0.5
"""How long a field must have been the room's before it is believed again [s]."""
_ODD = 1.5
"""Innovations that scatter so many times as far as they should are no chance."""
_LOST = 10.0
"""Sigma from which on a heading is said to be unseen [deg]."""
_ANYWHERE = np.pi**2 / 3.0
"""Variance of an angle of which nothing is known [rad^2]."""


class _Still(NamedTuple):
    """When a body in a hand lies still, after D. Laidig and T. Seel, VQF, Information Fusion 91,
    2023."""

    rate: float = np.radians(2.0)
    """Farthest from the mean [rad/s]."""
    force: float = 0.5
    """Likewise [m/s^2]."""
    largest: float = np.radians(2.0)
    """Mean rate that may still be a bias [rad/s]."""
    low_pass: float = 0.5
    """Of the means [s]."""
    least: float = 1.5
    """For how long [s]."""
    lasts: float = 10.0
    """How long the gyro's mean at rest stays off by the same [s]."""


_STILL = _Still()


class Stillness(NamedTuple):
    """Whether a body in a hand lies still."""

    rate: Array
    """(n, 3) of the gyro, through a low-pass [rad/s]."""
    force: Array
    """(n, 3) of the accelerometer, likewise [m/s^2]."""
    since: Array
    """(n,) when either last left its own mean [s]."""


@dataclass(slots=True, kw_only=True)
class MultiplicativeEstimate(Estimate):
    """The estimate at the tick, and the filter's state at its newest gyro sample."""

    known: Known
    states: Array
    """(n, size); those of the attitude error are 0."""
    state_covariance: Array
    """(n, size, size) of their errors."""
    field_world: Array
    """(n, 3) what a magnetometer shows of the room [T]."""
    attitude_then: Array
    """(n, 4) at the newest gyro sample."""
    gyro: Array
    """(n, 3) that sample, bias included [rad/s]."""
    gyro_time: Array
    """(n,) when it was true [s]; NaN before the first."""
    turns: tuple[tuple[Array, Array], ...]
    """Latest steps of the gyro, oldest first: length (n,) [s], and mean rate (n, 3), bias
    included."""
    shown: Array
    """(n, 3) newest gyro sample, refused or not."""
    gyro_refused: Array
    """(n,) gyro samples that no other one confirmed."""
    first: dict[str, tuple[Array, Array, Mask]]
    """Newest sample of each aid, when it was true, and whether there is one, of runs that wait for
    their start."""
    waits_since: Array
    """(n,) when a direction was seen first [s]; NaN before it."""
    stillness: "Stillness"
    coming: dict[str, Samples]
    """Samples of after the state's time."""
    aids: dict[str, Aid]

    @property
    def sigma_world(self) -> Array:
        """(n, 3) standard deviation of the attitude about the room's axes [rad]; the third is the
        heading's."""
        return np.sqrt(np.diagonal(self.state_covariance, axis1=1, axis2=2)[:, :3])

    def quantities(self) -> dict[str, Quantity]:
        """How well attitude and gyro bias are known."""
        bias = np.sqrt(np.diagonal(self.state_covariance, axis1=1, axis2=2)[:, 3:6])
        return {
            "attitude": Quantity(None, self.sigma_world, "rad", ("x", "y", "z")),
            "gyro_bias": Quantity(None, bias, "rad/s", ("x", "y", "z")),
        }


@dataclass(frozen=True)
class MultiplicativeFilter(Estimator):
    """Multiplicative extended Kalman filter on the gyro, corrected by all that shows a direction.

    Error state x = (e, d_b, d_s, ...): R = exp(e) R^ with e in the room's axes, b = b^ + d_b the
    gyro's bias, s the biases of the other sensors. Between two gyro samples

        R^ <- R^ exp(phi),  e <- e - C d_b - n,  C = sum R^ dt,  var n = sum R^ S_g R^T dt^2

    What each sensor shows, in body axes but for the last two, and H of its error e:

        accelerometer   f = R^T (g e_z + a) + dw/dt x l + w x (w x l) + s    R^T [g e_z]x
        inclinometer    roll = asin(f_y / g), pitch = -asin(f_x / g), + s    rows of that
        magnetometer    m = R^T (B + d) + s                                  R^T [B]x
        attitude        log(R_m R^T) = e + R s                               I
        position        CR in the room

    l runs from the CR to the sensor's site: on a ball bearing that stands, what the motion adds to
    gravity is known from rate and rate derivative, a = 0. Where the CR moves (on air pads, in a
    hand), a is what the accelerometer shows beside gravity: it is integrated to velocity and place,
    and the place is held by `position`, or else within `reach` of where it was.

    - Each sample is taken at its own time, whatever its rate: the state stands behind the tick by
      the largest latency, and the estimate is carried on to it by the gyro. The mean delay of a
      stated low-pass is taken off the stamps. A sample that comes later still is compared with the
      attitude of its own time, up to 0.5 s ago, and is refused beyond that.
    - Start: the vertical from accelerometer or inclinometer, then the heading from the field (the
      triad), or the attitude as a whole; nothing is valid before. With a field that stands upright,
      or none, the heading counts from the start: it is 0 there, and its sigma grows from 0.
    - Gate: a sample whose squared innovation exceeds `gate` sigmas squared is refused. One that is
      refused for `patience` is believed again, with as much covariance as it takes: either it or
      the rest is wrong, and nobody knows which. A field of another strength, and a sample that
      repeats the last one to the bit where noise is stated, is never believed.
    - A gyro sample beyond what the machine can do to its rate is bridged unless the next confirms
      it.
    - A room whose field is not stated (0) is learnt from the first samples, as the heading's zero.
    - Noise, resolution (as r^2 / 12), bias, latency and low-pass are those of platform.toml.

    Source: F. L. Markley, Attitude error representations for Kalman filtering, J. Guidance 26(2),
    2003; the room's axes: S. Bonnabel, P. Martin, E. Salaun, Invariant extended Kalman filter,
    IEEE CDC 2009; the start: H. D. Black, A passive system for determining the attitude of a
    satellite, AIAA J. 2(7), 1964; the delayed state: A. Khosravian et al., Recursive attitude
    estimation in the presence of multi-rate and multi-delay vector measurements, ACC 2015.
    """

    bias_walk: float | None = field(default=None, metadata={"unit": "rad/s^1.5"})
    """How far the gyro's bias wanders in a second; None: by a thousandth of its stated size, and by
    1e-6 where none is stated."""
    gyro_scale: float = field(default=0.0, metadata={"unit": "1"})
    """1 sigma of each entry of the gyro's scale and misalignment; 0: it is taken as calibrated."""
    gate: float = field(default=30.0, metadata={"unit": "1"})
    """Squared innovation beyond which a sample is refused: one in a million good ones is."""
    patience: float = field(default=5.0, metadata={"unit": "s"})
    """How long a sensor may contradict the others before the estimate gives way."""
    acceleration: float | None = field(default=None, metadata={"unit": "rad/s^2"})
    """Largest change of rate that a lone gyro sample may show; None: what the machine's own
    actuators and weight can do."""
    reach: float = field(default=0.3, metadata={"unit": "m"})
    """1 sigma of where a CR that moves is, about where it usually is."""
    reach_time: float = field(default=0.5, metadata={"unit": "s"})
    """After which it is somewhere else within its reach."""
    rest_rate: float = field(default=0.0, metadata={"unit": "rad/s"})
    """1 sigma by which a gyro that lies still shows another mean than its bias; 0: stillness says
    nothing, for a table may turn evenly."""
    field_disturbance: float = field(default=0.0, metadata={"unit": "T"})
    """1 sigma of how the field differs from the room's at the place where the body is."""
    disturbance_time: float = field(default=5.0, metadata={"unit": "s"})
    """After which that has become another."""

    def init(self, platform: Platform, n: int) -> MultiplicativeEstimate:
        """Level and at rest, not valid; attitude unknown."""
        known = known_of(
            platform,
            acceleration=self.acceleration,
            bias_walk=self.bias_walk,
            scaled=bool(self.gyro_scale),
            disturbed=bool(self.field_disturbance),
        )
        layout = known.layout
        covariance = np.zeros((n, layout.size, layout.size))
        diagonal = covariance.reshape(n, -1)[:, :: layout.size + 1]
        diagonal[:, layout.turn] = _ANYWHERE
        diagonal[:, layout.gyro] = platform.sensors["gyro"].bias ** 2
        diagonal[:, layout.scale] = self.gyro_scale**2
        for name, where in layout.bias.items():
            diagonal[:, where] = known.sensors[name].bias ** 2
        diagonal[:, layout.disturbance] = self.field_disturbance**2
        diagonal[:, layout.velocity] = (self.reach / self.reach_time) ** 2
        diagonal[:, layout.place] = self.reach**2
        start = replace(blank(platform, n), covariance=covariance[:, :6, :6].copy())
        nothing = np.full(n, np.nan)
        return MultiplicativeEstimate(
            **shared(start),
            known=known,
            states=np.zeros((n, layout.size)),
            state_covariance=covariance,
            field_world=np.tile(platform.magnetic_field, (n, 1)),
            attitude_then=start.attitude,
            gyro=np.zeros((n, 3)),
            gyro_time=nothing,
            turns=(),
            shown=np.full((n, 3), np.nan),
            gyro_refused=np.zeros(n),
            first={},
            waits_since=nothing,
            stillness=Stillness(np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)),
            coming={},
            aids={
                name: Aid(
                    taken=np.zeros(n),
                    refused=np.zeros(n),
                    squares=np.zeros(n),
                    since=nothing,
                    last=np.full((n, 4 if name == "attitude" else len(sensor.noise)), np.nan),
                    used=nothing,
                    odd=nothing,
                )
                for name, sensor in known.sensors.items()
            },
        )

    def update(self, estimate: Estimate, reading: Reading) -> MultiplicativeEstimate:
        """Valid from a run's start and first positions."""
        before, streams = cast(MultiplicativeEstimate, estimate), reading.streams
        work = _Filter(self, before)
        until = reading.time - work.known.horizon
        now, coming = due(work.known, before.coming, streams, until)
        for name, place in in_order(now):
            if name == "gyro":
                work.turn(now[name], place)
            else:
                work.correct(name, now[name], place)
        work.begin(reading.time)
        return work.result(reading, coming)

    def remarks(self, estimate: Estimate) -> list[str]:
        """What the sensors showed that the filter could not use, and what no sensor showed."""
        return _remarks(cast(MultiplicativeEstimate, estimate))

    def shows(self, platform: Platform) -> frozenset[str]:
        """Attitude and rate; the heading where a sensor does."""
        return frozenset(("attitude", "rate", *["heading"] * shows_heading(platform)))


class _Filter:
    """The filter's state on its way through the samples of a tick."""

    def __init__(self, rules: MultiplicativeFilter, before: MultiplicativeEstimate) -> None:
        self.rules, self.before, self.known = rules, before, before.known
        n = len(before.oriented)
        self.attitude, self.states = before.attitude_then, before.states
        self.covariance = before.state_covariance
        self.field, self.started = before.field_world, before.oriented
        self.gyro, self.time, self.shown = before.gyro, before.gyro_time, before.shown
        self.turns, self.gyro_refused = before.turns, before.gyro_refused
        self.first, self.aids = dict(before.first), dict(before.aids)
        self.waits_since = before.waits_since
        self.stillness = before.stillness
        self.total, self.span = np.zeros((n, 3)), np.zeros(n)
        drifts = self.known.layout.drift.stop - self.known.layout.drift.start
        self._coupling = np.zeros((n, 3, drifts))
        self._noise = np.zeros((n, 3, 3))
        self._walked = np.zeros(n)
        self._even = bool(np.ptp(self.known.gyro_variance) == 0.0)

    def rate(self, shown: Array) -> Array:
        """(n, 3) of the body where the gyro shows (n, 3) [rad/s]."""
        layout = self.known.layout
        rate = shown - self.states[:, layout.gyro]
        if layout.scale.stop > layout.scale.start:
            error = self.states[:, layout.scale].reshape(-1, 3, 3)
            rate = rate - np.einsum("nij,nj->ni", error, shown)
        return rate

    def _wrongly(self, step: Array, turned: Array, shown: Array) -> Array:
        """(n, 3, drifts) by which errors of bias and scale turn the attitude in a step, room."""
        by_bias = step[:, None, None] * turned
        layout = self.known.layout
        if layout.scale.stop == layout.scale.start:
            return by_bias
        by_scale = by_bias[:, :, :, None] * shown[:, None, None, :]
        return np.concatenate([by_bias, by_scale.reshape(-1, 3, 9)], axis=2)

    def turn(self, samples: Samples, place: int) -> None:
        """Turn the attitude by a gyro sample, joined to the last by a straight line."""
        value, stamp = samples.value[:, place], samples.time[:, place]
        finite = samples.valid[:, place] & np.isfinite(value).all(axis=1)
        fresh = finite & np.isnan(self.time)
        step = np.where(finite & ~fresh, stamp - self.time, 0.0)
        kept = accepted_rates(
            value, self.gyro, self.shown, step, self.known.gyro_variance, self.known.agility
        )
        kept = finite & (kept | fresh)
        self.gyro_refused = self.gyro_refused + (finite & ~kept)
        self.shown = np.where(finite[:, None], value, self.shown)
        step = np.where(kept, np.maximum(step, 0.0), 0.0)
        mean = np.where(kept[:, None] & ~fresh[:, None], 0.5 * (self.gyro + value), self.gyro)
        angle = step[:, None] * self.rate(mean)
        self.attitude = multiply(self.attitude, from_rotation_vector(angle))
        self.gyro = np.where(kept[:, None], value, self.gyro)
        self.time = np.where(kept, stamp, self.time)
        self.turns = _latest((*self.turns, (step, mean)))
        self.total, self.span = self.total + angle, self.span + step

        turned, squared = matrix(self.attitude), step * step
        self._coupling = self._coupling + self._wrongly(step, turned, mean)
        # what a straight line misses where samples were lost, at the largest acceleration
        sensor = self.before.known.gyro_variance
        missed = np.where(
            step > 2.5 * self.known.period, self.known.agility.at_rest * squared / 8.0, 0.0
        )
        if self._even:
            self._noise[:, range(3), range(3)] += (sensor[0] * squared)[:, None]
        else:
            spread = (turned * sensor) @ turned.transpose(0, 2, 1)
            self._noise = self._noise + squared[:, None, None] * spread
        self._noise[:, range(3), range(3)] += (missed * missed)[:, None]
        self._walked = self._walked + step

    def correct(self, name: str, samples: Samples, place: int) -> None:
        """Correct by a sample, in the runs that have begun; keep it for the start of the others."""
        value, stamp = samples.value[:, place], samples.time[:, place]
        finite = samples.valid[:, place] & np.isfinite(value).all(axis=1)
        plausible = self._plausible(name, value, finite)
        if not self.started.all():
            held, when, had = self.first.get(name, (value, stamp, np.zeros_like(plausible)))
            self.first[name] = (
                np.where(plausible[:, None], value, held),
                np.where(plausible, stamp, when),
                had | plausible,
            )
            waits = plausible & np.isnan(self.waits_since)
            self.waits_since = np.where(waits, stamp, self.waits_since)
        aid = self.aids[name]
        age = np.where(np.isnan(self.time), 0.0, self.time - stamp)
        used = plausible & self.started & (age <= _AGES)
        self.aids[name] = replace(
            aid,
            refused=aid.refused + (finite & self.started & ~used),
            last=np.where(finite[:, None], value, aid.last),
        )
        self._settle()  # whoever uses the sample: a run has the same bits in any company
        if not used.any():
            return
        value = np.where(used[:, None], value, 0.0)
        if name == "attitude":
            value = np.where(used[:, None], value, IDENTITY)
        then = self._attitude_at(np.where(used, age, 0.0))
        if name == "accelerometer" and self.known.moves:
            self._travel(value, stamp, then, used)
            return
        if name == "magnetometer":
            self._align(value, used)
            then = self._attitude_at(np.where(used, age, 0.0))
        surprise, slope, variance = self._look(name, value, then, age)
        self._gated(name, surprise, slope, variance, used, stamp)

    def begin(self, time: float) -> None:
        """Start the runs that have seen what they wait for; hold the place of those that move."""
        self._settle()
        if not self.started.all():
            self._start(time)
        layout = self.known.layout
        if layout.place.stop > layout.place.start and "position" not in self.known.sensors:
            slope = np.zeros((len(self.started), 3, layout.size))
            slope[:, :, layout.place] = np.eye(3)
            tick = np.maximum(self.span, 1e-3)
            often = 2.0 * self.rules.reach**2 * self.rules.reach_time / tick
            variance = np.maximum(often, self.rules.reach**2)[:, None] * np.ones(3)
            self._update(-self.states[:, layout.place], slope, variance, self.started)
        if self.rules.rest_rate and "accelerometer" in self.known.sensors:
            self._rest(time)

    def result(self, reading: Reading, coming: dict[str, Samples]) -> MultiplicativeEstimate:
        """The estimate, carried on from the state's time to the tick."""
        before, known = self.before, self.known
        now, last, when = self.attitude, self.gyro, self.time
        total, span, squares = self.total, self.span, np.zeros(len(self.span))
        ahead = coming.get("gyro")
        if ahead is not None:
            for k in range(ahead.time.shape[1]):
                value, valid = ahead.value[:, k], ahead.valid[:, k]
                step = np.where(valid & ~np.isnan(when), ahead.time[:, k] - when, 0.0)
                sound = valid & accepted_rates(
                    value, last, last, step, known.gyro_variance, known.agility
                )
                step = np.where(sound, step, 0.0)
                value = np.where(sound[:, None], value, last)
                angle = step[:, None] * self.rate(0.5 * (last + value))
                now = multiply(now, from_rotation_vector(angle))
                total, span, squares = total + angle, span + step, squares + step * step
                last, when = value, np.where(sound, ahead.time[:, k], when)
        lead = np.where(np.isnan(when), 0.0, reading.time - when)
        lead = np.where(np.abs(lead) > _EPS, lead, 0.0)
        if lead.any():
            now = multiply(now, from_rotation_vector(self.rate(last) * lead[:, None]))
            # the one rate that is held has turned the last half step, too
            step = np.zeros_like(lead) if not self.turns else self.turns[-1][0]
            squares = squares + lead * (lead + step)
        rate = self.rate(last)
        if ahead is None:
            np.divide(total, span[:, None], out=rate, where=span[:, None] > 0.0)
        awaited = still_awaited(reading.streams, before)
        return replace(
            before,
            time=reading.time,
            attitude=normalized(now),
            rate_body=rate,
            **encoders(reading.streams, before),
            gyro_bias=self.states[:, known.layout.gyro],
            valid=ready_runs(self.started, awaited),
            oriented=self.started,
            awaited=awaited,
            covariance=self._of_body(now, reading.time, squares),
            states=self.states,
            state_covariance=self.covariance,
            field_world=self.field,
            attitude_then=normalized(self.attitude),
            gyro=self.gyro,
            gyro_time=self.time,
            turns=self.turns,
            shown=self.shown,
            gyro_refused=self.gyro_refused,
            first={} if self.started.all() else self.first,
            waits_since=self.waits_since,
            stillness=self.stillness,
            coming=coming,
            aids=self.aids,
        )

    def _of_body(self, attitude: Array, time: float, squares: Array) -> Array:
        """(n, 6, 6) about the body's axes at the tick, as `Estimate` has it.

        `squares` (n,) are those of the times that each gyro sample since the state's turned [s^2].
        """
        ahead = np.where(np.isnan(self.time), 0.0, np.maximum(time - self.time, 0.0))
        turned = matrix(attitude)
        part = self.covariance[:, :6, :6].copy()
        coupling = ahead[:, None, None] * turned
        part[:, :3] -= coupling @ part[:, 3:6]
        part[:, :, :3] -= part[:, :, 3:6] @ coupling.transpose(0, 2, 1)
        grown = squares[:, None] * self.known.gyro_variance
        back = turned.transpose(0, 2, 1)
        part[:, :3] = back @ part[:, :3]
        part[:, :, :3] = part[:, :, :3] @ turned
        part[:, range(3), range(3)] += grown
        return part

    def _plausible(self, name: str, value: Array, finite: Mask) -> Mask:
        """Whether a sample can be what its sensor is for: in range, not the last one again."""
        sensor = self.known.sensors[name]
        with np.errstate(invalid="ignore"):
            sound = finite & (np.abs(value) < sensor.range).all(axis=1)
            if sensor.noise.any() and not sensor.resolution:
                sound &= (value != self.aids[name].last).any(axis=1)
            size = np.sqrt(np.einsum("ni,ni->n", value, value))
            if name == "attitude":
                sound &= np.abs(size - 1.0) < 0.05
            if name == "magnetometer":
                strength = np.sqrt(np.einsum("ni,ni->n", self.field, self.field))
                sound &= (np.abs(size - strength) < _DEAD * strength) | (strength == 0.0)
        return sound

    def _settle(self) -> None:
        """Bring the covariance up to the attitude's time."""
        if not self._walked.any():
            return
        covariance, coupling = self.covariance.copy(), self._coupling
        drift = self.known.layout.drift
        covariance[:, :3] -= coupling @ covariance[:, drift]
        covariance[:, :, :3] -= covariance[:, :, drift] @ coupling.transpose(0, 2, 1)
        covariance[:, :3, :3] += self._noise
        covariance[:, range(3, 6), range(3, 6)] += (self.known.bias_walk**2 * self._walked)[:, None]
        layout, rules = self.known.layout, self.rules
        if layout.disturbance.stop > layout.disturbance.start:
            where = layout.disturbance
            fades = np.exp(-self._walked / rules.disturbance_time)[:, None]
            self.states = self.states.copy()
            self.states[:, where] *= fades
            covariance[:, where] *= fades[:, :, None]
            covariance[:, :, where] *= fades[:, None, :]
            states = range(where.start, where.stop)
            covariance[:, states, states] += rules.field_disturbance**2 * (1.0 - fades * fades)
        moving = self.started[:, None, None]
        self.covariance = np.where(moving, covariance, self.covariance)
        self._coupling, self._noise = np.zeros_like(coupling), np.zeros_like(self._noise)
        self._walked = np.zeros_like(self._walked)

    def _attitude_at(self, age: Array) -> Array:
        """(n, 4) so long before the state, or after it at the last rate."""
        if not (np.abs(age) > _EPS).any():
            return self.attitude
        back, left = np.minimum(age, 0.0)[:, None] * self.rate(self.gyro), np.maximum(age, 0.0)
        slower = self.gyro
        for step, mean in reversed(self.turns):
            part = np.minimum(left, step)
            share = np.divide(part, step, out=np.zeros_like(part), where=step > 0.0)
            # the rate is straight between two samples: it was `mean` in the middle
            rate = slower + share[:, None] * (mean - slower)
            back = back + part[:, None] * self.rate(rate)
            slower, left = 2.0 * mean - slower, left - part
            if not (left > _EPS).any():
                break
        back = back + left[:, None] * self.rate(slower)
        return multiply(self.attitude, from_rotation_vector(-back))

    def _look(self, name: str, value: Array, then: Array, age: Array) -> tuple[Array, Array, Array]:
        """What a sample shows beyond what was expected (n, m), its slope (n, m, size) and variance
        (n, m)."""
        layout = self.known.layout
        error, slope, variance = look(
            self.known, name, value, then, self.states, self.field, self._spin()
        )
        if (np.abs(age) > _EPS).any() and name != "position":
            # e was less by what the error of the bias has turned since
            drifted = self._wrongly(age, matrix(then), self.gyro)
            slope[:, :, layout.drift] += slope[:, :, :3] @ drifted
        return error, slope, variance

    def _spin(self) -> Spin:
        """Of the last step of the gyro."""
        rate = self.rate(self.gyro)
        if not self.turns:
            return Spin(rate, np.zeros_like(rate), np.zeros((len(rate), 1)))
        step, mean = self.turns[-1]
        apart = np.maximum(step, 1e-4)[:, None]
        change = np.where(step[:, None] > 0.0, 2.0 * (self.gyro - mean) / apart, 0.0)
        return Spin(rate, change, 2.0 * self.known.gyro_variance.max() / (apart * apart))

    def _gated(
        self, name: str, surprise: Array, slope: Array, variance: Array, used: Mask, stamp: Array
    ) -> None:
        """Update where the sample is near enough, or has been contradicted for too long."""
        aid = self.aids[name]
        inverse, _ = self._inverse(slope, variance)
        square = np.einsum("ni,nij,nj->n", surprise, inverse, surprise)
        near = square <= self.rules.gate
        odd = np.where(used & ~near, stamp, aid.odd)
        since = np.where(used & ~near & np.isnan(aid.since), stamp, aid.since)
        with np.errstate(invalid="ignore"):
            overdue = used & ~near & (stamp - since > self.rules.patience)
        if overdue.any():
            # either the sample or all before it is wrong: an error of its size is no surprise
            extra = np.where(overdue, 2.0 * square / self.rules.gate, 1.0)
            self.covariance = self.covariance.copy()
            self.covariance[:, :3] *= np.sqrt(extra)[:, None, None]
            self.covariance[:, :, :3] *= np.sqrt(extra)[:, None, None]
            # of an angle nothing more can be unknown: a heading that nobody sees would grow forever
            own = np.diagonal(self.covariance, axis1=1, axis2=2)[:, :3]
            most = np.sqrt(np.minimum(_ANYWHERE / own, 1.0))
            self.covariance[:, :3] *= most[:, :, None]
            self.covariance[:, :, :3] *= most[:, None, :]
        if name == "magnetometer":
            # what was another field a moment ago may still be a little of it
            with np.errstate(invalid="ignore"):
                near &= ~(stamp - aid.odd < _CALM)
        taken = used & (near | overdue)
        self._update(surprise, slope, variance, taken)
        self.aids[name] = replace(
            aid,
            taken=aid.taken + taken,
            refused=aid.refused + (used & ~taken),
            # one wild sample says nothing of the others
            squares=aid.squares
            + np.where(used, np.minimum(square, self.rules.gate), 0.0) / surprise.shape[1],
            since=np.where(taken, np.nan, since),
            used=np.where(taken, stamp, aid.used),
            odd=odd,
        )

    def _inverse(self, slope: Array, variance: Array) -> tuple[Array, Array]:
        """Inverse of the innovation's covariance (n, m, m), and P H^T (n, size, m)."""
        shared = self.covariance @ slope.transpose(0, 2, 1)
        inner = slope @ shared
        m = variance.shape[1]
        inner[:, range(m), range(m)] += variance
        return np.asarray(np.linalg.inv(inner), dtype=np.float64), shared

    def _update(self, surprise: Array, slope: Array, variance: Array, taken: Mask) -> None:
        inverse, shared = self._inverse(slope, variance)
        gain = shared @ inverse
        step = np.einsum("nij,nj->ni", gain, surprise)
        reduced = self.covariance - gain @ shared.transpose(0, 2, 1)
        reduced = 0.5 * (reduced + reduced.transpose(0, 2, 1))
        step = np.where(taken[:, None], step, 0.0)
        self.covariance = np.where(taken[:, None, None], reduced, self.covariance)
        turned = multiply(from_rotation_vector(step[:, :3]), self.attitude)
        self.attitude = np.where(taken[:, None], turned, self.attitude)
        step[:, :3] = 0.0
        self.states = self.states + step

    def _travel(self, value: Array, stamp: Array, then: Array, used: Mask) -> None:
        """Integrate what an accelerometer shows beside gravity, where the CR moves."""
        layout, known, aid = self.known.layout, self.known, self.aids["accelerometer"]
        step = np.where(used & ~np.isnan(aid.used), stamp - aid.used, 0.0)
        step = np.clip(step, 0.0, 0.1)
        where, turned = layout.bias.get("accelerometer"), matrix(then)
        felt = felt_by_turning(known, "accelerometer", self._spin())
        force = value - felt - (0.0 if where is None else self.states[:, where])
        force = np.einsum("nij,nj->ni", turned, force)
        states, covariance, h = self.states.copy(), self.covariance.copy(), step[:, None]
        states[:, layout.place] += h * states[:, layout.velocity]
        states[:, layout.velocity] += h * (force - known.gravity * UP)
        covariance[:, layout.place] += h[..., None] * covariance[:, layout.velocity]
        covariance[:, :, layout.place] += h[..., None] * covariance[:, :, layout.velocity]
        tip = -step[:, None, None] * skew(force)
        rows = tip @ covariance[:, :3]
        if where is not None:
            rows = rows - step[:, None, None] * (turned @ covariance[:, where])
        covariance[:, layout.velocity] += rows
        columns = covariance[:, :, :3] @ tip.transpose(0, 2, 1)
        if where is not None:
            across = covariance[:, :, where] @ turned.transpose(0, 2, 1)
            columns = columns - step[:, None, None] * across
        covariance[:, :, layout.velocity] += columns
        along = range(layout.velocity.start, layout.velocity.stop)
        covariance[:, along, along] += h * h * known.variance["accelerometer"].max()
        self.states = np.where(used[:, None], states, self.states)
        self.covariance = np.where(used[:, None, None], covariance, self.covariance)
        self.aids["accelerometer"] = replace(
            aid, taken=aid.taken + used, used=np.where(used, stamp, aid.used)
        )

    def _rest(self, time: float) -> None:
        """Take the gyro's mean for its bias where gyro and accelerometer have stayed at theirs."""
        before, force = self.before.stillness, self.aids["accelerometer"].last
        step = time - self.before.time
        share = 1.0 - np.exp(-step / _STILL.low_pass)
        rate_off, force_off = self.gyro - before.rate, force - before.force
        with np.errstate(invalid="ignore"):
            still = (np.abs(rate_off) < _STILL.rate).all(axis=1)
            still &= (np.abs(force_off) < _STILL.force).all(axis=1)
            still &= (np.abs(self.gyro) < _STILL.largest).all(axis=1)
        since = np.where(still, before.since, time)
        mean = before.rate + share * rate_off
        force = np.where(np.isnan(force), before.force, before.force + share * force_off)
        self.stillness = Stillness(mean, force, since)
        resting = self.started & (time - since > _STILL.least)
        if resting.any():
            layout = self.known.layout
            slope = np.zeros((len(mean), 3, layout.size))
            slope[:, :, layout.gyro] = np.eye(3)
            often = max(_STILL.lasts / step, 1.0)  # all of one rest are one look
            variance = np.full((len(mean), 3), self.rules.rest_rate**2 * often)
            self._update(mean - self.states[:, layout.gyro], slope, variance, resting)

    def _align(self, value: Array, used: Mask) -> None:
        """Turn about the vertical to where the field points, in runs that do not know their
        heading."""
        lost = used & (self.covariance[:, 2, 2] > 0.3)
        if lost.any():
            turn = np.where(lost, off_field(self.attitude, value, self.field), 0.0)
            self.attitude = multiply(from_rotation_vector(turn[:, None] * UP), self.attitude)

    def _start(self, time: float) -> None:
        """Attitude from the first samples, and its covariance as they leave it."""
        n = len(self.started)
        nobody = np.zeros(n, dtype=np.bool_)
        has = {name: self.first[name][2] if name in self.first else nobody for name in AIDS}
        vertical = has["accelerometer"] | has["inclinometer"]
        patient = time - np.where(np.isnan(self.waits_since), time, self.waits_since) < _AGES
        waits = np.zeros(n, dtype=np.bool_)
        for name in ("attitude", "magnetometer"):
            if name in self.known.sensors:
                waits |= ~has[name] & patient
        ready = ~self.started & ~np.isnan(self.time)
        ready &= has["attitude"] | (vertical & ~waits)
        if not ready.any():
            return
        attitude, learnt = first_attitude(self.first, self.field, n)
        self.field = np.where(ready[:, None], learnt, self.field)
        self.attitude = np.where(ready[:, None], attitude, self.attitude)
        self.started = self.started | ready
        if not self.known.heading:
            self.covariance = self.covariance.copy()
            self.covariance[ready, 2, 2] = 1e-12
        for name, (value, when, there) in self.first.items():
            if name == "accelerometer" and self.known.moves:
                # what it shows beside gravity is not known yet: as if it were as large as the
                # gravity that tips by a tenth of a radian
                self._level(value, ready & there)
                continue
            used = ready & there
            value = np.where(used[:, None], value, IDENTITY if name == "attitude" else 0.0)
            age = np.clip(np.where(used, self.time - when, 0.0), 0.0, _AGES)
            then = self._attitude_at(age)
            surprise, slope, variance = self._look(name, value, then, age)
            self._update(surprise, slope, variance, used)

    def _level(self, value: Array, used: Mask) -> None:
        layout = self.known.layout
        slope = np.zeros((len(value), 3, layout.size))
        slope[:, :, :3] = skew(np.broadcast_to(self.known.gravity * UP, value.shape))
        where = layout.bias.get("accelerometer")
        if where is not None:
            slope[:, :, where] = matrix(self.attitude)
        self._update(np.zeros_like(value), slope, np.ones_like(value), used)


def _latest(turns: tuple[tuple[Array, Array], ...]) -> tuple[tuple[Array, Array], ...]:
    """Of all steps, the last that span `_AGES` in each run."""
    span = sum(step for step, _ in turns[1:])
    return turns[1:] if len(turns) > 1 and bool(np.all(span >= _AGES)) else turns


def _remarks(estimate: MultiplicativeEstimate) -> list[str]:
    known, running = estimate.known, estimate.oriented
    if not running.any():
        return ["no run saw the vertical: the attitude filter never began"]
    lines: list[str] = []
    if estimate.gyro_refused.any():
        lines.append(f"{estimate.gyro_refused.sum():.0f} lone gyro samples were bridged")
    for name, aid in estimate.aids.items():
        last = np.where(np.isnan(aid.used), 0.0, aid.used)
        silent = running & (estimate.gyro_time - last > 1.0 + 3.0 / known.sensors[name].rate)
        checked = np.maximum(aid.taken + aid.refused, 1.0)
        scatter = np.where(running, np.sqrt(aid.squares / checked), 0.0)
        if silent.any():
            first = int(np.argmax(silent))
            since = "at all" if np.isnan(aid.used[first]) else f"after {last[first]:.1f} s"
            lines.append(f"no sample of {name} could be used {since}{_of(silent)}")
        elif scatter.max() > _ODD:
            lines.append(
                f"what {name} shows scatters {scatter.max():.2g} times as far about the estimate "
                "as its stated noise, bias and delay allow: the estimate is less certain than it "
                "says"
            )
        elif aid.refused.any():
            lines.append(
                f"{aid.refused.sum():.0f} of {(aid.taken + aid.refused).sum():.0f} samples of "
                f"{name} lay beyond the gate and were refused"
            )
    heading = float(np.degrees(estimate.sigma_world[running, 2].max()))
    if not known.heading:
        lines.append(
            "no sensor shows the heading: it counts from the start, is carried by the gyro, and "
            f"its sigma has grown to {heading:.2g} deg"
        )
    elif heading > _LOST:
        lines.append(f"the heading is known to {heading:.0f} deg only (1 sigma)")
    return lines


def _of(runs: Mask) -> str:
    return "" if len(runs) == 1 else f" in {runs.sum()} of {len(runs)} runs"
