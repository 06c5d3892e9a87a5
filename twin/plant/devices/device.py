"""What a device is for the hardware plant: frozen settings, an open session, samples, counters.

A session owns its port. A thread of its own is blocked in the port's read and fills a bounded
queue, so that `read` and `write` never make the loop wait. What arrives is in SI units and in the
device's own axes: alignment, scale and the host's time base are the plant's business.
"""

import abc
import math
import threading
import traceback
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from twin.errors import TwinError
from twin.plant.devices.counters import Counters
from twin.plant.devices.host_time import ClockEstimate
from twin.signals import Array


@dataclass(frozen=True, slots=True)
class Sample:
    """One measurement, or the reason why there is none."""

    stream: str
    """Name of a canonical stream (docs/design.md 4.2), or one of the device's own."""
    value: tuple[float, ...]
    """SI, device axes; not a number where nothing trustworthy arrived."""
    host_time: float
    """When its last byte arrived, `time.monotonic` [s]."""
    latency: float = 0.0
    """How old the value was by then, as far as is known: its time on the line [s]."""
    device_time: float | None = None
    """The device's own clock, unwrapped [s]; None where it has none."""
    part: str = ""
    """Which part (stage, wheel) it is of, if a stream has a column a part; empty: all of them."""
    valid: bool = True
    reason: str = ""
    """Why it is not valid, a sentence."""


@dataclass(frozen=True, kw_only=True)
class StreamLimits:
    """What the values of one stream can be; `twin.plant.plausibility` holds each sample to it."""

    range: float = math.inf
    """Full scale [SI]; a value at or above it is saturated."""
    largest_step: float = math.inf
    """Between two samples, in any column, that the machine can make [SI]."""
    frozen_after: int | None = None
    """So many equal values in a row mean that the sensor has stopped; 0: repeats say nothing;
    None: as its noise has it."""
    resolution: float = 0.0
    """Step of the numbers on the line [SI]."""
    oldest: float = math.inf
    """Age at which a sample that arrives is too old to be used [s]."""
    first_confirmed: bool = False
    """The first value is not believed, for there is nothing to hold it against: of a line whose
    checksum is weak."""


def missing(stream: str, width: int, host_time: float, reason: str, part: str = "") -> Sample:
    """A sample that never came: `width` values that are not numbers, and the reason."""
    nothing = (math.nan,) * width
    return Sample(stream, nothing, host_time, part=part, valid=False, reason=reason)


@dataclass(frozen=True, kw_only=True)
class DeviceSettings(abc.ABC):
    """All that must be known before a device is opened."""

    name: str
    """As the laboratory calls it; stands in every message."""
    port: str
    """Path (best by /dev/serial/by-id) or pyserial URL (`socket://`, `rfc2217://`)."""
    baud: int
    """Of its line."""

    @abc.abstractmethod
    def session(self) -> "Device":
        """A session with this device, not yet connected."""

    def limits(self) -> Mapping[str, StreamLimits]:
        """What is known of its own streams, by their names; what is absent follows from the
        machine's sensors."""
        return {}


DeviceCommand = Mapping[str, Array]
"""Command stream (`command_stage_position`, ...) -> (k,), SI, device axes, parts as in settings."""


class Device(abc.ABC):
    """An open session with one device, or with several on one line.

    Life: connect, configure, (arm, write ...), safe_stop, disarm, close. A device that only
    measures has nothing to arm and takes no command.
    """

    streams: Mapping[str, int]
    """Streams that it gives and their widths, known before connecting."""
    commands: Mapping[str, int]
    """Command streams that it takes and their widths; empty for a sensor."""
    counters: Counters
    notes: deque[str]
    """What happened that is worth telling (a limit switch, a restart), a sentence each, oldest
    first; whoever tells it takes it out."""
    identity: str = ""
    """As it named itself on connecting; empty where it tells no name."""
    fault: str
    """Why nothing can be trusted or commanded until the next `connect`, a sentence; else empty."""

    @property
    def clock(self) -> ClockEstimate | None:
        """Its clock against the host's, where the two are compared; None elsewhere."""
        return None

    def unfit(self) -> str:
        """Why it would not be armed now, as far as is known without doing it; empty: it would."""
        return self.fault

    @abc.abstractmethod
    def connect(self) -> None:
        """Open the port and make sure that the device answers, as the one that is expected.

        Connecting what is connected does nothing; after a fault it begins anew.

        Raises:
            DeviceError: no port, no answer, or another device.
        """

    @abc.abstractmethod
    def configure(self) -> None:
        """Write the settings, read them back, and begin to measure.

        Raises:
            DeviceError: a setting that the device refuses or reports otherwise than written.
        """

    @abc.abstractmethod
    def arm(self) -> None:
        """Take commands from now on.

        Raises:
            DeviceError: not configured, not homed, or in a fault.
        """

    @abc.abstractmethod
    def read(self) -> list[Sample]:
        """All that arrived since the last call, in the order of arrival. Never blocks.

        Silence gives nothing, or a sample that is not valid; never the last value again.
        """

    @abc.abstractmethod
    def write(self, command: DeviceCommand) -> DeviceCommand:
        """Apply from now on; return what is really applied, after limits. Never blocks.

        Raises:
            CommandError: an unknown stream, a wrong shape, a value that is not finite.
            DeviceError: not armed, or in a fault.
        """

    @abc.abstractmethod
    def safe_stop(self, floating: bool) -> None:
        """Bring what moves to its safe state; `floating`: nothing may lose its hold.

        Works in every state and more than once; raises nothing.
        """

    @abc.abstractmethod
    def disarm(self) -> None:
        """Take no command from now on. What moves keeps its safe state; raises nothing."""

    @abc.abstractmethod
    def close(self) -> None:
        """Stop safely if armed, end the thread, release the port; raises nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


QUEUE = 4096
"""Samples kept for a loop that does not fetch them: 40 s of 100 Hz."""


class SampleQueue:
    """What arrived and has not been fetched; when full, the oldest go and are counted."""

    def __init__(self, counters: Counters, limit: int = QUEUE) -> None:
        self._samples = deque[Sample](maxlen=limit)
        self._counters = counters
        self._lock = threading.Lock()

    def put(self, sample: Sample) -> None:
        """Append one."""
        with self._lock:
            if len(self._samples) == self._samples.maxlen:
                self._counters.overflows += 1
            self._samples.append(sample)

    def take(self) -> list[Sample]:
        """All of them, oldest first; the queue is empty afterwards."""
        with self._lock:
            samples = list(self._samples)
            self._samples.clear()
        return samples


class Worker:
    """Does one short piece of work after another in a thread, until stopped or it fails."""

    def __init__(self, name: str, work: Callable[[], None], failed: Callable[[str], None]) -> None:
        """`work` blocks at most some tens of milliseconds; `failed` is told why it broke off."""
        self._work = work
        self._failed = failed
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """It still works."""
        return self._thread.is_alive()

    def stop(self, timeout: float = 1.0) -> None:
        """Let it finish its piece of work, at most `timeout` [s]."""
        self._ending.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    def _run(self) -> None:
        try:
            while not self._ending.is_set():
                self._work()
        except TwinError as error:
            self._failed(str(error))
        except Exception as error:
            # A mistake of ours must end in a stopped session and a reason, not in a silent thread.
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            what = f"{type(error).__name__} at {where}: {error}"
            self._failed(f"{self._thread.name}: stopped by {what}; please report it")
