"""How a stepper drive moves: at once at its initial speed, up a ramp, along, down a ramp, still.

MCode manual: the speed jumps to VI, ramps with A to VM, and with D down to VI, then stops. A short
move has no time to reach VM and turns round at the speed v with v^2 = VI^2 + 2 d A D / (A + D).
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Ramps:
    """What a drive plans with [microsteps, s]."""

    initial: float
    """VI."""
    maximum: float
    """VM."""
    up: float
    """A."""
    down: float
    """D."""


@dataclass(frozen=True)
class Stretch:
    """Constant acceleration for a while."""

    start: float
    position: float
    speed: float
    acceleration: float
    span: float

    def at(self, now: float) -> tuple[float, float]:
        """Position and speed."""
        t = min(max(now - self.start, 0.0), self.span)
        return (
            self.position + (self.speed + 0.5 * self.acceleration * t) * t,
            self.speed + self.acceleration * t,
        )


@dataclass(frozen=True)
class Profile:
    """Stretches one after the other, then rest at `target`."""

    stretches: tuple[Stretch, ...]
    target: float

    @property
    def end(self) -> float:
        """When it comes to rest; infinite for a slew."""
        return self.stretches[-1].start + self.stretches[-1].span if self.stretches else -math.inf

    def at(self, now: float) -> tuple[float, float]:
        """Position and speed."""
        if now >= self.end:
            return self.target, 0.0
        stretch = next(s for s in self.stretches if now < s.start + s.span)
        return stretch.at(now)


def at_rest(position: float) -> Profile:
    """Standing still."""
    return Profile((), position)


def move(position: float, target: float, ramps: Ramps, start: float) -> Profile:
    """From rest to rest."""
    distance, sign = abs(target - position), 1.0 if target >= position else -1.0
    if distance == 0.0:
        return at_rest(position)
    low, high, up, down = ramps.initial, ramps.maximum, ramps.up, ramps.down
    ramp = (high**2 - low**2) / 2.0 * (1.0 / up + 1.0 / down)
    if ramp > distance:
        high = math.sqrt(low**2 + 2.0 * distance * up * down / (up + down))
        ramp = distance
    spans = ((high - low) / up, (distance - ramp) / high, (high - low) / down)
    speeds, accelerations = (low, high, high), (up, 0.0, -down)
    stretches: list[Stretch] = []
    for span, speed, acceleration in zip(spans, speeds, accelerations, strict=True):
        stretches.append(Stretch(start, position, sign * speed, sign * acceleration, span))
        position, _ = stretches[-1].at(start + span)
        start += span
    return Profile(tuple(stretches), target)


def slew(position: float, speed: float, ramps: Ramps, start: float) -> Profile:
    """From rest to a speed, and on for ever."""
    sign, high = (1.0 if speed >= 0.0 else -1.0), abs(speed)
    low = min(ramps.initial, high)
    ramp = Stretch(start, position, sign * low, sign * ramps.up, (high - low) / ramps.up)
    reached, _ = ramp.at(start + ramp.span)
    return Profile((ramp, Stretch(start + ramp.span, reached, speed, 0.0, math.inf)), math.inf)


def stop(profile: Profile, ramps: Ramps, now: float) -> Profile:
    """Down the ramp from whatever goes on at `now`; rests on a whole microstep."""
    position, speed = profile.at(now)
    sign, fast = (1.0 if speed >= 0.0 else -1.0), abs(speed)
    if fast <= ramps.initial:
        return at_rest(round(position))
    span = (fast - ramps.initial) / ramps.down
    ramp = Stretch(now, position, speed, -sign * ramps.down, span)
    return Profile((ramp,), round(ramp.at(now + span)[0]))
