"""Whether a value that passed its protocol's check can be believed: finite, in range, alive.

A weak checksum lets corrupt values through, some devices have none, and a broken sensor sends
messages that are perfect. So each value is held against what its sensor can measure.
"""

import math


class Believable:
    """Judges the values of one stream, one after the other."""

    def __init__(
        self,
        limit: float,
        frozen_after: int,
        *,
        largest_step: float = math.inf,
        unit_length: bool = False,
    ) -> None:
        """Set the bounds.

        Args:
            limit: Full scale [SI]; at or above it a sensor is saturated.
            frozen_after: So many equal values in a row mean that the sensor has stopped; 0: never.
            largest_step: Between two samples that the machine can make [SI]; where it is finite,
                the first value has nothing to be held against and is not believed.
            unit_length: The values are a quaternion.
        """
        self._limit, self._frozen_after = limit, frozen_after
        self._largest_step, self._unit_length = largest_step, unit_length
        self._last: tuple[float, ...] = ()
        self._repeats = 0

    def doubt(self, value: tuple[float, ...]) -> str:
        """Why the value cannot be believed; empty: it can."""
        if not all(map(math.isfinite, value)):
            return "not a number"
        first = not self._last
        before, self._last = self._last or value, value
        step = max(abs(new - old) for new, old in zip(value, before, strict=True))
        self._repeats = self._repeats + 1 if step == 0.0 else 1
        largest = max(map(abs, value))
        if largest >= self._limit:
            return f"saturated: {largest:.4g} at a full scale of {self._limit:.4g}"
        if first and math.isfinite(self._largest_step):
            return "the first: there is nothing yet to hold it against"
        if step > self._largest_step:
            return f"leapt by {step:.4g}, more than {self._largest_step:.4g} between two samples"
        if self._unit_length and abs(math.hypot(*value) - 1.0) > 1e-2:
            return f"a quaternion of length {math.hypot(*value):.4g}"
        if self._frozen_after and self._repeats >= self._frozen_after:
            return f"the same for {self._repeats} samples: the sensor has stopped"
        return ""
