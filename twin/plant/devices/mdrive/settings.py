"""What must be known of MDrive stages before their line is opened."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from twin.errors import UsageError
from twin.plant.devices.mdrive.tables import HOME_INPUT, SETTABLE

_MICROSTEPS = (1, 2, 4, 5, 8, 10, 16, 25, 32, 50, 64, 100, 108, 125, 127, 128, 180, 200, 250, 256)


@dataclass(frozen=True, kw_only=True)
class DriveSettings:
    """One drive and the stage that it moves; plus is where its counter grows."""

    address: str
    """Its name on the line (DN), one letter or digit; saved in the drive by the laboratory."""
    part: str
    """The stage, as the platform calls it."""
    travel: tuple[float, float]
    """Soft limits [m], 0 where the counter is 0."""
    speed: float
    """Maximum speed, VM [m/s]. The factory value is 38.1 mm/s on this screw."""
    acceleration: float = 0.0508
    """Up and down the ramp, A and D [m/s^2]."""
    initial_speed: float = 5.08e-5
    """VI [m/s]."""
    lead: float = 2.54e-3
    """Travel of a turn [m]; 0.1 inch."""
    full_steps: int = 200
    """Of the motor, a turn."""
    microsteps: int = 256
    """A full step, MS. It is read, and never changed: the counter would mean something else."""
    run_current: int = 25
    """RC [%]."""
    hold_current: int = 5
    """HC [%]. A stage that must not slip on a floating table may need more."""
    settling: int = 0
    """MT: so long after a move it counts as moving [ms]."""
    inputs: Mapping[int, tuple[int, int]] = field(default_factory=dict[int, tuple[int, int]])
    """Input 1 to 4 -> kind (1 home, 2 limit plus, 3 limit minus) and active level (0, 1)."""
    limit_behaviour: int = 1
    """LM: 1 to 3 stop on the ramp, 4 to 6 at once."""
    home_method: int = 1
    """HM: 1 and 2 seek towards minus, 3 and 4 towards plus; 1 and 3 creep back, 2 and 4 on."""
    home_speed: float = 1e-3
    """[m/s]"""
    home_position: float = 0.0
    """Where the home switch is [m]."""

    def __post_init__(self) -> None:
        """Hold the parts against each other.

        Raises:
            UsageError: a value that the drive does not take.
        """
        if len(self.address) != 1 or not self.address.isascii() or not self.address.isalnum():
            raise UsageError(f"address {self.address!r}: an MDrive's name is a letter or a digit")
        if self.microsteps not in _MICROSTEPS:
            raise UsageError(f"stage {self.part}: an MDrive has no {self.microsteps} microsteps")
        if not self.travel[0] < self.travel[1]:
            raise UsageError(f"stage {self.part}: travel {self.travel} m; give lowest and highest")
        for name, value in self.registers().items():
            bounds = SETTABLE[name]
            if not bounds.low <= value <= bounds.high:
                raise UsageError(
                    f"stage {self.part}: {name} would be {value}; "
                    f"the drive takes {bounds.low} to {bounds.high}"
                )
        for speed in (self.speed, self.home_speed):
            if self.rate(speed) <= self.rate(self.initial_speed):
                raise UsageError(
                    f"stage {self.part}: its speeds must be above the initial {self.initial_speed}"
                )

    @property
    def steps_per_metre(self) -> Fraction:
        """Exact, as it is no whole number: 20157.48 a millimetre."""
        return self.full_steps * self.microsteps / Fraction(self.lead).limit_denominator(10**9)

    def steps(self, position: float) -> int:
        """Nearest microstep."""
        return round(Fraction(position) * self.steps_per_metre)

    def metres(self, steps: int) -> float:
        """Position of a microstep."""
        return float(steps / self.steps_per_metre)

    def rate(self, speed: float) -> int:
        """[microsteps/s], or /s^2."""
        return math.floor(speed * float(self.steps_per_metre) + 0.5)

    @property
    def reach(self) -> int:
        """Longest move [microsteps]: a drive has no watchdog, so no order may outlast its host."""
        return self.rate(self.speed) // 4

    def registers(self) -> dict[str, int]:
        """What is written before the first move, in an order in which VI stays below VM."""
        return {
            "RC": self.run_current,
            "HC": self.hold_current,
            "MT": self.settling,
            "LM": self.limit_behaviour,
            "A": self.rate(self.acceleration),
            "D": self.rate(self.acceleration),
            "VI": self.rate(self.initial_speed),
            "VM": self.rate(self.speed),
        }

    @property
    def has_home(self) -> bool:
        """A home switch is wired."""
        return any(kind == HOME_INPUT for kind, _ in self.inputs.values())
