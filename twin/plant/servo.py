"""The drive of a gimbal: motor, friction that sticks, encoder, and the loop that holds its rate.

The loop is a digital one. Between two of its periods the motor's torque is held, so that the motion
is solved in closed form: parabolas, with the instant at which friction stops the part. No time step
decides whether it sticks.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.errors import PlatformError
from twin.platform import Platform
from twin.platform.parts import GimbalDrive

Array = NDArray[np.float64]


def coasted(
    angle: Array, rate: Array, torque: Array, inertia: Array, dry: Array, static: Array, time: float
) -> tuple[Array, Array]:
    """Angle and rate after `time` [s] under a constant torque and friction.

    Arrays broadcast against (n, g) [rad, rad/s, N m, kg m^2]. A part that turns is braked by `dry`;
    where it comes to rest, torques up to `static` hold it, and larger ones turn it again.
    """
    braking = (torque - dry * np.sign(rate)) / inertia
    with np.errstate(divide="ignore", invalid="ignore"):
        until = np.where(rate * braking < 0.0, -rate / braking, np.inf)
    moving = np.where(rate == 0.0, 0.0, np.minimum(until, time))
    angle = angle + moving * (rate + 0.5 * moving * braking)
    rate = np.where(until <= time, 0.0, rate + moving * braking)
    breaks = (rate == 0.0) & (np.abs(torque) > static)
    remaining = np.where(breaks, time - moving, 0.0)
    starting = (torque - dry * np.sign(torque)) / inertia
    return angle + 0.5 * remaining**2 * starting, rate + remaining * starting


@dataclass
class RateLoops:
    """The drives of all gimbals of n runs.

    u = K_p (r - w) + K_i (phi - delta)      torque of the motor [N m], within current and voltage
    phi = integral of r                      the angle to which the command has led

    r is the commanded rate, changed at most at the gimbal's acceleration; delta is the angle in
    whole steps of the encoder, w its change in a period of the loop. Where u is limited, phi is
    set back so that K_p (r - w) + K_i (phi - delta) is the limited one: nothing winds up.
    """

    drives: tuple[GimbalDrive, ...]
    angle: Array
    """(n, g) [rad]."""
    rate: Array
    """(n, g) [rad/s]."""

    def __post_init__(self) -> None:
        def row(name: str) -> Array:
            return np.array([getattr(drive, name) for drive in self.drives])

        self.friction = np.broadcast_to(row("friction"), self.angle.shape).copy()
        """(n, g) dry friction while it turns [N m]."""
        self.static = np.broadcast_to(row("static_friction"), self.angle.shape).copy()
        """(n, g) below which it sticks [N m]."""
        self._inertia, self._encoder = row("inertia"), row("encoder")
        self._proportional, self._integral = row("proportional"), row("integral")
        self._constant, self._current = row("torque_constant"), row("current_limit")
        self._voltage, self._resistance = row("voltage"), row("resistance")
        self._period = 1.0 / self.drives[0].rate
        self._wish = self.rate.copy()
        self._goal = self.angle.copy()
        self._shown = self._counted()

    def add_friction(self, torque: Array) -> None:
        """More dry friction (n, g) [N m], of an effect."""
        self.friction += torque
        self.static += torque

    def turn(
        self, target: Array, load: Array, *, steps: int, step: float, acceleration: Array
    ) -> Array:
        """Follow the rate `target` (n, g) [rad/s] for some steps of the physics.

        Args:
            target: commanded.
            load: torque on the gimbals meanwhile (n, g) [N m].
            steps: of the physics.
            step: its length [s].
            acceleration: highest change of the command (g,) [rad/s^2].

        Returns:
            Mean acceleration in each step, (n, steps, g) [rad/s^2].
        """
        mean = np.empty((len(self.angle), steps, len(self.drives)))
        periods = round(step / self._period)
        reach = acceleration * self._period
        for number in range(steps):
            angle, rate = self.angle, self.rate
            for _ in range(periods):
                self._tick(target, load, reach)
            mean[:, number] = (self.rate - rate) / step
            # the joint has that acceleration all through the step: its angle is the drive's
            self._shift(angle + 0.5 * step * (rate + self.rate) - self.angle)
        return mean

    def _shift(self, by: Array) -> None:
        self.angle = self.angle + by
        self._goal, self._shown = self._goal + by, self._shown + by

    def _tick(self, target: Array, load: Array, reach: Array) -> None:
        """One period of the loop."""
        self._wish = self._wish + np.clip(target - self._wish, -reach, reach)
        self._goal = self._goal + self._period * self._wish
        shown = self._counted()
        rate = np.where(self._encoder > 0.0, (shown - self._shown) / self._period, self.rate)
        self._shown = shown
        direct = self._proportional * (self._wish - rate)
        demanded = direct + self._integral * (self._goal - shown)
        torque = self._limited(demanded)
        with np.errstate(divide="ignore", invalid="ignore"):
            back = shown + (torque - direct) / self._integral
        self._goal = np.where((torque != demanded) & (self._integral > 0.0), back, self._goal)
        self.angle, self.rate = coasted(
            self.angle,
            self.rate,
            torque + load,
            self._inertia,
            self.friction,
            self.static,
            self._period,
        )

    def _counted(self) -> Array:
        """The angle in whole steps of the encoder."""
        width = np.where(self._encoder > 0.0, self._encoder, 1.0)
        return np.where(self._encoder > 0.0, width * np.floor(self.angle / width), self.angle)

    def _limited(self, torque: Array) -> Array:
        """Torque as far as current and voltage give it: R i + k w within the voltage."""
        current = torque / self._constant
        against = self._constant * self.rate
        low = (-self._voltage - against) / self._resistance
        high = (self._voltage - against) / self._resistance
        current = np.clip(current, np.maximum(low, -self._current), np.minimum(high, self._current))
        return self._constant * current


def rate_loops(platform: Platform, angle: Array) -> RateLoops | None:
    """The drives of a platform's gimbals, which stand at angles (n, g) [rad]; None: it states none.

    Raises:
        PlatformError: a step of the physics is no whole number of periods of their loop.
    """
    drives = tuple(gimbal.drive for gimbal in platform.gimbals if gimbal.drive is not None)
    if not drives:
        return None
    periods = platform.step * drives[0].rate
    if abs(periods - round(periods)) > 1e-6 or round(periods) < 1:
        raise PlatformError(
            platform.folder / "platform.toml",
            f"the drives' loop runs at {drives[0].rate:g} Hz, {periods:g} periods in a step of "
            f"{platform.step:g} s",
            "give [gimbals.drive] a rate that is a whole multiple of 1 / step",
        )
    return RateLoops(drives, angle.copy(), np.zeros_like(angle))
