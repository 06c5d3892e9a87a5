"""The motor, screw and switches behind an emulated MDrive."""

import math
from dataclasses import dataclass, field

from twin.emulate.trapezoid import Profile, Ramps, at_rest, move, slew, stop

LIMIT_PLUS, LIMIT_MINUS, STALLED, NO_HOME, BOTH_LIMITS = 83, 84, 86, 80, 82
"""Error codes of a motion."""


@dataclass
class Axis:
    """A stage: what the drive counts, and where the carriage really is."""

    position: int = 0
    """Where the carriage stands at the start, from the middle of its travel [microsteps]."""
    travel: int = 503_937
    """Either way to the limit switches [microsteps]; 25 mm of a 2.54 mm screw."""
    margin: int = 20_000
    """From a limit switch to the end stop."""
    home: int = 0
    """The home switch is closed from here on towards minus."""
    profile: Profile = field(default_factory=lambda: at_rest(0.0))
    homing: int = 0
    stuck: bool = False
    """It says that it moves, for ever."""

    def __post_init__(self) -> None:
        self._offset = self.position
        """Carriage less counter."""
        self._phase = 0
        self._braking = set[int]()
        """Limit switches on which it brakes."""

    def counter(self, now: float) -> int:
        """P."""
        return round(self.profile.at(now)[0])

    def speed(self, now: float) -> int:
        """V [microsteps/s]."""
        return round(self.profile.at(now)[1])

    def carriage(self, now: float) -> float:
        """Where it really is, from the middle of its travel [microsteps]."""
        return self.profile.at(now)[0] + self._offset

    def moving(self, now: float) -> bool:
        """MV."""
        return self.stuck or now < self.profile.end or self.homing > 0

    def count_from(self, value: int, now: float) -> None:
        """P = value, at rest."""
        self._offset += self.counter(now) - value
        self.profile = at_rest(value)

    def go(self, target: int, ramps: Ramps, now: float) -> None:
        self.profile = move(self.counter(now), target, ramps, now)

    def run(self, speed: float, ramps: Ramps, now: float) -> None:
        if speed:
            self.profile = slew(self.counter(now), speed, ramps, now)
        else:
            self.homing = 0
            self.profile = stop(self.profile, ramps, now)

    def halt(self, now: float) -> None:
        """At once, without a ramp."""
        self.homing = 0
        self.profile = at_rest(self.counter(now))

    def seek(self, way: int, ramps: Ramps, now: float) -> None:
        """HM 1..4: 1 and 2 go to minus, 3 and 4 to plus; 1 and 3 creep back, 2 and 4 on."""
        self.homing, self._phase = way, 0
        self.run(-ramps.maximum if way < 3 else ramps.maximum, ramps, now)

    def watch(self, ramps: Ramps, switches: frozenset[int], now: float) -> int:
        """Follow switches and stops up to `now`; an error code, or 0.

        `switches`: kinds of inputs that are set up: 1 home, 2 limit plus, 3 limit minus.
        """
        carriage, speed = self.carriage(now), self.profile.at(now)[1]
        if abs(carriage) > self.travel + self.margin and speed * carriage > 0.0:
            # the end stop: the motor slips, the counter goes on
            self._offset -= round(carriage - math.copysign(self.travel + self.margin, carriage))
        for kind, sign, code in ((2, 1.0, LIMIT_PLUS), (3, -1.0, LIMIT_MINUS)):
            pressed = kind in switches and sign * carriage >= self.travel
            if not pressed or speed == 0.0:
                self._braking.discard(kind)
            elif sign * speed > 0.0 and kind not in self._braking:
                self._braking.add(kind)
                self.homing = 0
                self.profile = stop(self.profile, ramps, now)
                return code
        if self.homing:
            return self._seek_on(ramps, switches, now)
        return 0

    def _seek_on(self, ramps: Ramps, switches: frozenset[int], now: float) -> int:
        if 1 not in switches:
            self.halt(now)
            return NO_HOME
        to_minus = self.homing < 3
        closed = self.carriage(now) <= self.home
        found = closed if to_minus else not closed
        creep = Ramps(ramps.initial, ramps.initial, ramps.up, ramps.down)
        back = 1.0 if to_minus else -1.0
        if self._phase == 0 and found:
            self.profile = stop(self.profile, ramps, now)
            self._phase = 1
        elif self._phase == 1 and now >= self.profile.end:
            fast = ramps if self.homing in (2, 4) else creep
            self.profile = slew(self.counter(now), back * fast.maximum, fast, now)
            self._phase = 2
        elif self._phase == 2 and not found:
            self.profile = stop(self.profile, ramps, now)
            self._phase = 3 if self.homing in (2, 4) else 5
        elif self._phase == 3 and now >= self.profile.end:
            self.profile = slew(self.counter(now), -back * creep.maximum, creep, now)
            self._phase = 4
        elif self._phase == 4 and found:
            self.profile = stop(self.profile, ramps, now)
            self._phase = 5
        elif self._phase == 5 and now >= self.profile.end:
            self.homing = 0
        return 0
