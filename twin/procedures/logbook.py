"""What a run measured since a time, kept while its phases need it."""

from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.recording import Recording
from twin.signals import Tick
from twin.stream.rows import Rows, series

Array = NDArray[np.float64]


FITTED = {
    "gyro",
    "attitude",
    "inclinometer",
    "wheel_speed",
    "gimbal_angle",
    "gimbal_rate",
    "stage_position",
    "command_wheel_torque",
    "command_gimbal_rate",
    "command_stage_position",
    "command_dipole",
    "estimate_gyro_bias",
}
"""What an offset is identified from. Not a magnetometer beside coils, nor an accelerometer, which
says little that the attitude does not; nor, beside that, an inclinometer."""


class Logbook:
    """Observer of a loop: remembers its ticks from `forget`'s time on, without what is true."""

    def __init__(self, platform: Platform) -> None:
        self._platform = platform
        self._ticks: deque[Tick] = deque()
        self._since = np.inf

    def collect(self, tick: Tick) -> None:
        """One tick."""
        while self._ticks and self._ticks[0].reading.time < self._since:
            self._ticks.popleft()
        if tick.reading.time >= self._since:
            self._ticks.append(tick._replace(truth={}))

    def forget(self, before: float) -> None:
        """Nothing from before that time [s] will be asked for; inf: nothing at all."""
        self._since = before

    def recording(self, run: int, start: float) -> Recording:
        """What a run measured and was told from `start` [s] until now."""
        ticks = [tick for tick in self._ticks if tick.reading.time >= start]
        rows = Rows(self._platform, run)
        blocks = rows.of(ticks)
        streams = {name: series(rows.headers[name], block) for name, block in blocks.items()}
        facts = {"platform": self._platform.name, "source": f"balancing, from {start:.2f} s on"}
        # Samples from before the start may arrive after it: under another command.
        kept = {name: rows for name, rows in streams.items() if name in FITTED}
        if "attitude" in kept:
            kept.pop("inclinometer", None)
        return _still(Recording(kept, facts).between(start, np.inf), self._platform)


def _still(recording: Recording, platform: Platform) -> Recording:
    """With masses that stand where they mostly are: they hold while a phase is recorded.

    A counter whose mass stands between two of its digits shows now one and now the other; a fit
    would take that for motion.
    """
    if "stage_position" not in recording:
        return recording
    shown = recording["stage_position"]
    digit = 1.5 * np.array([stage.resolution for stage in platform.stages])
    middle = np.median(shown.value, axis=0)
    value = np.where(np.abs(shown.value - middle) <= digit, middle, shown.value)
    return replace(
        recording, streams={**recording.streams, "stage_position": replace(shown, value=value)}
    )
