"""A recording of one body: its hypotheses, ranked with the wheels too, and weighed in pairs."""

from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from twin.conventions.correction import (
    LATE,
    Correction,
    apply_all,
    axes_change,
    axes_changes,
    lag_change,
)
from twin.conventions.evidence import PLAIN, chance, evidence, inflation
from twin.conventions.gravity import upright_of
from twin.conventions.grid import dated
from twin.conventions.hypothesis import Hypothesis
from twin.conventions.turning import Turning
from twin.conventions.vertical import ALIKE, motion_hypotheses, place_of
from twin.conventions.wheels import (
    ANSWERED,
    Exchange,
    WheelReading,
    WheelStreams,
    factor_of,
    momentum_of,
)
from twin.platform import Platform
from twin.recording import Recording

Array = NDArray[np.float64]

BODIES = 12
"""So many of the best hypotheses about the body's motion are held against the wheels."""
LIKELY = 3
"""So many readings of the wheels are kept for each."""
RIVALS = 12
"""So many of the best of all are left to be weighed in pairs."""
FORCE_AXES = ("accelerometer", "axes")
LATE_WHEELS = 3
"""For so many of the best bodies the wheels may be late too."""


class BodyStreams:
    """Ranking is by misfit; `weigh` decides, pair by pair, as `evidence.py` says."""

    def __init__(self, recording: Recording, platform: Platform | None, turning: Turning) -> None:
        self._recording = recording
        self._turning = turning
        self._upright = upright_of(recording, platform)
        self._platform = platform

    def with_wheels_in(self, unit: Correction) -> "BodyStreams":
        """The same body beside wheels in another unit; what they have no part in is kept."""
        other = copy(self)
        other._recording = apply_all(self._recording, [unit])
        for name in ("_wheels", "_answer"):
            other.__dict__.pop(name, None)
        return other

    @cached_property
    def of_motion(self) -> list[Hypothesis]:
        """Without the wheels; the best, and the log as read, best first."""
        kept = [replace(h, misfit=h.misfit / self._inflation) for h in self._ranked]
        return sorted(kept, key=lambda h: h.score)

    @cached_property
    def _every(self) -> list[Hypothesis]:
        listed = motion_hypotheses(self._recording, self._turning, self._upright)
        return sorted(listed, key=lambda h: h.score)

    @property
    def _plain(self) -> list[Hypothesis]:
        """Those that fit as well as the best but for noise, the plainest first: where the body
        turns about one axis there are many, and chance ranks them."""
        near = chance(self._turn(self._every[0]).size) * self._inflation
        known = {id(h) for h in self._ranked}
        alike = [h for h in self._every if h.misfit < self._every[0].misfit + near]
        plainest = sorted((h for h in alike if id(h) not in known), key=lambda h: h.cost)[:PLAIN]
        return [replace(h, misfit=h.misfit / self._inflation) for h in plainest]

    @cached_property
    def _ranked(self) -> list[Hypothesis]:
        """Those of `of_motion`, their misfit as if noise were all that is left."""
        ranked = self._every
        kept = ranked[:BODIES]
        # what only the wheels can tell is kept for them: the log as read, and in other frames
        for framed in (False, True):
            whole = [h for h in ranked if h.of_whole_log and h.framed == framed]
            kept += [h for h in whole[:1] if not any(h is item for item in kept)]
        every = [force for h in kept for force in self._with_forces(h)]
        return list({h.key: h for h in reversed(every)}.values())[::-1]

    def _with_forces(self, h: Hypothesis) -> list[Hypothesis]:
        """A hypothesis, and the same with the axes of the accelerometer that fit about best once
        what the turning does to the sensor is taken out."""
        upright = h.reading.upright
        if upright is None or not upright.has_arm:
            return [h]
        own = next((c for c in h.corrections if (c.stream, c.kind) == FORCE_AXES), None)
        frame = h.force @ (np.array(own.axes).T if own else np.eye(3))
        cost = h.cost - (own.cost if own else 0.0)
        rest = [c for c in h.corrections if c is not own]
        place = sum(c.kind != "frame" for c in rest)
        misfit = 0.5 * upright.match(h.attitude)
        bare = h.misfit - float(misfit[place_of(h.force)])
        result: list[tuple[float, Hypothesis]] = []
        for axes, change in axes_changes(self._recording, "accelerometer"):
            force, changes = frame @ axes, [] if change is None else [change]
            other = replace(
                h,
                corrections=(*rest[:place], *changes, *rest[place:]),
                cost=cost + sum(c.cost for c in changes),
                misfit=bare + float(misfit[place_of(force)]),
                force=force,
            )
            left = upright.residual(h.attitude, force, h.gyro)
            result.append((0.5 * float(np.sum(np.square(left))) + other.cost, other))
        near = min(score for score, _ in result) + ALIKE
        return [
            h,
            *(other for score, other in result if score < near and (other.force != h.force).any()),
        ]

    @cached_property
    def _inflation(self) -> float:
        return inflation(self._turn(self._ranked[0]))

    @cached_property
    def _upright_inflation(self) -> float:
        # the likeliest may be wrong about the accelerometer, and would excuse itself
        return min(
            (
                inflation(h.reading.upright.residual(h.attitude, h.force, h.gyro)[:-2])
                for h in self._ranked
                if h.reading.upright is not None and h.reading.upright.has_accelerometer
            ),
            default=1.0,
        )

    @cached_property
    def _answer(self) -> bool:
        """Whether the wheels answer what the body does."""
        wheels = self._wheels
        return wheels is not None and wheels.judge(self._exchange(self.of_motion[0]))

    @cached_property
    def _wheels(self) -> WheelStreams | None:
        """Held against the body while that floats freely."""
        recording = self._recording
        best = self._ranked[0]
        if best.reading.upright is not None:
            recording = recording.between(*best.reading.upright.free(best.attitude))
        momentum = momentum_of(recording, self._platform)
        if self._platform is None or momentum is None:
            return None
        return WheelStreams(self._recording, self._platform, momentum)

    def wheel_factor(self) -> float | None:
        """By what the wheel speeds must be multiplied to answer that of the likeliest bodies which
        they answer best; None where they leave most of it unanswered, or only follow it."""
        bodies = [h for h in self.of_motion if h.framed == self.of_motion[0].framed]
        if self._wheels is None or self._wheels.momentum.follows_body:
            return None
        momentum = self._wheels.momentum
        result = [factor_of(momentum, self._exchange(h, rough=True)) for h in bodies[:LATE_WHEELS]]
        factor, share = max(result, key=lambda pair: pair[1])
        return factor if share > ANSWERED else None

    def with_wheels(self) -> list[Hypothesis]:
        """Those of `of_motion` with every likely reading of the wheels, best first.

        Where something else turns the body more than they do, their commands are read by what they
        do to the wheels alone.
        """
        bodies = self.of_motion
        wheels = self._wheels
        if wheels is None:
            return sorted([*bodies, *self._plain], key=lambda h: h.score)
        if not self._answer:
            readings = wheels.commanded()
            alone = [self._joined(h, reading, late=False) for h in bodies for reading in readings]
            return sorted(alone, key=lambda h: h.score) if alone else bodies
        full: list[Hypothesis] = []
        for place, body in enumerate(bodies):
            exchange = self._exchange(body)
            near = wheels.readings(exchange, far=False)[:LIKELY]
            likely = [wheels.as_read(exchange), *(r for r in near if not r.plain)]
            full += [self._joined(body, reading, late=False) for reading in likely]
            if place < LATE_WHEELS or not body.corrections:
                late = wheels.readings(exchange, far=True)[:LIKELY]
                full += [self._joined(body, reading, late=True) for reading in late]
        full.sort(key=lambda h: h.score)
        chosen = full[:RIVALS] + [h for h in full[RIVALS:] if h.of_whole_log]
        return sorted((self._polished(h, wheels) for h in chosen), key=lambda h: h.score)

    def weigh(self, one: Hypothesis, other: Hypothesis) -> float:
        """Evidence for the one over the other [nats], their costs taken off."""
        turn, *pairs = self._residuals(one, other)
        turned = evidence(*turn, self._noise_apart(one, other))
        others = sum(evidence(*pair) for pair in pairs)
        others += self._driven(other) - self._driven(one)
        # Under feedback the body answers the gyro's noise a moment later, so that a gyro taken for
        # late leaves less momentum over: gyro and attitude alone prove that they are out of step.
        if one.out_of_step and not other.out_of_step:
            others = min(others, 0.0)
        elif other.out_of_step and not one.out_of_step:
            others = max(others, 0.0)
        return turned + others + other.cost - one.cost

    def dated(self, h: Hypothesis) -> Hypothesis:
        """The same with each clock's offset sought finely, and told with its interval."""
        told = [self._dated(h, c) if c.kind == "clock_lag" else c for c in h.corrections]
        return replace(h, corrections=tuple(told))

    def _dated(self, h: Hypothesis, clock: Correction) -> Correction:
        wheels, reading = self._wheels, h.wheels
        if clock.stream != "wheel_speed" or wheels is None or reading is None:
            # That the wheels would have it otherwise is no proof: see `weigh`.
            late = -1.0 if clock.stream == "attitude" else 1.0

            def residual(lag: float) -> Array:
                return h.reading.turning.residual(h.attitude, h.gyro, late * lag)
        elif (drive := wheels.drive) is not None:
            # Commands have no noise, so they tell the time better than the body does.

            def residual(lag: float) -> Array:
                return drive.residual(reading.axes, reading.command, lag)
        else:
            exchange = self._exchange(h)

            def residual(lag: float) -> Array:
                return wheels.residual(exchange, replace(reading, lag=lag))

        return lag_change(clock.stream, *dated(residual, clock.lag)) or clock

    def _residuals(
        self, one: Hypothesis, other: Hypothesis
    ) -> Iterator[tuple[Array, Array, float]]:
        """What both leave, relation by relation, and the relation's inflation."""
        yield self._turn(one), self._turn(other), self._inflation
        mine, theirs = one.reading.upright, other.reading.upright
        if mine is not None and theirs is not None and mine.has_accelerometer:
            left = [
                up.residual(h.attitude, h.force, h.gyro) for up, h in ((mine, one), (theirs, other))
            ]
            yield left[0], left[1], self._upright_inflation
        wheels = self._wheels
        if wheels is None or one.wheels is None or other.wheels is None or not self._answer:
            return
        pairs = (one, one.wheels), (other, other.wheels)
        left = [wheels.residual(self._exchange(h), reading) for h, reading in pairs]
        yield left[0], left[1], wheels.inflation

    def _driven(self, h: Hypothesis) -> float:
        """What the wheels leave of their commands [nats]. Commands have no noise of their own, so
        this is a likelihood as it stands."""
        if self._wheels is None or h.wheels is None:
            return 0.0
        return self._wheels.driven(h.wheels)

    def _joined(self, body: Hypothesis, reading: WheelReading, *, late: bool) -> Hypothesis:
        names = self._recording["wheel_speed"].columns
        axes = (
            axes_change("wheel_speed", reading.axes, names),
            axes_change("command_wheel_torque", reading.command, names),
        )
        changes = [change for change in axes if change is not None]
        cost = sum(change.cost for change in changes) + (LATE if late else 0.0)
        clock = lag_change("wheel_speed", reading.lag) if late else None
        return replace(
            body,
            corrections=(*body.corrections, *changes, *([clock] if clock else [])),
            cost=body.cost + cost,
            misfit=body.misfit + reading.misfit,
            wheels=reading,
        )

    def _polished(self, h: Hypothesis, wheels: WheelStreams) -> Hypothesis:
        """The same with the wheels' lag sought more finely."""
        assert h.wheels is not None
        finer = wheels.polished(self._exchange(h), h.wheels)
        clock = lag_change("wheel_speed", finer.lag)
        corrections = tuple(
            clock if clock and (c.stream, c.kind) == ("wheel_speed", "clock_lag") else c
            for c in h.corrections
        )
        misfit = h.misfit - h.wheels.misfit + finer.misfit
        return replace(h, corrections=corrections, misfit=misfit, wheels=finer)

    def _exchange(self, body: Hypothesis, *, rough: bool = False) -> Exchange:
        assert self._wheels is not None
        momentum = self._wheels.momentum
        if body.reading.change is not None:
            momentum = momentum.with_attitude(body.reading.series)
        return momentum.exchange(
            body.attitude,
            body.gyro,
            body.reading.turning.bias(body.attitude, body.gyro, body.gyro_lag - body.attitude_lag),
            gyro_lag=body.gyro_lag,
            attitude_lag=body.attitude_lag,
            rough=rough,
        )

    def _noise_apart(self, one: Hypothesis, other: Hypothesis) -> float:
        """Of two that read the same angles."""
        if one.reading is not other.reading:
            return 0.0
        turning = one.reading.turning
        return turning.noise_apart((one.attitude, other.attitude), (one.gyro, other.gyro))

    def _turn(self, h: Hypothesis) -> Array:
        lag = h.gyro_lag - h.attitude_lag
        return h.reading.turning.residual(h.attitude, h.gyro, lag)
