"""Hold or follow a place and an attitude with thrusters, beside wheels or gyros where there are."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from twin.controller import Controller
from twin.controller.exchange import Exchange, VariableSpeedGyros, Wheels, exchange_of
from twin.controller.pointing import pointing_error
from twin.controller.thrusters import Wrenches
from twin.drives import travelling_mass
from twin.errors import ControllerError
from twin.platform import Platform
from twin.rotation import conjugate, cross, rotate, vertical_body
from twin.signals import Command, Estimate, Target
from twin.units import STANDARD_GRAVITY

Array = NDArray[np.float64]


_NEARLY = 0.9
"""Of what a wheel holds: it is full."""


@dataclass(frozen=True)
class Station:
    """What the law remembers."""

    owed: Array
    """(n, 6) impulse of force [N s] and torque [N m s] that was asked for and not given, body."""
    anchor: Array
    """(n, 3) where each run was first seen [m], NaN before: its place where none is asked for."""
    emptying: NDArray[np.bool_]
    """(n,) runs whose thrusters take momentum off wheels or gyros."""
    nozzles: Wrenches
    exchange: Exchange | VariableSpeedGyros | None
    torque: float
    """Largest of wheels or gyros about each axis [N m]."""
    full: float
    """|h| beyond which they are emptied [N m s]."""
    emptying_torque: float
    """[N m]."""
    mass: float
    """Of all that travels [kg]."""
    gas: Array
    """(n,) let out [kg]."""
    exhaust_speed: float
    """[m/s]; infinite where no gas is counted."""
    weight: Array
    """(3,) m r of a kilogram of gas in its tanks times gravity [N m/kg, body]."""


@dataclass(frozen=True)
class ThrusterFive(Controller[Station]):
    """Feedback of place and attitude by thrusters that push and turn, sharing torque with gyros.

    f   = m (a_d + k_v (v_d - v) + k_x (x_d - x) - d)    force [N, room], none along the vertical
    tau = -K_p q_e,vec - K_d w_e + m_g r_g x g           torque on the body [N m, body]
    F, g = arg min sum F_i + price sum |g_j|,  M F + (0, g) = (R^T f, tau - e h / |h|)

    d is the acceleration that no command explains, as the estimate has it: it stands where an
    integral would. m_g is the gas that the law has let out, from tanks at r_g: what it weighed is
    made up for. F are forces of thrusters, g a torque that wheels or gyros give the body.

    - Beyond the limits force and torque are scaled alike (`twin.controller.thrusters.Wrenches`).
    - A valve opens for `pulse` at least, or for a tick where it is on-off: what that is too coarse
      for is owed and saved for the next ticks, but for the torque that wheels or gyros give in
      its place. What is beyond the limits is not owed.
    - Wheels or gyros whose momentum |h| passes `full`, or nine tenths of what the smallest wheel in
      the body holds, are emptied by the thrusters, with a torque of size e, in |h| / e seconds;
      until then they give no other torque. e is `emptying`, or as much as the wheels' motors give
      any way round.
    - Without a place in the target a run stays where it was first seen. On a base that stays in
      its place only the attitude is left.

    Source: S. Y. Choi, Automatic mass balancing system for the 5-DOF spacecraft simulator, Georgia
    Institute of Technology 2016, section 1.2, which names translation and rotation by twelve
    thrusters, and moments shared with the gyros, and prints no law.
    """

    reference = "hold+place:0,0"

    place: float = field(default=0.09, metadata={"unit": "1/s^2"})
    """k_x."""
    speed: float = field(default=0.6, metadata={"unit": "1/s"})
    """k_v."""
    proportional: float = field(default=5.0, metadata={"unit": "N m"})
    """K_p, per unit of the error quaternion's vector part."""
    derivative: float = field(default=8.0, metadata={"unit": "N m s"})
    """K_d, per rate error."""
    pulse: float = field(default=0.01, metadata={"unit": "s"})
    """Shortest opening of a valve; usual for solenoid valves, no paper prints it. 0 for none."""
    price: float = field(default=0.1, metadata={"unit": "1/m"})
    """Thrust that a torque of 1 N m by wheels or gyros is worth."""
    torque: float = field(default=1.5, metadata={"unit": "N m"})
    """Largest torque of wheels or gyros about each axis; 0: thrusters do it all."""
    full: float = field(default=5.0, metadata={"unit": "N m s"})
    """|h| beyond which they are emptied."""
    emptying: float = field(default=0.6, metadata={"unit": "N m"})
    """e."""

    def init(self, platform: Platform, n: int) -> Station:
        """Nothing owed, no run seen yet."""
        law = "thruster_five"
        if platform.base.travels and "position" not in platform.sensors:
            raise ControllerError(
                f"{law} holds a place, and no sensor of {platform.name} shows it; give it "
                "[sensors.position]"
            )
        shared = self.torque > 0.0 and bool(platform.gimbals or platform.wheels)
        exchange = None
        if shared and any(wheel.gimbal is not None for wheel in platform.wheels):
            exchange = VariableSpeedGyros.of(platform, law)
        elif shared:
            exchange = exchange_of(platform, law)
        speed, weight, gas = np.inf, np.zeros(3), platform.gas
        if gas is not None and gas.tanks and not platform.base.on_floor:
            speed = gas.specific_impulse * STANDARD_GRAVITY
            weight = platform.gravity * gas.moment
        most, holds = np.inf, np.inf
        if isinstance(exchange, Wheels):
            most = exchange.any_way_round(platform)
            holds = _NEARLY * min(wheel.momentum_limit for wheel in platform.wheels)
        return Station(
            owed=np.zeros((n, 6)),
            anchor=np.full((n, 3), np.nan),
            emptying=np.zeros(n, dtype=np.bool_),
            nozzles=Wrenches.of(platform, law, price=np.inf if exchange is None else self.price),
            exchange=exchange,
            torque=min(self.torque, most),
            full=min(self.full, holds),
            emptying_torque=min(self.emptying, most),
            mass=travelling_mass(platform),
            gas=np.zeros(n),
            exhaust_speed=speed,
            weight=weight,
        )

    def update(
        self, state: Station, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Station]:
        """Mean force of each thruster over the tick, and what wheels or gyros do; nothing in a run
        that has not been seen yet."""
        error, rate_error = pointing_error(estimate, target)
        torque = -self.proportional * error[:, 1:] - self.derivative * rate_error
        down = -vertical_body(estimate.attitude)
        torque = torque + state.gas[:, None] * cross(state.weight, down)
        force, anchor = self._force(state, estimate, target)
        nozzles, tick, valid = state.nozzles, state.nozzles.tick, estimate.valid[:, None]

        held, taken, allowed = np.zeros_like(torque), np.zeros_like(torque), None
        emptying = state.emptying
        if state.exchange is not None:
            held = state.exchange.momentum(estimate)
            size = np.sqrt(np.einsum("ni,ni->n", held, held))
            torque_size = state.emptying_torque
            emptying = (size > state.full) | (emptying & (size > torque_size * tick))
            share = np.where(emptying, torque_size / np.maximum(size, 1e-9), 0.0)
            taken = share[:, None] * held
            allowed = np.where(emptying, 0.0, state.torque)

        asked = np.concatenate([force, torque - taken], axis=1) + state.owed / tick
        wanted = nozzles.allocate(asked, allowed)
        opened = nozzles.pulsed(wanted.force, self.pulse)
        left = wanted.scale[:, None] * asked - nozzles.wrench(opened)
        command = {"command_thruster": np.where(valid, opened, 0.0)}
        if state.exchange is not None and allowed is not None:
            most = allowed[:, None]
            given = np.minimum(np.maximum(left[:, 3:], -most), most)
            left = np.concatenate([left[:, :3], left[:, 3:] - given], axis=1)
            change = -(given + taken) - cross(estimate.rate_body, held)
            command |= state.exchange.command(change, estimate, time)
        owed = np.where(valid, tick * nozzles.counted(left), state.owed)
        fired = np.sum(command["command_thruster"], axis=1)
        gas = state.gas + fired * (tick / state.exhaust_speed)
        return command, replace(state, owed=owed, anchor=anchor, emptying=emptying, gas=gas)

    def _force(self, state: Station, estimate: Estimate, target: Target) -> tuple[Array, Array]:
        """On the machine (n, 3) [N, body], and where each run was first seen (n, 3) [m]."""
        position, velocity = estimate.position, estimate.velocity
        if position is None or velocity is None:
            return np.zeros_like(estimate.rate_body), state.anchor
        anchor = np.where(np.isnan(state.anchor), position, state.anchor)
        push = self.place * ((anchor if target.position is None else target.position) - position)
        push = push - self.speed * velocity
        if target.velocity is not None:
            push = push + self.speed * target.velocity
        if target.acceleration is not None:
            push = push + target.acceleration
        if estimate.disturbance is not None:
            push = push - estimate.disturbance
        level = np.array([1.0, 1.0, 0.0])
        push = np.where(np.isfinite(push), push, 0.0) * level
        return rotate(conjugate(estimate.attitude), state.mass * push), anchor
