"""The last two seconds of a run that was stopped: what it saw, believed and did before the end."""

from collections import deque

from twin.plant.plant import Plant
from twin.recording.recording import Recording
from twin.signals import Tick
from twin.stream.recorder import MemoryRecorder

SECONDS = 2.0
"""How far back a flight record reaches."""


class FlightRecorder:
    """Observer of a loop that keeps a record of each run of the batch that ends early.

    It holds references to the last ticks' arrays, so that watching a thousand runs costs no copy.
    """

    def __init__(self, plant: Plant) -> None:
        self.records: dict[int, Recording] = {}
        """Row of the batch -> its last seconds; the reason is in the provenance."""
        self._plant = plant
        ticks = round(SECONDS * plant.platform.control_rate) + 1
        self._last: deque[Tick] = deque(maxlen=max(ticks, 2))

    def collect(self, tick: Tick) -> None:
        """One tick."""
        self._last.append(tick)
        if len(self._plant.stopped) > len(self.records):
            for run in self._plant.stopped.keys() - self.records.keys():
                self.records[run] = self._record(run)

    def _record(self, run: int) -> Recording:
        platform = self._plant.platform
        facts = {"platform": platform.name, "run": run, "reason": self._plant.stopped[run]}
        memory = MemoryRecorder(platform, facts)
        for tick in self._last:
            memory.collect(tick)
        return memory.recording(run)
