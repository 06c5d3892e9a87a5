"""Counters of a device that wrap: packets, and ticks of its clock."""

from twin.plant.devices.xbus.tables import TICKS


class Wrapping:
    """Follows a counter modulo `span` by its shortest way, forwards or backwards."""

    def __init__(self, span: int) -> None:
        self._span = span
        self._last: int | None = None
        self.total = 0
        """Unwrapped, from the first value seen."""

    def step(self, value: int) -> int | None:
        """Difference to the value before, in [-span / 2, span / 2); None for the first."""
        if self._last is None:
            self._last, self.total = value, value
            return None
        half = self._span // 2
        difference = (value - self._last + half) % self._span - half
        self._last = value
        self.total += difference
        return difference

    def forget(self) -> None:
        """The device has begun anew."""
        self._last = None


class DeviceClock:
    """SampleTimeFine in seconds, unwrapped; it may step back, and then so does this."""

    def __init__(self, span: int) -> None:
        self._ticks = Wrapping(span)

    def read(self, ticks: int) -> tuple[float, float]:
        """The time, and the step from the one before [s]."""
        step = self._ticks.step(ticks) or 0
        return self._ticks.total / TICKS, step / TICKS

    def forget(self) -> None:
        """The device has begun anew."""
        self._ticks.forget()
