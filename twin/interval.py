"""A number that is not known exactly, with the interval that is right 95 times in 100."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Interval:
    """A value and its 95 % interval."""

    value: float
    low: float
    high: float

    def holds(self, truth: float) -> bool:
        """Whether the truth is in it."""
        return self.low <= truth <= self.high

    def document(self) -> dict[str, float]:
        """For `--json`."""
        return {"value": self.value, "low": self.low, "high": self.high}
