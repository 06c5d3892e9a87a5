"""What is known of one stage between two looks at it, and what a new look means.

The counter of an open-loop drive can be believed as long as it lies where the last order allows:
between the start of the move and its target. Whatever is outside is doubted, and the second time it
means that the position is lost.
"""

from dataclasses import dataclass

from twin.plant.devices.mdrive.settings import DriveSettings
from twin.plant.devices.mdrive.tables import Effect, error_named

_SLACK = 2
"""Microsteps that a counter may lie outside of its move: it is printed while it changes."""
_PATIENCE = 0.1
"""So long after an order [s] a drive that stands has not heard it."""
_GRACE = 0.5
"""So long after the end of its move [s] a drive still says that it moves: it is stuck."""
_ORDERS = 3
"""So often an order is given."""
_FRESH = 0.5
"""An order that could not be given for so long [s] is dropped: whoever gave it may be dead."""


@dataclass(frozen=True, slots=True)
class Look:
    """What a drive says of itself."""

    position: int
    """P [microsteps]."""
    moving: bool
    """MV."""
    time: float
    """Of the host [s]."""


class Tracker:
    """One stage."""

    def __init__(self, settings: DriveSettings) -> None:
        self.settings = settings
        self.position = 0
        self.homed = False
        self.moving = False
        self.stopping = False
        self.lost = ""
        """Why the position cannot be trusted; empty: it can, once homed."""
        self.unread = False
        """It has an error, and no answer came to the question which."""
        self.notes: list[str] = []
        self._start = self._target = 0
        self._given = 0.0
        self._orders = 0
        self._pending: tuple[int, float] | None = None
        self._blocked = 0
        self._doubts = 0

    @property
    def target(self) -> int:
        """Where it rests when what was ordered is done [microsteps]."""
        return self._target

    @property
    def doubted(self) -> bool:
        """The last look could not be believed, or the position is lost."""
        return bool(self._doubts or self.unread or self.lost)

    @property
    def name(self) -> str:
        """For messages."""
        return f"stage {self.settings.part} (drive {self.settings.address})"

    def rest(self, position: int) -> None:
        """It stands there, and is believed."""
        self.position = self._start = self._target = position
        self.moving = self.stopping = self.unread = False
        self._pending, self._orders, self._doubts, self._blocked = None, 0, 0, 0

    def allow(self, wanted: int) -> int:
        """The nearest target [microsteps] that travel, reach and limit switches let it have."""
        settings, here = self.settings, self._target
        low, high = (settings.steps(end) for end in settings.travel)
        allowed = max(min(wanted, high), low)
        # after the travel: a stage beyond it, above or below, is let back and not made to leap
        allowed = max(min(allowed, here + settings.reach), here - settings.reach)
        if self._blocked > 0:
            return min(allowed, here)
        return max(allowed, here) if self._blocked < 0 else allowed

    def want(self, target: int, now: float) -> None:
        """Go there as soon as it stands; what was wanted before is forgotten."""
        self._pending = (target, now)

    def drop(self) -> None:
        """Nothing is wanted any more."""
        self._pending = None

    def order(self, now: float) -> int | None:
        """The target that should be sent to the drive now, and counts as given; None: nothing."""
        if self.moving or self.stopping or self.lost:
            return None
        if self._pending is not None:
            (target, wanted), self._pending = self._pending, None
            # a loop wants the same in every tick: that is no new order, and must not renew the old
            if target != self._target:
                if now - wanted > _FRESH:
                    return None
                return self._give(target, now)
        if self.position == self._target or now - self._given < _PATIENCE:
            return None
        if self._orders >= _ORDERS:
            self.notes.append(f"{self.name}: does not move, {_ORDERS} orders were in vain")
            self.rest(self.position)
            return None
        self._given = now
        self._orders += 1
        return self._target

    def look(self, look: Look) -> str:
        """Take what the drive says; why it cannot be believed, or nothing."""
        low, high = sorted((self._start, self._target))
        if not low - _SLACK <= look.position <= high + _SLACK:
            return self.doubt(
                f"{self.name}: counter at {look.position}, not in {low} to {high}",
                f"{self.name}: its counter leapt from {self.position} to {look.position} "
                f"microsteps outside of {low} to {high}; capture the table and home it again",
            )
        self._doubts = 0
        self.position, self.moving = look.position, look.moving
        if look.moving:
            if look.time > self._given + self._longest() + _GRACE and not self.stopping:
                self.lost = (
                    f"{self.name}: says that it moves, long after its move must have ended; "
                    "switch it off and on, and home it again"
                )
            return self.lost
        if look.position != self._target and (self.stopping or look.position != self._start):
            if not self.stopping:
                self.notes.append(
                    f"{self.name}: stopped at {1e3 * self.settings.metres(look.position):.3f} mm, "
                    f"short of {1e3 * self.settings.metres(self._target):.3f} mm"
                )
            blocked, pending = self._blocked, self._pending
            self.rest(look.position)
            self._blocked, self._pending = blocked, pending
        elif look.position == self._target:
            self._start = self._target
        self.stopping = False
        return ""

    def doubt(self, reason: str, loss: str) -> str:
        """A look that cannot be; two in a row mean a loss, for one may be a wrong bit."""
        self._doubts += 1
        if self._doubts > 1:
            self.lost = loss
        return self.lost or reason

    def moved_off(self) -> None:
        """An order away from a limit switch was given: the switch blocks no more."""
        if self._blocked * (self._target - self._start) < 0:
            self._blocked = 0

    def hear_error(self, code: int | None) -> str:
        """Take an error code that was asked for; why the position cannot be believed, or nothing.

        Args:
            code: None: no answer came.
        """
        self.unread = code is None
        if code is None:
            return f"{self.name}: has an error, and which was not to be heard"
        self.complain(code)
        return self.lost

    def lose_error(self) -> str:
        """The code was read, which clears it, and the answer was lost: it may have been any."""
        self.unread = False
        self.lost = (
            f"{self.name}: had an error whose code was lost on the line, perhaps a stall; capture "
            "the table and home it again"
        )
        self.notes.append(self.lost)
        return self.lost

    def complain(self, code: int) -> None:
        """Take an error code of the drive."""
        if code == 0:
            return
        error = error_named(code)
        sentence = f"{self.name}: {error.sentence} (error {code})"
        self.notes.append(sentence)
        if error.effect is Effect.lost:
            self.lost = sentence + "; capture the table and home it again"
        elif error.effect is Effect.limit:
            self._blocked = 1 if code == 83 else -1
            self._pending = None

    def _give(self, target: int, now: float) -> int:
        self._start, self._target = self.position, target
        self._given, self._orders = now, 1
        return target

    def _longest(self) -> float:
        settings = self.settings
        distance = abs(self._target - self._start)
        ramps = 2.0 * settings.speed / settings.acceleration
        return distance / settings.rate(settings.speed) + ramps + settings.settling * 1e-3
