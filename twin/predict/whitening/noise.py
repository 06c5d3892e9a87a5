"""Noise processes beside the sensors' white noise: torques and sensor errors that wander."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Wander:
    """An Ornstein-Uhlenbeck process: its autocovariance is rms^2 exp(-lag / time)."""

    rms: float
    """Of each axis or column, in its unit (SI)."""
    time: float
    """Correlation time [s]."""


@dataclass(frozen=True)
class Noise:
    """What disturbs a motion and its sensors, each axis by itself."""

    white: float = 0.0
    """Intensity of a white torque about each base axis of the machine as stated [(N m)^2 s]."""
    torque: Wander | None = None
    """A torque about each base axis of the machine as stated."""
    errors: tuple[tuple[str, Wander], ...] = ()
    """Of each column of a stream, by the stream's name."""
    scales: tuple[tuple[str, float], ...] = ()
    """By how much the white noise of a stream is larger than its sensor's, by its name."""

    @property
    def any(self) -> bool:
        """Whether there is anything beside the sensors' white noise."""
        return self.white > 0.0 or self.wanders or bool(self.scales)

    @property
    def wanders(self) -> bool:
        """Whether anything has a memory."""
        return self.torque is not None or bool(self.errors)

    @property
    def processes(self) -> int:
        """How many there are beside the sensors' white noise, larger white noises among them."""
        torques = (self.white > 0.0) + (self.torque is not None)
        return torques + len(self.errors) + len(self.scales)

    def with_error(self, stream: str, wander: Wander | None) -> "Noise":
        """With another error of a stream; None: without any."""
        rest = tuple(one for one in self.errors if one[0] != stream)
        more = () if wander is None else ((stream, wander),)
        return replace(self, errors=(*rest, *more))


EXACT = Noise()
"""Of a motion that nothing disturbs."""
