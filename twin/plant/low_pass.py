"""The low-pass filter in a sensor: Butterworth, on every physics step."""

import numpy as np
from numpy.typing import NDArray

from twin.platform import Sensor

Array = NDArray[np.float64]


class LowPass:
    """In rest at the first value that it sees."""

    def __init__(self, sensor: Sensor, step: float) -> None:
        from scipy.signal import butter, sosfilt_zi  # takes a while, and few sensors need it

        self._sections = butter(sensor.order, sensor.cutoff, fs=1.0 / step, output="sos")
        self._rest = sosfilt_zi(self._sections)[:, None, :, None]
        self._memory: Array | None = None

    def __call__(self, truth: Array) -> Array:
        """The next steps (n, steps, k), filtered."""
        from scipy.signal import sosfilt

        if self._memory is None:
            self._memory = self._rest * truth[None, :, :1]
        passed, self._memory = sosfilt(self._sections, truth, axis=1, zi=self._memory)
        return passed
