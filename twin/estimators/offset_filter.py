"""All three offsets of the CM, with attitude, rate and gyro bias, in one Kalman filter.

A body with wheels, gimbals and sliding masses as a filter moves it, by its momentum.

    H = J w + A h + s      momentum about the CR, body axes
    dH/dt = M x g - w x H,  dh/dt = u

h is the momentum of each wheel about its own axis, its share of the body's turning included, so
that J is without that; s is what rotors at a fixed speed, turning gimbals and moving masses hold; M
is m r with the masses where they are. Runs come first, (n, ...).
"""

import copy
from dataclasses import dataclass, field, replace
from typing import NamedTuple, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.estimators.aids import delay_of, first_attitude
from twin.estimators.estimator import (
    Estimator,
    OffsetEstimate,
    blank,
    need_floating_body,
    newest,
    ready_runs,
    shared,
    still_awaited,
    variance_of,
)
from twin.model import Machine, Sliding, compile_model
from twin.platform import Platform
from twin.rotation import (
    conjugate,
    cross,
    from_rotation_vector,
    multiply,
    normalized,
    rotate,
    skew,
    to_rotation_vector,
    vertical_body,
)
from twin.signals import Command, Estimate, Reading, Samples

Array = NDArray[np.float64]


class PartsOfTick(NamedTuple):
    """What the parts are between two ticks."""

    inertia: Array
    """(n, 3, 3) J without the wheels' turning about their own axes [kg m^2]."""
    inverse: Array
    """(n, 3, 3) of it."""
    axes: Array
    """(n, 3, w) A: the wheels' axes, side by side."""
    held: Array
    """(n, 3) s [N m s]."""
    moved: Array
    """(n, 3) what the masses add to m r [kg m]."""


class MotionState(NamedTuple):
    """Where the body is and how it turns."""

    attitude: Array
    """(n, 4)."""
    momentum: Array
    """(n, 3) H [N m s]."""
    spins: Array
    """(n, w) h [N m s]."""


@dataclass(frozen=True)
class Gyrostat:
    """One machine's numbers."""

    inertia: Array
    """(3, 3) J with the stages at 0 [kg m^2]."""
    gravity: float
    """[m/s^2]."""
    wheel_inertia: Array
    """(w,) about their axes [kg m^2]."""
    axes: Array
    """(w + rotors, 3) spin axes at gimbal angle 0."""
    turned: Array
    """(w + rotors, 3) gimbal axis x spin axis; 0 where no gimbal carries it."""
    gimbal: NDArray[np.intp]
    """(w + rotors,) which gimbal; 0 where none."""
    gimbal_axes: Array
    """(gimbals, 3)."""
    gimbal_inertia: Array
    """(gimbals,) of each about its axis, with what it carries [kg m^2]."""
    rotor_momentum: Array
    """(rotors,) [N m s]."""
    riding: Sliding
    """The bodies on the stages."""
    field: Array
    """(3,) of the room [T]."""

    @classmethod
    def of(cls, platform: Platform) -> "Gyrostat":
        """Of a platform, whose CM is not asked for."""
        spinning = (*platform.wheels, *platform.rotors)
        names = [gimbal.name for gimbal in platform.gimbals]
        carriers = [None if s.gimbal is None else names.index(s.gimbal) for s in spinning]
        axes = np.array([s.axis for s in spinning]).reshape(-1, 3)
        machine = compile_model(platform)
        turned = np.zeros_like(axes)
        for row, carrier in enumerate(carriers):
            if carrier is not None:
                turned[row] = np.cross(platform.gimbals[carrier].axis, axes[row])
        return cls(
            inertia=platform.inertia,
            gravity=platform.gravity,
            wheel_inertia=np.array([wheel.inertia for wheel in platform.wheels]),
            axes=axes,
            turned=turned,
            gimbal=np.array([carrier or 0 for carrier in carriers], dtype=np.intp),
            gimbal_axes=np.array([gimbal.axis for gimbal in platform.gimbals]).reshape(-1, 3),
            gimbal_inertia=_gimbal_inertia(machine),
            rotor_momentum=np.array([rotor.momentum for rotor in platform.rotors]),
            riding=machine.sliding,
            field=platform.magnetic_field,
        )

    def parts(
        self,
        stages: tuple[Array, Array],
        gimbals: tuple[Array, Array],
        period: float,
        at: float = 0.5,
    ) -> PartsOfTick:
        """The parts between two ticks.

        Args:
            stages: positions at both, (n, stages) [m].
            gimbals: angles at both, (n, gimbals) [rad].
            period: between them [s].
            at: where between them the axes are taken: 0 the first, 1 the second.
        """
        n, wheels = len(gimbals[0]), len(self.wheel_inertia)
        axes = np.broadcast_to(self.axes, (n, *self.axes.shape))
        if self.turned.any():
            angles = (1.0 - at) * gimbals[0] + at * gimbals[1]
            angle = angles[:, self.gimbal, None]
            fixed = ~np.any(self.turned, axis=1, keepdims=True)
            axes = np.where(fixed, axes, axes * np.cos(angle) + self.turned * np.sin(angle))
        spin, rotor = axes[:, :wheels], axes[:, wheels:]
        inertia = self.inertia - np.einsum("w,nwi,nwj->nij", self.wheel_inertia, spin, spin)
        held = np.einsum("r,nri->ni", self.rotor_momentum, rotor)
        if period > 0.0:
            swept = (gimbals[1] - gimbals[0]) * self.gimbal_inertia
            held = held + np.einsum("ng,gi->ni", swept, self.gimbal_axes) / period
        riding = self.riding
        path = np.einsum("ns,bsi->nbi", 0.5 * (stages[0] + stages[1]), riding.travel)
        moved = np.einsum("b,nbi->ni", riding.mass, path)
        if path.any():
            place = riding.home + path
            gone = np.einsum("ns,bsi->nbi", stages[1] - stages[0], riding.travel)
            inertia = inertia + np.einsum("b,nbij->nij", riding.mass, _spread(place))
            inertia = inertia - np.einsum("b,bij->ij", riding.mass, _spread(riding.home))
            if period > 0.0:
                swept = np.einsum("b,nbi->ni", riding.mass, cross(place, gone))
                held = held + swept / period
        return PartsOfTick(inertia, np.linalg.inv(inertia), spin.transpose(0, 2, 1), held, moved)

    def down(self, attitude: Array) -> Array:
        """g in body axes, (n, 3) [m/s^2]."""
        return -self.gravity * vertical_body(attitude)

    def moved(
        self,
        motion: MotionState,
        moment: Array,
        parts: PartsOfTick,
        torque: Array,
        period: float,
        push: Array | None = None,
    ) -> MotionState:
        """After a period [s] under the wheels' torques u (n, w) [N m]; m r without `parts.moved`.

        `push` (n, 3) [N m] is what else turns the body, constant in its axes.

        H by fourth-order Runge-Kutta; the attitude by the mean of its rates, and the coning of a
        rate that changes evenly.
        """
        whole = moment + parts.moved

        def pull(at: MotionState) -> tuple[Array, Array]:
            rate = rate_of(parts, at)
            change = cross(whole, self.down(at.attitude)) - cross(rate, at.momentum)
            return change if push is None else change + push, rate

        def onward(rate: Array, change: Array, step: float) -> MotionState:
            return MotionState(
                multiply(motion.attitude, from_rotation_vector(step * rate)),
                motion.momentum + step * change,
                motion.spins + step * torque,
            )

        first, begin = pull(motion)
        second, early = pull(onward(begin, first, 0.5 * period))
        third, late = pull(onward(early, second, 0.5 * period))
        fourth, end = pull(onward(late, third, period))
        change = (first + 2.0 * (second + third) + fourth) / 6.0
        rate = (begin + 2.0 * (early + late) + end) / 6.0
        coning = (period / 12.0) * cross(begin, end)
        return onward(rate + coning, change, period)

    def slope(self, motion: MotionState, moment: Array, parts: PartsOfTick) -> Array:
        """F (n, 12 + w, 12 + w) of the errors of attitude, H, gyro bias, m r and h."""
        inverse, axes = parts.inverse, parts.axes
        rate = rate_of(parts, motion)
        g, momentum = skew(self.down(motion.attitude)), skew(motion.momentum)
        size = 12 + axes.shape[2]
        out = np.zeros((len(rate), size, size))
        out[:, :3, :3] = -skew(rate)
        out[:, :3, 3:6] = inverse
        out[:, 3:6, :3] = skew(moment + parts.moved) @ g
        out[:, 3:6, 3:6] = momentum @ inverse - skew(rate)
        out[:, 3:6, 9:12] = -g
        out[:, :6, 12:] = -out[:, :6, 3:6] @ axes
        out[:, 3:6, 12:] -= skew(rate) @ axes
        return out


def _gimbal_inertia(machine: Machine) -> Array:
    """Of each gimbal about its axis, without the armature that prescribes its motion."""
    bare = copy.copy(machine.model)
    bare.dof_armature[:] = 0.0
    mujoco.mj_setConst(bare, mujoco.MjData(bare))
    return np.asarray(bare.dof_M0[machine.gimbal_dof], dtype=np.float64)


def rate_of(parts: PartsOfTick, motion: MotionState) -> Array:
    """w (n, 3) [rad/s]."""
    spun = np.einsum("niw,nw->ni", parts.axes, motion.spins)
    return np.einsum("nij,nj->ni", parts.inverse, motion.momentum - spun - parts.held)


def _spread(place: Array) -> Array:
    """|p|^2 1 - p p^T, (..., 3, 3)."""
    square = np.einsum("...i,...i->...", place, place)
    return square[..., None, None] * np.eye(3) - place[..., None] * place[..., None, :]


_HEADING = 1e-3
"""1 sigma of a heading that counts from the start [rad]."""

TURN, MOMENTUM, BIAS, MOMENT, SPINS = (
    slice(0, 3),
    slice(3, 6),
    slice(6, 9),
    slice(9, 12),
    slice(12, None),
)
"""Where the errors stand in the state."""


class VerticalSensor(NamedTuple):
    """An inclinometer or an accelerometer: what shows how the body leans where no camera does."""

    stream: str
    variance: Array
    """(2,) or (3,) of a sample, in parts of g."""
    delay: float
    """By which its low-pass passes slow signals late [s]."""
    lever: Array
    """(3,) from the CR to its site [m]."""


class OffsetFilterNoise(NamedTuple):
    """Variances of a sample."""

    gyro: Array
    """(3,) [rad^2/s^2]."""
    attitude: Array
    """(3,) [rad^2]."""
    wheels: Array
    """(w,) of a wheel's momentum as its speed tells it [(N m s)^2]."""
    gyro_delay: float
    """By which the gyro's low-pass passes slow signals late [s]."""
    vertical: VerticalSensor | None = None
    """What stands for an attitude; None where one is measured."""


@dataclass(slots=True, kw_only=True)
class GyrostatEstimate(OffsetEstimate):
    """The estimate at the tick."""

    motion: MotionState
    moment: Array
    """(n, 3) m r with the stages at 0 [kg m]."""
    spread: Array
    """(n, 12 + w, 12 + w) covariance of the errors of attitude [rad], momentum [N m s], gyro bias
    [rad/s], m r [kg m] and wheels' momenta [N m s]."""
    torque: Array
    """(n, w) that the wheels were told to give from this tick on [N m]."""
    gyrostat: Gyrostat
    noise: OffsetFilterNoise
    dipole: Array
    """(n, 3) that the coils were told to have from this tick on [A m^2, body]; (n, 0) without."""
    squares: Array
    """(n,) sum of the squared innovations in their sigmas."""
    counted: Array
    """(n,) how many they are."""


@dataclass(frozen=True)
class OffsetFilter(Estimator):
    """Extended Kalman filter of attitude, momentum, gyro bias, m r and the wheels' momenta.

    x = (d_theta, H, b, m r, h), q = q^ exp(d_theta); the model is that of `Gyrostat`, its J and
    masses those of the platform. Between two ticks the state goes by Runge-Kutta and its covariance
    by Phi = 1 + F T + F^2 T^2 / 2. The samples of a tick enter stream by stream as one, their mean
    residual, each against the motion carried back to its own time, w(t - a) = w - a dw/dt; the
    gyro's low-pass is taken as its delay at rest.

    - Wheels are predicted from the torque they were told to give, and corrected by their speeds:
      the noise of a speed that was differenced would stand for a torque. Stages and gimbals are
      taken as measured, and carry momentum as they move.
    - What the model lacks (friction, drafts, a wrong J) is a white torque: `torque_noise`. With 0
      the motion is trusted for good, and the covariance is the Cramer-Rao bound of the run so far.
    - How masses and gimbals move between two ticks is not known, and taken as straight: while they
      work, m r may be off by more than its covariance says, a micrometre where they work hard.
    - m r starts at 0 within `offset_start` of the CR, wherever the platform states the CM.
    - The bias is constant, within what platform.toml states of it.
    - The CR must stand still, and the machine hang on a ball.
    - Without an attitude an inclinometer, or else an accelerometer, shows the vertical, with what
      the turning adds to gravity at its site; the heading counts from the start. Its constant error
      is not in the covariance: a vertical off by d makes m r off by d x m r.
    - Coils turn the body by their dipole in the field that platform.toml states.

    The unscented filter of the same state, and of J, is for logs: `twin identify --method ukf`.

    Source: S. Y. Choi, Georgia Institute of Technology 2016, eq. 27 to 41, whose one offset this
    completes; the error state after E. J. Lefferts, F. L. Markley, M. D. Shuster, J. Guidance 5(5),
    1982.
    """

    torque_noise: float = field(default=1e-5, metadata={"unit": "N m s^0.5"})
    """White torque about each body axis: what it adds to the momentum in a second, 1 sigma."""
    wheel_noise: float = field(default=1e-6, metadata={"unit": "N m s^0.5"})
    """Likewise what a wheel's torque differs from the one it was told, by friction."""
    offset_start: float = field(default=1e-3, metadata={"unit": "m"})
    """1 sigma of each component of r at the start."""
    rate_start: float = field(default=1.0, metadata={"unit": "rad/s"})
    """1 sigma of each component of the rate at the start."""

    def init(self, platform: Platform, n: int) -> GyrostatEstimate:
        """Level and at rest, the CM at the CR; not valid, and attitude unknown."""
        vertical = _vertical_sensor(platform)
        if vertical is None:
            need_floating_body(platform, "offset")
        start, gyrostat = blank(platform, n), Gyrostat.of(platform)
        stages, gimbals = start.stage_position, start.gimbal_angle
        parts = gyrostat.parts((stages, stages), (gimbals, gimbals), 0.0)
        home = np.array([wheel.inertia * wheel.home for wheel in platform.wheels])
        limit = np.array([wheel.momentum_limit for wheel in platform.wheels])
        spins = np.tile(home, (n, 1))
        size = 12 + len(home)
        spread = np.zeros((n, size, size))
        spread[:, TURN, TURN] = np.pi**2 * np.eye(3)
        rates = self.rate_start**2 * parts.inertia @ parts.inertia
        spread[:, MOMENTUM, MOMENTUM] = rates + (parts.axes * limit**2) @ parts.axes.transpose(
            0, 2, 1
        )
        spread[:, MOMENTUM, SPINS] = parts.axes * limit**2
        spread[:, SPINS, MOMENTUM] = spread[:, MOMENTUM, SPINS].transpose(0, 2, 1)
        spread[:, SPINS, SPINS] = np.diag(limit**2)
        if vertical is not None:
            spread[:, 2, 2] = _HEADING**2
        if "gyro" in platform.sensors:
            spread[:, BIAS, BIAS] = np.diag(platform.sensors["gyro"].bias ** 2)
        spread[:, MOMENT, MOMENT] = (self.offset_start * platform.mass) ** 2 * np.eye(3)
        momentum = np.einsum("niw,nw->ni", parts.axes, spins) + parts.held
        return GyrostatEstimate(
            **shared(start),
            center_of_mass_offset=np.zeros((n, 3)),
            offset_covariance=spread[:, MOMENT, MOMENT],
            motion=MotionState(start.attitude, momentum, spins),
            moment=np.zeros((n, 3)),
            spread=spread,
            torque=np.zeros((n, len(home))),
            gyrostat=gyrostat,
            noise=_noise(platform, vertical),
            dipole=np.zeros((n, 3 if platform.magnetorquers else 0)),
            squares=np.zeros(n),
            counted=np.zeros(n),
        )

    def with_command(self, estimate: Estimate, applied: Command) -> GyrostatEstimate:
        """Remember what wheels and coils will do until the next tick."""
        known = cast(GyrostatEstimate, estimate)
        torque = applied.get("command_wheel_torque", known.torque)
        return replace(known, torque=torque, dipole=applied.get("command_dipole", known.dipole))

    def update(self, estimate: Estimate, reading: Reading) -> GyrostatEstimate:
        """Valid from a run's first attitude sample and positions; it stands still until then."""
        before, streams = cast(GyrostatEstimate, estimate), reading.streams
        stages = newest(streams.get("stage_position"), before.stage_position)
        gimbals = newest(streams.get("gimbal_angle"), before.gimbal_angle)
        wheels = newest(streams.get("wheel_speed"), before.wheel_speed)
        period = reading.time - before.time
        path = _path(before, "stage_position", stages, period)
        swing = _path(before, "gimbal_angle", gimbals, period)
        parts, begin, end = (
            before.gyrostat.parts(path, swing, period, at) for at in (0.5, 0.0, 1.0)
        )
        awaited, oriented = still_awaited(streams, before), before.oriented
        motion, spread, valid = before.motion, before.spread, before.valid
        if valid.any():
            push = None
            if before.dipole.shape[1]:
                field = np.broadcast_to(before.gyrostat.field, motion.momentum.shape)
                push = cross(before.dipole, rotate(conjugate(motion.attitude), field))
            moved = before.gyrostat.moved(motion, before.moment, parts, before.torque, period, push)
            onward = self._spread(before, moved, parts, period)
            motion = _chosen(valid, moved, motion)
            spread = np.where(valid[:, None, None], onward, spread)
        fixes = streams.get("attitude")
        if fixes is not None and not valid.all():
            first = normalized(newest(fixes, motion.attitude))
            motion = motion._replace(attitude=np.where(valid[:, None], motion.attitude, first))
            oriented = oriented | np.asarray(fixes.valid.any(axis=1))
        vertical = before.noise.vertical
        shown = None if vertical is None else streams.get(vertical.stream)
        if vertical is not None and shown is not None and not valid.all():
            sample = newest(shown, np.zeros((len(valid), shown.value.shape[2])))
            every = np.ones(len(valid), dtype=np.bool_)
            first, _ = first_attitude(
                {vertical.stream: (sample, shown.time[:, -1], every)}, np.zeros((1, 3)), len(valid)
            )
            motion = motion._replace(attitude=np.where(valid[:, None], motion.attitude, first))
            oriented = oriented | np.asarray(shown.valid.any(axis=1))
        valid = ready_runs(oriented, awaited)
        state = _State(
            motion, before.gyro_bias, before.moment, spread, before.squares, before.counted
        )
        torque = np.einsum("niw,nw->ni", end.axes, before.torque)
        if period > 0.0:
            swung = np.einsum("niw,nw->ni", end.axes - begin.axes, motion.spins)
            torque = torque + (swung + end.held - begin.held) / period
        correction = _Correction(
            before.gyrostat, before.noise, end, before.torque, torque, reading.time, valid
        )
        for correct, stream in (
            (correction.by_attitude, fixes),
            (correction.by_vertical, shown),
            (correction.by_gyro, streams.get("gyro")),
            (correction.by_wheels, streams.get("wheel_speed")),
        ):
            if stream is not None and stream.value.shape[2]:
                state = correct(state, stream)
        motion, spread = state.motion, state.spread
        own = np.r_[0:3, 6:9]
        return replace(
            before,
            time=reading.time,
            attitude=motion.attitude,
            rate_body=rate_of(end, motion),
            wheel_speed=wheels,
            stage_position=stages,
            gimbal_angle=gimbals,
            gyro_bias=state.bias,
            valid=valid,
            oriented=oriented,
            awaited=awaited,
            covariance=spread[:, own[:, None], own],
            center_of_mass_offset=state.moment + correction.carried_moment(stages),
            offset_covariance=spread[:, MOMENT, MOMENT],
            motion=motion,
            moment=state.moment,
            spread=spread,
            squares=state.squares,
            counted=state.counted,
        )

    def _spread(
        self, before: GyrostatEstimate, moved: MotionState, parts: PartsOfTick, period: float
    ) -> Array:
        """Phi P Phi^T + Q over a period [s]."""
        start = before.gyrostat.slope(before.motion, before.moment, parts)
        slope = 0.5 * (start + before.gyrostat.slope(moved, before.moment, parts))
        size = slope.shape[1]
        onward = np.eye(size) + period * slope + (0.5 * period**2) * (slope @ slope)
        spread = onward @ before.spread @ onward.transpose(0, 2, 1)
        added = np.zeros(size)
        added[MOMENTUM] = self.torque_noise**2
        added[SPINS] = self.wheel_noise**2
        spread[:, range(size), range(size)] += period * added
        return spread


def _path(before: Estimate, stream: str, shown: Array, period: float) -> tuple[Array, Array]:
    """Positions at both ends of a period [s]; one that is first seen now has not come from 0."""
    held: Array = getattr(before, stream)
    first = before.awaited.get(stream)
    if first is not None and period > 0.0:
        held = np.where(first[:, None], shown, held)
    return held, shown


class _State(NamedTuple):
    motion: MotionState
    bias: Array
    moment: Array
    spread: Array
    squares: Array
    counted: Array

    def corrected(self, residual: Array, slope: Array, variance: Array) -> "_State":
        """By what the errors make of a residual (n, m), H (n, m, k), with noise (n, m).

        An infinite variance changes nothing.
        """
        weak = ~np.isfinite(variance)
        slope = np.where(weak[..., None], 0.0, slope)
        residual, variance = np.where(weak, 0.0, residual), np.where(weak, 1.0, variance)
        noise = variance[:, :, None] * np.eye(variance.shape[1])
        seen = self.spread @ slope.transpose(0, 2, 1)
        whole = slope @ seen + noise
        gain = np.linalg.solve(whole, seen.transpose(0, 2, 1)).transpose(0, 2, 1)
        square = np.linalg.solve(whole, residual[..., None])[..., 0] * residual
        squares = self.squares + np.where(weak, 0.0, square).sum(axis=1)
        counted = self.counted + (~weak).sum(axis=1)
        left = np.eye(slope.shape[2]) - gain @ slope
        spread = left @ self.spread @ left.transpose(0, 2, 1)
        spread = spread + gain @ noise @ gain.transpose(0, 2, 1)
        step = np.einsum("nij,nj->ni", gain, residual)
        motion = MotionState(
            multiply(self.motion.attitude, from_rotation_vector(step[:, TURN])),
            self.motion.momentum + step[:, MOMENTUM],
            self.motion.spins + step[:, SPINS],
        )
        bias, moment = self.bias + step[:, BIAS], self.moment + step[:, MOMENT]
        return _State(motion, bias, moment, spread, squares, counted)


@dataclass(frozen=True)
class _Correction:
    """Corrects a state by the samples of a tick."""

    gyrostat: Gyrostat
    noise: OffsetFilterNoise
    parts: PartsOfTick
    torque: Array
    """(n, w) on the wheels."""
    reaction: Array
    """(n, 3) by which wheels and gimbals change what they hold, body axes."""
    time: float
    valid: NDArray[np.bool_]

    def by_attitude(self, state: _State, fixes: Samples) -> _State:
        """Mean turn from where the motion, carried back, has been."""
        rate, pull, slope = self._turning(state)
        age = (self.time - fixes.time)[..., None]
        back = 0.5 * age**2 * pull[:, None] - age * rate[:, None]
        there = multiply(state.motion.attitude[:, None], from_rotation_vector(back))
        side = np.copysign(1.0, np.einsum("nmi,nmi->nm", there, fixes.value))
        turn = to_rotation_vector(multiply(conjugate(there), side[..., None] * fixes.value))
        residual, count = self._mean(fixes, turn)
        mean, square = self._mean(fixes, age)[0], self._mean(fixes, age**2)[0]
        known = np.zeros_like(slope[0])
        known[:, :, TURN] = np.eye(3)
        known += 0.5 * square[..., None] * slope[1] - mean[..., None] * slope[0]
        return state.corrected(residual, known, _of_mean(self.noise.attitude, count))

    def by_vertical(self, state: _State, shown: Samples) -> _State:
        """Mean specific force, in parts of g, beyond that of the motion carried back."""
        sensor = cast(VerticalSensor, self.noise.vertical)
        rate, pull, slope = self._turning(state)
        age = (self.time - shown.time)[..., None] + sensor.delay
        back = 0.5 * age**2 * pull[:, None] - age * rate[:, None]
        there = multiply(state.motion.attitude[:, None], from_rotation_vector(back))
        up = vertical_body(there)
        turning = rate[:, None] - age * pull[:, None]
        lever = np.broadcast_to(sensor.lever, turning.shape)
        felt = cross(np.broadcast_to(pull[:, None], turning.shape), lever)
        felt = felt + cross(turning, cross(turning, lever))
        force = up + felt / self.gyrostat.gravity
        if sensor.stream == "inclinometer":  # roll = asin(f_y), pitch = -asin(f_x)
            sines = np.sin(shown.value)
            error = np.stack([sines[..., 0], -sines[..., 1]], axis=-1) - force[..., [1, 0]]
            rows = [1, 0]
        else:
            error = shown.value / self.gyrostat.gravity - force
            rows = [0, 1, 2]
        residual, count = self._mean(shown, error)
        mean, square = self._mean(shown, age)[0], self._mean(shown, age**2)[0]
        turned = np.zeros_like(slope[0])
        turned[:, :, TURN] = np.eye(3)
        turned += 0.5 * square[..., None] * slope[1] - mean[..., None] * slope[0]
        known = skew(self._mean(shown, up)[0]) @ turned
        # a first guess of m r that is far off turns the body, and shakes the sensor, as wrongly
        known = (known - skew(sensor.lever[None]) @ slope[1] / self.gyrostat.gravity)[:, rows]
        return state.corrected(residual, known, _of_mean(sensor.variance, count))

    def by_gyro(self, state: _State, gyro: Samples) -> _State:
        """Mean of what it shows beyond the rate, carried back by its age and its delay."""
        rate, pull, slope = self._turning(state)
        age = (self.time - gyro.time)[..., None] + self.noise.gyro_delay
        there = rate[:, None] + state.bias[:, None] - age * pull[:, None]
        residual, count = self._mean(gyro, gyro.value - there)
        known = slope[0] - self._mean(gyro, age)[0][..., None] * slope[1]
        known[:, :, BIAS] += np.eye(3)
        return state.corrected(residual, known, _of_mean(self.noise.gyro, count))

    def by_wheels(self, state: _State, speeds: Samples) -> _State:
        """Mean of I Omega = h - I a . w beyond what it should be."""
        rate, pull, slope = self._turning(state)
        inertia, axes = self.gyrostat.wheel_inertia, self.parts.axes
        own = state.motion.spins - inertia * np.einsum("niw,ni->nw", axes, rate)
        change = self.torque - inertia * np.einsum("niw,ni->nw", axes, pull)
        age = (self.time - speeds.time)[..., None]
        there = own[:, None] - age * change[:, None]
        residual, count = self._mean(speeds, inertia * speeds.value - there)
        known = -inertia[:, None] * (axes.transpose(0, 2, 1) @ slope[0])
        known[:, :, SPINS] += np.eye(len(inertia))
        return state.corrected(residual, known, _of_mean(self.noise.wheels, count))

    def carried_moment(self, stages: Array) -> Array:
        """What the stages add to m r, (n, 3) [kg m]."""
        riding = self.gyrostat.riding
        return np.einsum("b,ns,bsi->ni", riding.mass, stages, riding.travel)

    def _turning(self, state: _State) -> tuple[Array, Array, tuple[Array, Array]]:
        """w and dw/dt (n, 3), and how they answer to the errors (n, 3, k)."""
        motion, parts = state.motion, self.parts
        rate = rate_of(parts, motion)
        down = self.gyrostat.down(motion.attitude)
        torque = cross(state.moment + parts.moved, down) - cross(rate, motion.momentum)
        pull = np.einsum("nij,nj->ni", parts.inverse, torque - self.reaction)
        size = state.spread.shape[1]
        of_rate, of_pull = np.zeros((2, len(rate), 3, size))
        of_rate[:, :, MOMENTUM] = parts.inverse
        of_rate[:, :, SPINS] = -parts.inverse @ parts.axes
        of_pull[:, :, MOMENT] = -parts.inverse @ skew(down)
        return rate, pull, (of_rate, of_pull)

    def _mean(self, samples: Samples, values: Array) -> tuple[Array, Array]:
        """Of the valid ones (n, k), and their number (n, 1), 0 in a run that is not valid."""
        kept = (samples.valid & self.valid[:, None])[..., None]
        count = np.asarray(kept.sum(axis=1), dtype=np.float64)
        total = np.where(kept, values, 0.0).sum(axis=1)
        return total / np.maximum(count, 1.0), count


def _of_mean(variance: Array, count: Array) -> Array:
    with np.errstate(divide="ignore"):
        return variance / count


def _chosen(rows: NDArray[np.bool_], new: MotionState, old: MotionState) -> MotionState:
    return MotionState(*(np.where(rows[:, None], a, b) for a, b in zip(new, old, strict=True)))


def _vertical_sensor(platform: Platform) -> VerticalSensor | None:
    """Of a machine on a ball without an attitude: its inclinometer, else its accelerometer."""
    if "attitude" in platform.sensors or platform.base.kind != "ball" or platform.base.falls:
        return None
    name = next((n for n in ("inclinometer", "accelerometer") if n in platform.sensors), None)
    if name is None:
        return None
    sensor, lever = platform.sensors[name], np.zeros(3)
    if sensor.site:
        from twin.plant.truth import site_places

        lever = site_places(compile_model(platform))[sensor.site]
    scale = 1.0 if name == "inclinometer" else platform.gravity
    return VerticalSensor(name, variance_of(sensor) / scale**2, delay_of(sensor), lever)


def _noise(platform: Platform, vertical: VerticalSensor | None) -> OffsetFilterNoise:
    gyro, speeds = platform.sensors.get("gyro"), platform.sensors.get("wheel_speed")
    inertia = np.array([wheel.inertia for wheel in platform.wheels])
    delay = 0.0
    if gyro is not None and np.isfinite(gyro.cutoff):
        delay = 1.0 / (2.0 * np.pi * gyro.cutoff * np.sin(0.5 * np.pi / gyro.order))
    wheels = np.zeros(0) if speeds is None else inertia**2 * variance_of(speeds)
    return OffsetFilterNoise(
        np.zeros(3) if gyro is None else variance_of(gyro),
        np.zeros(3) if vertical else variance_of(platform.sensors["attitude"]),
        wheels,
        delay,
        vertical,
    )
