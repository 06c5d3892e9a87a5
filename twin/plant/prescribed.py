"""Joints that follow a profile, whatever pushes back: sliding masses, gimbals, rotors.

Motion of sliding masses: trapezoidal moves, planned one step of the drive at a time.
Each such step holds one acceleration and is one physics step or several, so the motion that is fed
to MuJoCo as a prescribed joint is exact on the grid of those. The acceleration is Han's discrete
time-optimal feedback ("From PID to Active Disturbance Rejection Control", IEEE Trans. Ind.
Electron. 56(3), 2009): it brings distance and speed to rest in the fewest steps, past the target by
less than a tenth of limit * step^2.

MuJoCo is given the force that moves their armature as planned; after each tick they are put
exactly on their profile.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.model import Machine
from twin.plant.servo import rate_loops
from twin.platform import Platform
from twin.rotation import cross

Array = NDArray[np.float64]


def ramp(
    angle: Array, rate: Array, target: Array, *, steps: int, step: float, max_acceleration: Array
) -> tuple[Array, Array, Array]:
    """Bring the rate to `target` for a number of steps.

    Arrays are (n, g) [rad, rad/s]; the limit is (g,) [rad/s^2].

    Returns:
        Accelerations held in each step (n, steps, g) [rad/s^2], angle and rate at the end.
    """
    reach = (max_acceleration * step) * np.arange(steps + 1)[:, None]
    rates = rate[:, None] + np.clip((target - rate)[:, None], -reach, reach)
    turned = step * (0.5 * (rates[:, 0] + rates[:, -1]) + rates[:, 1:-1].sum(axis=1))
    return np.diff(rates, axis=1) / step, angle + turned, rates[:, -1]


_ARRIVED = 1e-16
"""[m]: a stage that moves less than this in a step, within ten times this of its target, is put
there at rest. The jump in speed changes the machine's momentum, so it must be of the size of
rounding."""


def plan(
    position: Array,
    speed: Array,
    target: Array,
    *,
    steps: int,
    step: float,
    max_speed: Array,
    max_acceleration: Array,
) -> tuple[Array, Array, Array]:
    """Move towards `target` for a number of steps.

    Arrays are (n, s) [m, m/s]; limits (s,) [m/s, m/s^2].

    Returns:
        Accelerations held in each step (n, steps, s) [m/s^2], position and speed at the end.
    """
    acceleration = np.zeros((len(position), steps, position.shape[1]))
    if len(position) == 1:
        # of a few numbers NumPy's calls cost far more than the sums
        position, speed = position.copy(), speed.copy()
        for i, (fastest, limit) in enumerate(zip(max_speed, max_acceleration, strict=True)):
            drive = _Drive(float(target[0, i]), float(fastest), float(limit), step)
            pulls, position[0, i], speed[0, i] = drive.plan(
                float(position[0, i]), float(speed[0, i]), steps
            )
            acceleration[0, :, i] = pulls
        return acceleration, position, speed
    for k in range(steps):
        pull = _time_optimal(position - target, speed, max_acceleration, step)
        pull = np.clip(pull, (-max_speed - speed) / step, (max_speed - speed) / step)
        position = position + step * speed + 0.5 * step * step * pull
        speed = speed + step * pull
        acceleration[:, k] = pull
        arrived = (np.abs(position - target) < 10.0 * _ARRIVED) & (np.abs(speed) < _ARRIVED / step)
        position = np.where(arrived, target, position)
        speed = np.where(arrived, 0.0, speed)
    return acceleration, position, speed


def _time_optimal(distance: Array, speed: Array, limit: Array, step: float) -> Array:
    """Han's fhan, for x+ = x + h v + h^2 u / 2: the shift by half a step's travel is his y."""
    d = limit * step * step
    moved = step * speed
    y = distance + 0.5 * moved
    root = np.sqrt(d * (d + 8.0 * np.abs(y)))
    far = moved + np.sign(y) * (root - d) * 0.5
    near = moved + y
    inside = np.abs(y) <= d
    a = np.where(inside, near, far)
    return -limit * np.clip(a / d, -1.0, 1.0)


class _Drive(NamedTuple):
    """One stage of one run: the same law as for arrays, to the bit."""

    target: float
    """[m]."""
    max_speed: float
    """[m/s]."""
    max_acceleration: float
    """[m/s^2]."""
    step: float
    """[s]."""

    def plan(self, position: float, speed: float, steps: int) -> tuple[list[float], float, float]:
        """Accelerations held in each step [m/s^2], position [m] and speed [m/s] at the end."""
        step = self.step
        pulls: list[float] = []
        for _ in range(steps):
            pull = self._time_optimal(position - self.target, speed)
            pull = max(pull, (-self.max_speed - speed) / step)
            pull = min(pull, (self.max_speed - speed) / step)
            position = position + step * speed + 0.5 * step * step * pull
            speed = speed + step * pull
            pulls.append(pull)
            near = abs(position - self.target) < 10.0 * _ARRIVED
            if near and abs(speed) < _ARRIVED / step:
                position, speed = self.target, 0.0
        return pulls, position, speed

    def _time_optimal(self, distance: float, speed: float) -> float:
        d = self.max_acceleration * self.step * self.step
        moved = self.step * speed
        y = distance + 0.5 * moved
        if abs(y) <= d:
            a = moved + y
        else:
            root = math.sqrt(d * (d + 8.0 * abs(y)))
            a = moved + math.copysign(1.0, y) * (root - d) * 0.5
        return -self.max_acceleration * min(max(a / d, -1.0), 1.0)


DRIVE = 0.01
"""Longest time for which a drive holds an acceleration [s]. A profile depends on it, so it must not
depend on how finely the physics is stepped."""


class PrescribedJoints:
    """Their profiles in n runs."""

    def __init__(self, machine: Machine, qpos: Array, qvel: Array) -> None:
        """Start where `qpos` (n, nq) and `qvel` (n, nv) are; both are written to by `pin`."""
        platform = machine.platform
        self._machine = machine
        self._qpos, self._qvel = qpos, qvel
        self._held = _held(platform)
        self._period = self._held * platform.step
        self._inertia = machine.stage_inertia, machine.gimbal_inertia
        stages, gimbals = platform.stages, platform.gimbals
        self._has_stages, self._has_gimbals = bool(stages), bool(gimbals)
        self.stage_position = qpos[:, machine.stage_qpos].copy()
        """(n, stages) [m]."""
        self._stage_speed = np.zeros_like(self.stage_position)
        self._stage_wish = self.stage_position.copy()
        self._late = [round(stage.response / platform.tick) for stage in stages]
        kept = 1 + max(self._late, default=0)
        self._sent = deque([self._stage_wish] * kept, maxlen=kept)
        self._max_speed = np.array([stage.speed for stage in stages])
        self._max_acceleration = np.array([stage.acceleration for stage in stages])
        self._driven: Array | None = None
        self._gimbal_angle = qpos[:, machine.gimbal_qpos].copy()
        self._gimbal_rate = np.zeros_like(self._gimbal_angle)
        self._gimbal_target = self._gimbal_rate
        self._gimbal_acceleration = np.array([gimbal.acceleration for gimbal in gimbals])
        self.loops = rate_loops(platform, self._gimbal_angle)
        """Of gimbals whose drives are stated."""
        self._gyros = None if self.loops is None else _Gyros(machine)
        self._qvel[:, machine.rotor_dof] = [rotor.speed for rotor in platform.rotors]

    def send_stages(self, position: Array) -> None:
        """Positions (n, stages) [m] to go for, once the drives respond."""
        self._stage_wish = position

    def drive_stages(self, position: Array) -> None:
        """Where drives that are none of ours bring them by the end of the next tick, (n, stages)
        [m]; from now on no profile is planned here."""
        self._driven = position

    def send_gimbals(self, rate: Array) -> None:
        """Rates (n, gimbals) [rad/s] to go for."""
        self._gimbal_target = rate

    def forces(self, steps: int) -> Array | None:
        """Forces (n, steps, nv) on the joints in the next tick; None while none accelerates."""
        target = self._responded()
        force: Array | None = None
        if self._driven is not None:
            force = self._follow(self._driven, steps)
        elif self._has_stages and (
            self._stage_speed.any() or (self.stage_position != target).any()
        ):
            acceleration, self.stage_position, self._stage_speed = plan(
                self.stage_position,
                self._stage_speed,
                target,
                steps=steps // self._held,
                step=self._period,
                max_speed=self._max_speed,
                max_acceleration=self._max_acceleration,
            )
            force = self.no_forces(steps)
            push = np.repeat(acceleration, self._held, axis=1) * self._inertia[0]
            force[:, :, self._machine.stage_dof] = push
        if self.loops is not None and self._gyros is not None:
            acceleration = self.loops.turn(
                self._gimbal_target,
                self._gyros.load(self._qpos, self._qvel),
                steps=steps,
                step=self._machine.platform.step,
                acceleration=self._gimbal_acceleration,
            )
            self._gimbal_angle, self._gimbal_rate = self.loops.angle, self.loops.rate
            force = self.no_forces(steps) if force is None else force
            force[:, :, self._machine.gimbal_dof] = acceleration * self._inertia[1]
        elif self._has_gimbals:
            if (self._gimbal_rate == self._gimbal_target).all():
                self._gimbal_angle = self._gimbal_angle + (
                    self._gimbal_rate * (steps * self._machine.platform.step)
                )
                return force
            acceleration, self._gimbal_angle, self._gimbal_rate = ramp(
                self._gimbal_angle,
                self._gimbal_rate,
                self._gimbal_target,
                steps=steps // self._held,
                step=self._period,
                max_acceleration=self._gimbal_acceleration,
            )
            force = self.no_forces(steps) if force is None else force
            push = np.repeat(acceleration, self._held, axis=1) * self._inertia[1]
            force[:, :, self._machine.gimbal_dof] = push
        return force

    def _responded(self) -> Array:
        """Positions (n, stages) [m] that the drives go for in the next tick, each its response
        after they were sent."""
        self._sent.append(self._stage_wish)
        if not any(self._late):
            return self._stage_wish
        columns = [self._sent[-1 - late][:, i] for i, late in enumerate(self._late)]
        return np.stack(columns, axis=1)

    def _follow(self, position: Array, steps: int) -> Array | None:
        """The force that brings the stages to the mean speed of the way there; None: they rest."""
        duration = steps * self._machine.platform.step
        speed = (position - self.stage_position) / duration
        acceleration = (speed - self._stage_speed) / duration
        self.stage_position, self._stage_speed = position, speed
        if not acceleration.any():
            return None
        force = self.no_forces(steps)
        force[:, :, self._machine.stage_dof] = (acceleration * self._inertia[0])[:, None]
        return force

    def pin(self) -> None:
        """Put the joints on their profile: what pushed back in a tick is forgotten."""
        machine = self._machine
        if self._has_stages:
            self._qpos[:, machine.stage_qpos] = self.stage_position
            self._qvel[:, machine.stage_dof] = self._stage_speed
        if self._has_gimbals:
            self._qpos[:, machine.gimbal_qpos] = self._gimbal_angle
            self._qvel[:, machine.gimbal_dof] = self._gimbal_rate

    def no_forces(self, steps: int) -> Array:
        """Zeros of the shape of `forces`."""
        return np.zeros((len(self._qpos), steps, self._machine.model.nv))


class _Gyros:
    """What spins in the gimbals, and how its momentum turns them."""

    def __init__(self, machine: Machine) -> None:
        platform = machine.platform
        self._machine = machine
        carried = {part.gimbal: part for part in (*platform.rotors, *platform.wheels)}
        self._axis = np.array([g.axis for g in platform.gimbals]).reshape(-1, 3)
        spin = [carried[g.name].axis for g in platform.gimbals]
        self._spin = np.array(spin).reshape(-1, 3)
        fixed = {rotor.gimbal: rotor.momentum for rotor in platform.rotors}
        self._fixed = np.array([fixed.get(g.name, 0.0) for g in platform.gimbals])
        self._wheel = np.array(
            [[w.inertia * (w.gimbal == g.name) for w in platform.wheels] for g in platform.gimbals]
        ).reshape(len(platform.gimbals), len(platform.wheels))

    def load(self, qpos: Array, qvel: Array) -> Array:
        """-g . (w x h) (n, gimbals) [N m]: what the turning body does to a gimbal."""
        machine = self._machine
        angle, rate = qpos[:, machine.gimbal_qpos, None], qvel[:, machine.base_dof]
        along = np.cos(angle) * self._spin + np.sin(angle) * cross(self._axis, self._spin)
        # einsum rather than @: a row's last bits must not depend on how many runs there are
        size = self._fixed + np.einsum("gw,nw->ng", self._wheel, qvel[:, machine.wheel_dof])
        return -size * np.einsum("gi,ngi->ng", self._axis, cross(rate[:, None], along))


def _held(platform: Platform) -> int:
    """Physics steps for which a drive holds an acceleration; a tick has a whole number of such."""
    steps = platform.steps_per_tick
    most = max(1, int(DRIVE / platform.step + 1e-6))
    return max(k for k in range(1, min(most, steps) + 1) if steps % k == 0)
