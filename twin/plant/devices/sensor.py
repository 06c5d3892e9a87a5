"""What all sessions with devices that only measure have in common.

Whether a value that passed its protocol's check can be believed: finite, in range, alive.
A weak checksum lets corrupt values through, some devices have none, and a broken sensor sends
messages that are perfect. So each value is held against what its sensor can measure.
"""

import abc
import math
import time
from collections import deque
from collections.abc import Mapping

from twin.errors import CommandError
from twin.plant.devices.device import (
    Counters,
    Device,
    DeviceCommand,
    Sample,
    SampleQueue,
    Worker,
    missing,
)
from twin.plant.devices.port import Port


class SensorSession(Device):
    """A device that takes no command: opens its port, and reads it in a thread."""

    def __init__(
        self,
        name: str,
        port: str,
        *,
        baud: int,
        stop_bits: int,
        streams: Mapping[str, int],
        silence: float,
    ) -> None:
        """`silence`: so long without a sample [s] means that there is none."""
        self.name = name
        self.streams = streams
        self.commands = {}
        self.counters = Counters()
        self.fault = ""
        self.notes = deque[str](maxlen=100)
        self._url, self._baud, self._stop_bits = port, baud, stop_bits
        self._silence = silence
        self._queue = SampleQueue(self.counters)
        self._port: Port | None = None
        self._worker: Worker | None = None
        self._heard = 0.0

    @abc.abstractmethod
    def _greet(self, port: Port) -> None:
        """Make sure that the expected device is there.

        Raises:
            DeviceError: it is not.
        """

    @abc.abstractmethod
    def _set_up(self, port: Port) -> None:
        """Write the settings, read them back, start the measurement.

        Raises:
            DeviceError: the device refuses.
        """

    @abc.abstractmethod
    def _listen(self, port: Port) -> None:
        """Read for some milliseconds, and `_keep` what arrived."""

    def connect(self) -> None:
        if self._port is not None and not self.fault:
            return
        self.close()
        self.fault = ""
        port = Port(self.name, self._url, baud=self._baud, stop_bits=self._stop_bits)
        try:
            self._greet(port)
        except BaseException:
            port.close()
            raise
        self._port = port

    def configure(self) -> None:
        self.connect()
        assert self._port is not None
        self._end_worker()
        self._set_up(self._port)
        self._queue.take()
        self._heard = time.monotonic()
        self._worker = Worker(self.name, self._work, self._fail)

    def arm(self) -> None:
        """Nothing moves."""

    def read(self) -> list[Sample]:
        return self._queue.take()

    def write(self, command: DeviceCommand) -> DeviceCommand:
        if command:
            raise CommandError(f"{self.name} only measures, it takes no {', '.join(command)}")
        return {}

    def safe_stop(self, floating: bool) -> None:
        """Nothing moves."""

    def disarm(self) -> None:
        """Nothing moves."""

    def close(self) -> None:
        self._end_worker()
        if self._port is not None:
            self._port.close()
            self._port = None

    def _keep(self, sample: Sample) -> None:
        self._heard = sample.host_time
        self._queue.put(sample)

    def _work(self) -> None:
        assert self._port is not None
        self._listen(self._port)
        now = time.monotonic()
        if now - self._heard > self._silence:
            self.counters.timeouts += 1
            reason = f"{self.name}: nothing usable for {now - self._heard:.2f} s"
            self._heard = now
            self._give_up(now, reason)

    def _give_up(self, now: float, reason: str) -> None:
        for stream, width in self.streams.items():
            self._queue.put(missing(stream, width, now, reason))

    def _fail(self, reason: str) -> None:
        self.fault = reason
        self._give_up(time.monotonic(), reason)

    def _end_worker(self) -> None:
        if self._worker is not None:
            self._worker.stop()
            self._worker = None


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
