"""A microcontroller at the far end of our own link (docs/link.md): what a laboratory builds itself.

Stages, magnetorquers, wheels, an IMU, whatever its channels say. The far end enforces the time for
which a set-point is valid, so that a host that dies leaves it safe; each `write` renews them all.
"""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from twin.errors import CommandError, DeviceError, UnknownName
from twin.plant.devices.device import (
    Counters,
    Device,
    DeviceCommand,
    DeviceSettings,
    Sample,
    SampleQueue,
    StreamLimits,
    Worker,
    missing,
)
from twin.plant.devices.host_time import WALL, ClockEstimate, HostTime
from twin.plant.devices.link import Channel, FarEndState, Schema, sentence_of
from twin.plant.devices.link import ParserCounters as LinkCounters
from twin.plant.devices.link.near_end import NearEnd
from twin.plant.devices.port import SLICE, Port

WAITING = 64
"""Frames that may wait to be written before the line counts as stuck."""


class Outbox:
    """A bounded queue whose frames grow old: a line that stood must not bring late set-points."""

    def __init__(self) -> None:
        self._frames = queue.Queue[tuple[float, bytes]](WAITING)

    def post(self, frame: bytes, lifetime: float = inf) -> bool:
        """Hand over what is worth sending for `lifetime` [s]; False if too much waits already."""
        try:
            self._frames.put_nowait((time.monotonic() + lifetime, frame))
        except queue.Full:
            return False
        return True

    def take(self, timeout: float) -> bytes:
        """The oldest that is still worth it; nothing after `timeout` [s]."""
        try:
            until, frame = self._frames.get(timeout=timeout)
        except queue.Empty:
            return b""
        return frame if time.monotonic() < until else b""

    def clear(self) -> None:
        """Forget all that waits."""
        try:
            while True:
                self._frames.get_nowait()
        except queue.Empty:
            return

    @property
    def empty(self) -> bool:
        """Nothing waits."""
        return self._frames.empty()


BOOTLOADER_BAUD = 1200
"""Opening the native USB port of a SAMD21 at this rate starts its bootloader."""

_GREETING = 2.0
"""Longest wait for the answer to a greeting [s]; it is sent anew four times a second."""

_ANSWER = 0.5
"""Longest wait for any other answer [s]."""

_EXCHANGES = 8
"""Of clocks, before the first sample is believed."""

_BETWEEN_EXCHANGES = 0.005
"""[s]."""

_WHY_LOST = "it is safe by itself, and why it said was lost on the line"
_FAULT = "it reports a fault"


@dataclass(frozen=True, kw_only=True)
class MicrocontrollerSettings(DeviceSettings):
    """A board and its channels, as they were compiled into its firmware."""

    channels: tuple[Channel, ...]
    """In the firmware's order."""
    baud: int = 115_200
    """Means nothing over native USB, but for 1200, which is refused."""
    valid_for: float = 0.25
    """How long the far end acts on a set-point that is not renewed [s]."""
    silence: float = 0.5
    """So long without a frame means that it is not there [s]."""
    clock_period: float = 0.5
    """Between two exchanges of clocks [s]."""

    def session(self) -> "Microcontroller":
        return Microcontroller(self)

    def limits(self) -> dict[str, StreamLimits]:
        """The steps of channels that travel as counts."""
        return {
            channel.stream: StreamLimits(resolution=channel.scale)
            for channel in self.channels
            if channel.number == "int32" and not channel.commanded
        }


class Microcontroller(Device):
    """An open session with one far end."""

    def __init__(self, settings: MicrocontrollerSettings, host: HostTime = WALL) -> None:
        """Nothing is opened yet.

        Args:
            settings: of the board.
            host: the time by which it is spoken to.

        Raises:
            DeviceError: 1200 baud, or set-points without an end.
        """
        self.settings, self._host = settings, host
        self._name, self._schema = settings.name, Schema(settings.channels)
        if settings.baud == BOOTLOADER_BAUD:
            raise self._error(
                "1200 baud would put a SAMD21 into its bootloader", "set another rate"
            )
        if not 0.001 <= settings.valid_for <= 65.0:
            raise self._error(
                f"set-points that are valid for {settings.valid_for:g} s",
                "set valid_for to some control periods, at most 65 s",
            )
        self.streams = {c.stream: c.columns for c in settings.channels if not c.commanded}
        self.commands = {c.stream: c.columns for c in settings.channels if c.commanded}
        self.counters = Counters()
        self.notes = deque[str](maxlen=100)
        self.fault = ""
        self.armed = False
        self._valid_ms = round(settings.valid_for * 1000)
        self._queue = SampleQueue(self.counters)
        self._lock = threading.Lock()
        """Of the near end: the reader hears while the loop speaks."""
        self._end = NearEnd(self._schema, self._name)
        self._held: dict[str, NDArray[np.float64]] = {}
        self._unheard = deque[tuple[int, float]]()
        """Sequence and time of set-points that the far end has not acknowledged."""
        self._port: Port | None = None
        self._outbox = Outbox()
        self._workers: list[Worker] = []
        self._asked = self._complained = 0.0
        self._disarmed = ""
        """Why it is no longer armed, as it said itself."""

    @property
    def clock(self) -> ClockEstimate | None:
        """The far end's clock against ours, with bounds; None before the first exchange."""
        return self._end.clock.estimate

    @property
    def link(self) -> LinkCounters:
        """What the parser counted, in more detail than `counters`."""
        return self._end.parser.counters

    def connect(self) -> None:
        if self._port is not None and not self.fault:
            return
        self.close()
        self.fault, self.armed = "", False
        self._held.clear()
        self._end = NearEnd(self._schema, self._name)
        port = Port(self._name, self.settings.port, baud=self.settings.baud, counters=self.counters)
        try:
            self._greet(port)
        except BaseException:
            port.close()
            raise
        self._port = port
        self._host.watch(port)

    def configure(self) -> None:
        self.connect()
        assert self._port is not None
        self._end_workers()
        port, host_time = self._port, self._host.time()
        self._outbox.clear()
        self._queue.take()
        self._complained = self._asked = host_time
        self._workers = [
            Worker(f"{self._name} reader", lambda: self._listen(port), self._fail),
            Worker(f"{self._name} writer", lambda: self._speak(port), self._fail),
        ]
        for _ in range(_EXCHANGES):
            self._say(self._end.ask_time)
            self._host.sleep(_BETWEEN_EXCHANGES)
        if not self._wait(lambda: self.clock is not None):
            raise self._error(
                f"it answered the greeting, but gave no time within {_ANSWER} s",
                "check that its firmware calls link_receive and link_take in its main loop",
            )

    def arm(self) -> None:
        self._check()
        greeting = self._end.greeting
        if not self.commands or greeting is None:
            return
        if self._valid_ms > greeting.longest_valid_ms:
            raise self._error(self._too_long(greeting.longest_valid_ms), "lower valid_for")
        if self._end.state is FarEndState.fault:
            raise self._error(_FAULT, "look at the machine, then disarm it")
        self._end.last_event = None
        sequence = self._say(lambda host_time: self._end.arm(greeting.longest_valid_ms, host_time))
        self._wait(lambda: self._has_heard(sequence))
        if self._end.state is not FarEndState.armed:
            event = self._end.last_event
            reason = (
                sentence_of(event.code, event.value) if event else f"no answer within {_ANSWER} s"
            )
            raise self._error(f"it was not armed ({reason})", "connect anew")
        self._held.clear()
        self._unheard.clear()
        self._disarmed = ""
        self.armed = True

    def unfit(self) -> str:
        greeting = self._end.greeting
        if self.fault or not self.commands or greeting is None:
            return self.fault
        if self._valid_ms > greeting.longest_valid_ms:
            return self._too_long(greeting.longest_valid_ms)
        return _FAULT if self._end.state is FarEndState.fault else ""

    def read(self) -> list[Sample]:
        return self._queue.take()

    def write(self, command: DeviceCommand) -> DeviceCommand:
        """As `Device` says; what is absent keeps its last value, and all of it is renewed."""
        for stream, value in command.items():
            if stream not in self.commands:
                raise UnknownName(f"command of {self._name}", stream, self.commands)
            if value.shape != (self.commands[stream],) or not np.isfinite(value).all():
                raise CommandError(
                    f"{self._name}: {stream} is {value.tolist()}; it takes "
                    f"{self.commands[stream]} finite numbers"
                )
        self._check()
        if not self.armed:
            raise self._error(f"it is not armed{self._disarmed}", "arm it before it is told")
        self._check_heard()
        for stream, value in command.items():
            channel = self._schema.channels[self._schema.number_of(stream)]
            self._held[stream] = channel.sent(value)
        if self._held:
            sequence = self._say(
                lambda host_time: self._end.setpoints(self._held, self._valid_ms, host_time),
                self.settings.valid_for,
            )
            self._unheard.append((sequence, self._host.time()))
        return dict(self._held)

    def safe_stop(self, floating: bool) -> None:
        """The far end does what its channels say is safe; floating or not, no stage loses hold."""
        del floating
        self.armed = False
        self._held.clear()
        # what waits would only be refused, and this must not wait behind it
        self._outbox.clear()
        if self._port is not None:
            self._say(self._end.safe_stop)

    def disarm(self) -> None:
        """Take no command from now on; a fault that the far end reports is acknowledged."""
        self.safe_stop(floating=True)
        if self._port is not None:
            self._say(self._end.disarm)

    def close(self) -> None:
        if self._port is None:
            return
        if self._workers and not self.fault:
            self.disarm()
            sequence = self._end.last_sequence
            self._wait(lambda: self._has_heard(sequence), 0.1)
        self._end_workers()
        self._port.close()
        self._port = None

    def _greet(self, port: Port) -> None:
        came, start, asked = 0, self._host.time(), -np.inf
        while self._end.greeting is None:
            host_time = self._host.time()
            if host_time - start > _GREETING:
                raise self._error(*self._no_greeting(came))
            if host_time - asked > _GREETING / 8:
                asked = host_time
                port.write(self._end.greet(host_time))
            data = self._host.read(port, 0.05)
            came += len(data)
            self._end.hear(data, self._host.time())
        greeting = self._end.greeting
        self.identity = greeting.name
        if greeting.schema_hash != self._schema.hash:
            raise self._error(
                f"{greeting.name!r} carries schema {greeting.schema_hash:08X}, the channels stated "
                f"here make {self._schema.hash:08X}",
                "flash the firmware that was made for these channels, or correct them",
            )

    def _too_long(self, longest: int) -> str:
        return f"set-points valid for {self._valid_ms} ms, it takes at most {longest} ms"

    def _no_greeting(self, came: int) -> tuple[str, str]:
        counters = self._end.parser.counters
        problem = f"no greeting in {_GREETING:g} s on {self.settings.port}: {came} bytes came"
        if not came:
            return problem, "is the board powered, and is this its port?"
        if not counters.frames:
            return problem, f"is it at {self.settings.baud} baud, and does it speak our link?"
        return f"{problem}, {counters.frames} frames", "does it hear us? check the other wire"

    def _listen(self, port: Port) -> None:
        data = port.read(SLICE)
        host_time = self._host.time()
        with self._lock:
            samples = self._end.hear(data, host_time) if data else []
        for sample in samples:
            self._queue.put(sample)
        if host_time - self._asked >= self.settings.clock_period:
            self._asked = host_time
            self._say(self._end.ask_time, self.settings.clock_period)
        self._count()
        port.dealt_with += len(data)
        self._watch(host_time)

    def _watch(self, host_time: float) -> None:
        """What the frames, or their absence, say of the far end."""
        end = self._end
        if end.restarted:
            self.armed = False
            raise self._error("it has restarted", "connect anew, then arm it again")
        if self.armed and end.state is not FarEndState.armed:
            self.armed = False
            event = end.last_event
            # where the last is that it was armed, what it said since was lost on the line
            why = _WHY_LOST
            if event is not None and event.code != "ARMED":
                why = sentence_of(event.code, event.value)
            self._disarmed = f" ({why})"
        if end.events:
            self._tell()
        if host_time - max(end.heard, self._complained) > self.settings.silence:
            self._complained = host_time
            self.counters.timeouts += 1
            self._give_up(
                host_time, f"{self._name}: nothing heard for {host_time - end.heard:.2f} s"
            )

    def _speak(self, port: Port) -> None:
        frame = self._outbox.take(SLICE)
        if frame:
            port.write(frame)

    def _say(self, make: Callable[[float], bytes], lifetime: float = np.inf) -> int:
        """Send what `make` makes of the time; the sequence of its last frame."""
        with self._lock:
            frame = make(self._host.time())
            sequence = self._end.last_sequence
            if self._host.wall or self._port is None:
                posted = self._outbox.post(frame, lifetime)
            else:
                # time stands meanwhile: nothing can wait, nothing can grow old
                posted = True
                try:
                    self._port.write(frame)
                except DeviceError as problem:
                    self.fault = self.fault or str(problem)
        if not posted:
            self.fault = self.fault or f"{self._name}: the line takes nothing; connect anew"
        return sequence

    def _check(self) -> None:
        if self.fault:
            raise self._error(f"in a fault ({self.fault})", "connect anew")
        if not self._workers:
            raise self._error("it is not configured", "connect and configure it")

    def _check_heard(self) -> None:
        """Set-points that are not acknowledged in time may come late: then none is sent."""
        while self._unheard and self._has_heard(self._unheard[0][0]):
            self._unheard.popleft()
        if self._unheard and self._host.time() - self._unheard[0][1] > self.settings.valid_for:
            self.safe_stop(floating=True)
            raise self._error(
                f"it has not acknowledged a set-point for {self.settings.valid_for:g} s; it was "
                "told to be safe",
                "check the line, then arm it again",
            )

    def _has_heard(self, sequence: int) -> bool:
        answered = self._end.answered
        return answered >= 0 and (answered - sequence) & 0xFFFF < 0x8000

    def _wait(self, done: Callable[[], bool], longest: float = _ANSWER) -> bool:
        until = self._host.time() + longest
        while not done() and not self.fault and self._host.time() < until:
            self._host.sleep(0.002)
        return done()

    def _tell(self) -> None:
        with self._lock:
            self.notes.extend(self._end.event_sentences())

    def _count(self) -> None:
        seen, counters = self._end.parser.counters, self.counters
        counters.frames, counters.gaps = seen.frames, seen.gaps
        counters.bad_checksums = seen.bad_checksum
        counters.resyncs = seen.malformed + seen.bad_version

    def _give_up(self, host_time: float, reason: str) -> None:
        for stream, width in self.streams.items():
            self._queue.put(missing(stream, width, host_time, reason))

    def _fail(self, reason: str) -> None:
        self.armed = False
        self.fault = self.fault or reason
        if self._port is not None:
            self._port.unread = True
        self._give_up(self._host.time(), reason)

    def _end_workers(self) -> None:
        for worker in self._workers:
            worker.stop()
        self._workers = []

    def _error(self, problem: str, remedy: str) -> DeviceError:
        return DeviceError(self._name, problem, remedy)
