"""Between a device's axes, order and scale and those of the machine, both ways."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.rotation import conjugate, matrix, multiply

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Route:
    """How one stream of a device becomes one of the machine's, or some of its columns."""

    stream: str
    """Of the machine, measured or commanded."""
    device: str
    """By the laboratory's name."""
    source: str
    """The device's own name of it."""
    columns: tuple[int, ...]
    """Which of the machine's columns, in the device's order."""
    body_from_device: Array | None = None
    """Unit quaternion that turns the device's axes into the body's; of vectors and attitudes."""
    scale: float | Array = 1.0
    """Of the device's values, one or one a column, device's order: what they should be over what
    they are."""
    bias: float | Array = 0.0
    """What the device shows at zero, SI, its own order and axes; it is taken off first."""

    def taken(self, value: Array) -> Array:
        """The machine's values of the device's, (columns,)."""
        value = (value - self.bias) * self.scale
        if self.body_from_device is None:
            return value
        if self.stream == "attitude":
            return multiply(value, conjugate(self.body_from_device))
        return matrix(self.body_from_device) @ value

    def taken_of(self, column: int, value: Array) -> Array:
        """One of the machine's columns, (1,), of a device that tells them one by one."""
        place = self.columns.index(column)
        scale = np.broadcast_to(self.scale, len(self.columns))[place]
        return (value - np.broadcast_to(self.bias, len(self.columns))[place]) * scale

    def given(self, value: Array) -> Array:
        """The device's values of the machine's: `taken` undone."""
        if self.body_from_device is not None:
            value = matrix(self.body_from_device).T @ value
        return value / self.scale + self.bias

    def shown(self, value: Array) -> Array:
        """What the device shows where the machine has `value`: `taken` undone, attitudes too."""
        if self.stream == "attitude" and self.body_from_device is not None:
            return multiply(value, self.body_from_device) / self.scale + self.bias
        return self.given(value)
