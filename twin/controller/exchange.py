"""Momentum exchange with the body: wheels or control moment gyros, behind one interface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.errors import ControllerError
from twin.platform import Platform
from twin.rotation import conjugate, cross, rotate, vertical_body
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]


DAMPING, REGULARITY, DITHER = 0.05, 1e-3, 0.1
"""Of the steering, see `Gyros.rates`; good for any array, since they have no unit."""

_PHASES = np.pi * np.array([0.0, 0.5, 1.0])


@dataclass(frozen=True)
class Gyros:
    """The array of gyros: at gimbal angle delta, h_i = H_i (a_i cos delta + b_i sin delta).

    H_i is that of a rotor at constant speed, or of a wheel as measured.
    """

    spin: Array
    """(gimbals, 3) a_i, at angle 0."""
    across: Array
    """(gimbals, 3) b_i = g_i x a_i."""
    fixed: Array
    """(gimbals,) momentum of a rotor at constant speed, 0 for a wheel [N m s]."""
    wheel: Array
    """(gimbals, wheels) inertia of the wheel that a gimbal carries [kg m^2]."""
    most: float
    """(sum of H_i^2)^(1/2), or of what the wheels can hold [N m s]."""
    inertia: Array
    """(3, 3) of the body about the CR [kg m^2]."""

    @classmethod
    def of(cls, platform: Platform, law: str) -> "Gyros":
        """Those of the platform.

        Raises:
            ControllerError: there are fewer than the three that `law` needs.
        """
        gimbals, wheels = platform.gimbals, platform.wheels
        carried = {part.gimbal: part for part in (*platform.rotors, *wheels)}
        if len(gimbals) < 3:
            raise ControllerError(
                f"{law} turns the body by three gimbals or more; {platform.name} has "
                f"{len(gimbals)}: choose a platform with control moment gyros"
            )
        spin = np.array([carried[gimbal.name].axis for gimbal in gimbals])
        axis = np.array([gimbal.axis for gimbal in gimbals])
        rotors = {rotor.gimbal: rotor.momentum for rotor in platform.rotors}
        fixed = np.array([rotors.get(gimbal.name, 0.0) for gimbal in gimbals])
        wheel = np.array(
            [[w.inertia * (w.gimbal == gimbal.name) for w in wheels] for gimbal in gimbals]
        ).reshape(len(gimbals), len(wheels))
        most = np.array([w.momentum_limit for w in wheels if w.gimbal is not None])
        largest = float(np.sqrt(np.sum(fixed**2) + np.sum(most**2)))
        return cls(spin, cross(axis, spin), fixed, wheel, largest, platform.inertia)

    def sizes(self, estimate: Estimate) -> Array:
        """H_i, (n, gimbals) [N m s]."""
        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        return self.fixed + np.einsum("gw,nw->ng", self.wheel, estimate.wheel_speed)

    def along(self, estimate: Estimate) -> Array:
        """The rotors' axes a_i cos delta_i + b_i sin delta_i, (n, gimbals, 3)."""
        sine, cosine = np.sin(estimate.gimbal_angle), np.cos(estimate.gimbal_angle)
        return cosine[..., None] * self.spin + sine[..., None] * self.across

    def momentum(self, estimate: Estimate) -> Array:
        """h = sum h_i, (n, 3) [N m s, body]."""
        return np.einsum("ng,ngi->ni", self.sizes(estimate), self.along(estimate))

    def columns(self, estimate: Estimate) -> Array:
        """A^T with dh/dt = A d(delta)/dt: H_i (b_i cos delta_i - a_i sin delta_i).

        Shape (n, gimbals, 3) [N m s].
        """
        sine, cosine = np.sin(estimate.gimbal_angle), np.cos(estimate.gimbal_angle)
        turning = cosine[..., None] * self.across - sine[..., None] * self.spin
        return self.sizes(estimate)[..., None] * turning

    def square(self, estimate: Estimate) -> tuple[Array, Array]:
        """A A^T / H^2, (n, 3, 3), and H^2 = sum of H_i^2, (n,) [N^2 m^2 s^2]."""
        columns, sizes = self.columns(estimate), self.sizes(estimate)
        # Wheels at rest make no gyros: their gimbals cannot be asked for much.
        scale = np.maximum(np.einsum("ng,ng->n", sizes, sizes), (1e-2 * self.most) ** 2)
        return np.einsum("ngi,ngj->nij", columns, columns) / scale[:, None, None], scale

    def regularity(self, estimate: Estimate) -> Array:
        """det(A A^T) / H^6, (n,): 0 where some torque is out of reach of the gimbals."""
        return np.linalg.det(self.square(estimate)[0])

    def rates(
        self,
        change: Array,
        estimate: Estimate,
        time: float,
        *,
        damping: float = DAMPING,
        regularity: float = REGULARITY,
        dither: float = DITHER,
    ) -> Array:
        """Gimbal rates for a change of momentum: the singularity-robust inverse.

        d(delta)/dt = A^T (A A^T + lambda E)^-1 dh/dt
        lambda      = damping H^2 exp(-det(A A^T) / (regularity H^6)),  H^2 = sum of H_i^2
        E           = [[1, e_3, e_2], [e_3, 1, e_1], [e_2, e_1, 1]],
        e_i         = dither sin(pi t / 2 + phi_i), phi = (0, pi/2, pi)

        Away from singular angles lambda vanishes and this is the inverse; near them the rates stay
        bounded, at the price of a torque that errs. At one, no rate at all would answer a torque
        along the direction that is lost, and the array would be stuck: what E adds beside its
        diagonal leads it out. With damping 0 it is the plain inverse.

        Source: Y. Nakamura and H. Hanafusa, Inverse kinematic solutions with singularity
        robustness for robot manipulator control, 1986 (lambda); B. Wie, D. Bailey, C. Heiberg,
        Singularity robust steering logic for redundant single-gimbal control moment gyros,
        J. Guidance 24(5), 2001 (E).

        Args:
            change: dh/dt, (n, 3) [N m, body].
            estimate: where the gimbals stand.
            time: [s].
            damping: lambda at a singular state, in parts of H^2.
            regularity: det(A A^T) below which the damping sets in, in parts of H^6.
            dither: of E, below 1/2, or else it may not be positive definite.

        Returns:
            Shape (n, gimbals) [rad/s].
        """
        square, scale = self.square(estimate)
        near = np.exp(-np.linalg.det(square) / regularity)
        item, two, three = dither * np.sin(0.5 * np.pi * time + _PHASES)
        spread = np.array([[1.0, three, two], [three, 1.0, item], [two, item, 1.0]])
        # What is added to the damping only keeps the plain inverse from dividing by zero.
        damped = square + (damping * near)[:, None, None] * spread + 1e-14 * np.eye(3)
        share = np.linalg.solve(damped, change[..., None])[..., 0] / scale[:, None]
        return np.einsum("ngi,ni->ng", self.columns(estimate), share)

    def command(self, change: Array, estimate: Estimate, time: float) -> Command:
        """Gimbal rates for a change of momentum (n, 3) [N m, body]; none in a run not yet seen."""
        rates = self.rates(change, estimate, time)
        return {"command_gimbal_rate": np.where(estimate.valid[:, None], rates, 0.0)}


@dataclass(frozen=True)
class VariableSpeedGyros:
    """Gyros whose wheels help at singular angles; the equations stand in the law `vscmg_pd`."""

    gyros: Gyros
    carried: Array
    """(gimbals, wheels) 1 where a gimbal carries a wheel."""
    capacity: Array
    """(wheels,) what a wheel can hold [N m s]: the unit of its acceleration below."""
    speed: Array
    """(wheels,) at which it holds that [rad/s]."""
    home: Array
    """(gimbals + wheels,) angles [rad], and speeds in parts of that, at the start of a run."""

    @classmethod
    def of(cls, platform: Platform, law: str) -> "VariableSpeedGyros":
        """Those of the platform.

        Raises:
            ControllerError: there are fewer gimbals than the three that `law` needs, or its wheels
                stand on none.
        """
        gyros, wheels = Gyros.of(platform, law), platform.wheels
        carried = np.array(
            [[float(w.gimbal == g.name) for w in wheels] for g in platform.gimbals]
        ).reshape(len(platform.gimbals), len(wheels))
        if not len(wheels) or not carried.any(axis=0).all():
            raise ControllerError(
                f"{law} drives gimbals and the wheels on them, but {platform.name} has "
                f"{int(carried.sum())} wheels on gimbals of {len(wheels)}: choose `cmg_pd` for "
                "rotors at constant speed"
            )
        speed = np.array([wheel.speed_limit for wheel in wheels])
        angles = np.array([gimbal.home for gimbal in platform.gimbals])
        speeds = np.array([wheel.home for wheel in wheels]) / speed
        capacity = np.array([wheel.momentum_limit for wheel in wheels])
        return cls(gyros, carried, capacity, speed, np.concatenate([angles, speeds]))

    def momentum(self, estimate: Estimate) -> Array:
        """h, (n, 3) [N m s, body]."""
        return self.gyros.momentum(estimate)

    def command(self, change: Array, estimate: Estimate, time: float) -> Command:
        """Gimbal rates and motor torques for a change of momentum (n, 3) [N m, body]."""
        del time
        return self.steered(change, estimate)

    def steered(
        self,
        change: Array,
        estimate: Estimate,
        *,
        share: float = 1.0,
        regularity: float = REGULARITY,
        homing: float = 0.1,
    ) -> Command:
        """Likewise; none in a run that has not been seen yet.

        Args:
            change: dh/dt, (n, 3) [N m, body].
            estimate: where the gyros stand.
            share: of the wheels at a singular state.
            regularity: det(A A^T) below which the wheels set in, in parts of H^6.
            homing: of the null motion [1/s]; 0 for none.
        """
        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        spinning = np.einsum("gw,ngi->nwi", self.carried, self.gyros.along(estimate))
        spinning = self.capacity[:, None] * spinning
        columns = np.concatenate([self.gyros.columns(estimate), spinning], axis=1)  # Q^T
        gimbals = len(self.carried)
        mu = share * np.exp(-self.gyros.regularity(estimate) / regularity)
        weight = np.ones(columns.shape[:2])
        weight[:, gimbals:] = mu[:, None]
        steering = weight * _inverse(columns, weight, change)

        now = np.concatenate([estimate.gimbal_angle, estimate.wheel_speed / self.speed], axis=1)
        away = homing * (self.home - now)
        seen = np.einsum("nki,nk->ni", columns, away)
        moved = steering + away - _inverse(columns, np.ones_like(weight), seen)
        moved = np.where(estimate.valid[:, None], moved, 0.0)
        return {
            "command_gimbal_rate": moved[:, :gimbals],
            "command_wheel_torque": self.capacity * moved[:, gimbals:],
        }


def _inverse(columns: Array, weight: Array, change: Array) -> Array:
    """Q^T (Q M Q^T)^-1 of a change of momentum, (n, k)."""
    square = np.einsum("nki,nk,nkj->nij", columns, weight, columns)
    # So small that it only keeps an array at rest, with nothing to turn, from dividing by zero.
    share = np.linalg.solve(square + 1e-12 * np.eye(3), change[..., None])[..., 0]
    return np.einsum("nki,ni->nk", columns, share)


@dataclass(frozen=True)
class Wheels:
    """Reaction wheels; h = A h_a, with each wheel's whole momentum about its axis.

    h_a,i = I_i (Omega_i + a_i . w) changes by the motor's torque alone. With it goes the inertia
    of the body less what the wheels have about their axes, J - sum I_i a_i a_i^T: then

    J w + h is the whole momentum and  J dw/dt + w x (J w + h) = -dh/dt + torque from outside.
    """

    axes: Array
    """(wheels, 3) a_i."""
    spin: Array
    """(wheels,) I_i [kg m^2]."""
    share: Array
    """pinv(A), (wheels, 3): least sum of squares."""
    inertia: Array
    """(3, 3) of the body, without the wheels about their axes [kg m^2]."""

    @classmethod
    def of(cls, platform: Platform, law: str) -> "Wheels":
        """Those of the platform.

        Raises:
            ControllerError: they do not turn the body about three axes, as `law` does, or some of
                them stand in gimbals.
        """
        axes = fixed_axes(platform, law)
        spin = np.array([wheel.inertia for wheel in platform.wheels])
        share = np.asarray(np.linalg.pinv(axes.T), dtype=np.float64)
        return cls(axes, spin, share, platform.inertia - (axes.T * spin) @ axes)

    def any_way_round(self, platform: Platform) -> float:
        """Torque that the motors can give about every axis [N m]."""
        limit = np.array([wheel.torque_limit for wheel in platform.wheels])
        return float(np.min(limit / np.linalg.norm(self.share, axis=1)))

    def momentum(self, estimate: Estimate) -> Array:
        """h, (n, 3) [N m s, body]."""
        # einsum rather than @: a row's last bits must not depend on how many runs there are.
        turning = np.einsum("wi,ni->nw", self.axes, estimate.rate_body)
        return np.einsum("wi,nw->ni", self.axes, self.spin * (estimate.wheel_speed + turning))

    def command(self, change: Array, estimate: Estimate, time: float) -> Command:
        """Motor torques for a change of h (n, 3) [N m, body]; none in a run not yet seen."""
        torque = np.einsum("wi,ni->nw", self.share, change)
        return {"command_wheel_torque": np.where(estimate.valid[:, None], torque, 0.0)}


@dataclass(frozen=True)
class WheeledBody:
    """A body with wheels, weight and sliding masses, as a law knows it."""

    wheels: Wheels
    moment: Array
    """(3,) m r at stage position 0 [kg m, body]."""
    slides: Array
    """(stages, 3) what a stage adds to it per position [kg]."""
    gravity: float
    """[m/s^2]."""

    @classmethod
    def of(cls, platform: Platform, law: str) -> "WheeledBody":
        """What the platform states of the body.

        Raises:
            ControllerError: as `Wheels.of`.
        """
        slides = np.array([stage.mass * stage.axis for stage in platform.stages]).reshape(-1, 3)
        wheels = Wheels.of(platform, law)
        return cls(wheels, platform.center_of_mass_offset, slides, platform.gravity)

    def tracking_torque(self, estimate: Estimate, error: Array, rate: Array, goal: Target) -> Array:
        """Change of the wheels' momentum that leaves J dw_e/dt = 0, (n, 3) [N m, body].

        h_b x w + g_g - J w x w_e - J R w_r', with h_b the whole momentum, g_g = m r x g, and R
        from the target's body frame to the body's.

        Args:
            estimate: of the body.
            error: q_e, (n, 4), of `twin.controller.pointing.pointing_error`.
            rate: w_e, (n, 3) [rad/s, body], likewise.
            goal: the target.
        """
        turning, inertia = estimate.rate_body, self.wheels.inertia
        acceleration = rotate(conjugate(error), goal.acceleration_body)
        moment = self.moment + np.einsum("nj,ji->ni", estimate.stage_position, self.slides)
        gravity = cross(moment, -self.gravity * vertical_body(estimate.attitude))
        momentum = np.einsum("ij,nj->ni", inertia, turning) + self.wheels.momentum(estimate)
        wanted = np.einsum("ij,nj->ni", inertia, cross(turning, rate) + acceleration)
        return cross(momentum, turning) + gravity - wanted


def fixed_axes(platform: Platform, law: str) -> Array:
    """Axes of the wheels, (wheels, 3), which stay where they are in the body.

    Raises:
        ControllerError: they do not turn the body about three axes, as `law` does, or some of them
            stand in gimbals.
    """
    axes = np.array([w.axis for w in platform.wheels if w.gimbal is None]).reshape(-1, 3)
    if np.linalg.matrix_rank(axes) < 3:
        raise ControllerError(
            f"{law} turns the body about three axes, but the {len(axes)} wheels of "
            f"{platform.name} do not; choose a platform whose wheels do"
        )
    carried = ", ".join(wheel.name for wheel in platform.wheels if wheel.gimbal is not None)
    if carried:
        raise ControllerError(
            f"{law} turns the body by wheels that stand still in it, but {carried} of "
            f"{platform.name} turn with a gimbal; choose a platform whose wheels are all fixed"
        )
    return axes


Exchange = Wheels | Gyros


def exchange_of(platform: Platform, law: str) -> Exchange:
    """Gyros where the platform has them, else its wheels.

    Raises:
        ControllerError: neither turns the body about three axes, as `law` does.
    """
    if len(platform.gimbals) >= 3:
        return Gyros.of(platform, law)
    return Wheels.of(platform, law)


def follow_momentum(
    exchange: Exchange, estimate: Estimate, target: Target, gain: float
) -> tuple[Array, Array]:
    """The momentum error, and the change of momentum of wheels or gyros that undoes it.

    H_s = J w,  H_d = J w_d                   of the body and its aim, body axes
    tau = -K (H_s - H_d) + w x H_s + dH_d/dt  torque on the body, -dh/dt - w x h

    It leaves d(H_s - H_d)/dt = -K (H_s - H_d) + m r x g. Source: paper 000 of docs/design.md, eq.
    22 and 35. J is that at stage position 0, and what the sliding masses carry is left out.

    Args:
        exchange: wheels or gyros.
        estimate: of the machine.
        target: its rate and acceleration; the attitude has no part in it.
        gain: K [1/s].

    Returns:
        H_s - H_d [N m s] and dh/dt [N m], both (n, 3), body axes.
    """
    inertia, rate = exchange.inertia, estimate.rate_body
    # einsum rather than @: a row's last bits must not depend on how many runs there are.
    angular = np.einsum("ij,nj->ni", inertia, rate)
    error = angular - np.einsum("ij,...j->...i", inertia, target.rate_body)
    ahead = np.einsum("ij,...j->...i", inertia, target.acceleration_body)
    momentum = angular + exchange.momentum(estimate)
    return error, gain * error - cross(rate, momentum) - ahead
