"""A log played as if it were hardware: its samples arrive when they did, its commands stand."""

from dataclasses import replace

import numpy as np

from twin.errors import UsageError
from twin.plant.limits import Limits
from twin.plant.plant import Plant
from twin.platform import Platform, check_columns, in_order_of, other_machine
from twin.recording import Recording
from twin.signals import POSITIONS, Command, Reading, Samples

_EPS = 1e-9


class ReplayedPlant(Plant):
    """One run, the log's. What is written changes nothing: applied is what the log says was."""

    def __init__(self, platform: Platform, recording: Recording) -> None:
        """Play `recording`; its first row is at tick 0.

        Raises:
            UsageError: no measured stream that the platform knows is in it, or one of them has
                other columns than the platform's.
        """
        self.platform = platform
        self.n = 1
        self.stopped = {}
        self.of_other = other_machine(recording, platform)
        """The machine that the log names, where it is not this one."""
        recording = in_order_of(platform, recording)
        self._start = recording.start
        measured = recording.without_truth()
        self._measured = {
            name: measured[name]
            for name in measured
            if len(measured[name])
            if name in ("gyro", "attitude", "inclinometer", "accelerometer", "magnetometer")
            or name in platform.sensors
        }
        if not self._measured:
            raise UsageError(
                f"nothing to replay: the log has no sample of what {platform.name} measures "
                f"({', '.join(platform.sensors)}), only {', '.join(recording) or 'no stream'}"
            )
        # nobody waits for positions that the log does not tell
        kept = {
            name: sensor
            for name, sensor in platform.sensors.items()
            if name in self._measured or name not in POSITIONS
        }
        self.platform = replace(platform, sensors=kept)
        self._commands = {name: recording[name] for name in platform.commands if name in recording}
        check_columns(recording, platform, (*self._measured, *self._commands))
        self._limits = Limits(platform)
        self._now = 0.0
        self._given = dict.fromkeys(self._measured, 0)

    @property
    def duration(self) -> float:
        """Time of the last sample after the first [s]."""
        return max(float(s.time[-1]) for s in self._measured.values()) - self._start

    def read(self, until: float) -> Reading:
        self._now = until
        streams: dict[str, Samples] = {}
        for name, series in self._measured.items():
            first = self._given[name]
            last = int(np.searchsorted(series.time, self._start + until + _EPS, side="right"))
            if last > first:
                self._given[name] = last
                time = (series.time[first:last] - self._start)[None]
                value = series.value[None, first:last]
                streams[name] = Samples(value, time, np.ones(time.shape, dtype=np.bool_))
        return Reading(until, streams)

    def write(self, command: Command) -> Command:
        self._limits.check(command, self.n)
        now = np.array([self._start + self._now])
        return {
            name: self._commands[name].held_at(now)
            if name in self._commands
            else np.zeros((1, width))
            for name, width in self.platform.commands.items()
        }
