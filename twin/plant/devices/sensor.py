"""What all sessions with devices that only measure have in common.

Whether a value that passed its protocol's check can be believed, `twin.plant.plausibility` judges.
"""

import abc
import time
from collections import deque
from collections.abc import Mapping
from typing import Generic, Protocol, TypeVar

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


class Closable(Protocol):
    """What a session listens to."""

    def close(self) -> None:
        """Release it; raises nothing."""
        ...


AnyPort = TypeVar("AnyPort", bound=Closable)


class ListeningSession(Device, Generic[AnyPort]):
    """A device that takes no command: opens its port, of any kind, and reads it in a thread."""

    def __init__(self, name: str, *, streams: Mapping[str, int], silence: float) -> None:
        """`silence`: so long without a sample [s] means that there is none."""
        self.name = name
        self.streams = streams
        self.commands = {}
        self.counters = Counters()
        self.fault = ""
        self.notes = deque[str](maxlen=100)
        self._silence = silence
        self._queue = SampleQueue(self.counters)
        self._port: AnyPort | None = None
        self._worker: Worker | None = None
        self._heard = 0.0

    @abc.abstractmethod
    def _open(self) -> AnyPort:
        """Open the port.

        Raises:
            DeviceError: it cannot be had.
        """

    @abc.abstractmethod
    def _greet(self, port: AnyPort) -> None:
        """Make sure that the expected device is there.

        Raises:
            DeviceError: it is not.
        """

    @abc.abstractmethod
    def _set_up(self, port: AnyPort) -> None:
        """Write the settings, read them back, start the measurement.

        Raises:
            DeviceError: the device refuses.
        """

    @abc.abstractmethod
    def _listen(self, port: AnyPort) -> None:
        """Read for some milliseconds, and `_keep` what arrived."""

    def connect(self) -> None:
        if self._port is not None and not self.fault:
            return
        self.close()
        self.fault = ""
        port = self._open()
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
        host_time = time.monotonic()
        if host_time - self._heard > self._silence:
            self.counters.timeouts += 1
            reason = f"{self.name}: nothing usable for {host_time - self._heard:.2f} s"
            self._heard = host_time
            self._give_up(host_time, reason)

    def _give_up(self, host_time: float, reason: str) -> None:
        for stream, width in self.streams.items():
            self._queue.put(missing(stream, width, host_time, reason))

    def _fail(self, reason: str) -> None:
        self.fault = reason
        self._give_up(time.monotonic(), reason)

    def _end_worker(self) -> None:
        if self._worker is not None:
            self._worker.stop()
            self._worker = None


class SensorSession(ListeningSession[Port]):
    """A device that takes no command, on a serial port or its like."""

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
        super().__init__(name, streams=streams, silence=silence)
        self._url, self._baud, self._stop_bits = port, baud, stop_bits

    def _open(self) -> Port:
        return Port(
            self.name,
            self._url,
            baud=self._baud,
            stop_bits=self._stop_bits,
            counters=self.counters,
        )
