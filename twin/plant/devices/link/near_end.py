"""Our end of the link: what is said, and what is made of what is heard. No input or output.

Times are the host's, monotonic, seconds.
"""

from collections import deque
from collections.abc import Mapping

import numpy as np

from twin.plant.devices.device import Sample
from twin.plant.devices.host_time import ClockFit
from twin.plant.devices.link.frame import Frame, Parser, packed
from twin.plant.devices.link.messages import FarEndState, Flag, MessageType, sentence_of
from twin.plant.devices.link.payloads import (
    ArmRequest,
    Event,
    Hello,
    SampleRows,
    SetPoint,
    TimeSync,
)
from twin.plant.devices.link.schema import Array, Schema

_CLOCK = 2**32
_STATES = {int(state): state for state in FarEndState}


class NearEnd:
    """The host's half of one link."""

    def __init__(self, schema: Schema, name: str) -> None:
        """`name` stands in every sentence."""
        self.schema = schema
        self.parser = Parser(schema, "far end")
        self.clock = ClockFit()
        self.greeting: Hello | None = None
        """Of the far end, once it has answered ours."""
        self.state = FarEndState.safe
        """Of the far end, as its last frame said."""
        self.answered = -1
        """Sequence of our last frame that it has heard; -1 before the first."""
        self.restarted = False
        """It began anew after it had greeted us: what it knew is gone."""
        self.stale = 0
        """Samples that were not newer than the one before of their channel, and were dropped."""
        self.heard = -np.inf
        """When the last good frame came."""
        self.events: deque[tuple[float, Event]] = deque(maxlen=100)
        """What the far end told, with the time; whoever reads them takes them out."""
        self.last_event: Event | None = None
        """The latest of them, until somebody sets it to None."""
        self._name = name
        # not 0, which a far end that has heard nothing says that it heard last
        self._sequence = 1
        self._unwrapped = 0
        self._newest: dict[int, int] = {}
        self._asked: dict[int, float] = {}

    def greet(self, host_time: float) -> bytes:
        """Say who is there, behind a zero that ends whatever stood on the line."""
        return b"\0" + self._frame(
            MessageType.hello, Hello(self.schema.hash, 0, "twin").packed(), host_time
        )

    def ask_time(self, host_time: float) -> bytes:
        """Begin an exchange of clocks."""
        mark = int(host_time * 1e9)
        self._asked = {k: t for k, t in self._asked.items() if host_time - t < 1.0} | {
            mark: host_time
        }
        return self._frame(MessageType.timesync, TimeSync(mark).packed(), host_time)

    def arm(self, valid_for_ms: int, host_time: float) -> bytes:
        """Ask it to take set-points."""
        return self._frame(
            MessageType.arm, ArmRequest(self.schema.hash, valid_for_ms).packed(), host_time
        )

    def disarm(self, host_time: float) -> bytes:
        """Tell it to take none, and acknowledge its fault."""
        return self._frame(MessageType.disarm, b"", host_time)

    def safe_stop(self, host_time: float) -> bytes:
        """Tell it to be safe, at once."""
        return self._frame(MessageType.safe_stop, b"", host_time)

    def setpoints(self, command: Mapping[str, Array], valid_for_ms: int, host_time: float) -> bytes:
        """A frame for each stream, values (columns,) in SI."""
        return b"".join(
            self._frame(
                MessageType.setpoint,
                SetPoint(self.schema.number_of(stream), valid_for_ms, value).packed(self.schema),
                host_time,
            )
            for stream, value in command.items()
        )

    @property
    def last_sequence(self) -> int:
        """Of the last frame that was made."""
        return (self._sequence - 1) & 0xFFFF

    def hear(self, data: bytes, host_time: float) -> list[Sample]:
        """What came in at `host_time`: the samples in it."""
        samples: list[Sample] = []
        for frame in self.parser.feed(data):
            self.heard = host_time
            self.state = _STATES.get(frame.state, FarEndState.fault)
            if frame.flags & Flag.greeted:
                self.answered = frame.last_received
            elif self.greeting is not None:
                self.restarted = True
            device_us = self._unwrap(frame.time_us)
            match frame.type:
                case MessageType.hello:
                    # one without the flag was said before ours was heard, or refuses it
                    if frame.flags & Flag.greeted or self._is_answer(frame):
                        self.greeting = Hello.unpacked(frame.payload)
                case MessageType.timesync:
                    self._exchanged(TimeSync.unpacked(frame.payload), frame, device_us, host_time)
                case MessageType.event:
                    event = Event.unpacked(frame.payload)
                    self.events.append((host_time, event))
                    self.last_event = event
                case _:
                    samples += self._sampled(frame, device_us, host_time)
            if self.clock.estimate is not None:
                self.clock.arrival(device_us * 1e-6, host_time)
        return samples

    def event_sentences(self) -> list[str]:
        """Sentences of the events since the last call."""
        sentences = [f"{self._name}: {sentence_of(e.code, e.value)}" for _, e in self.events]
        self.events.clear()
        return sentences

    def _is_answer(self, frame: Frame) -> bool:
        return frame.last_received == self.last_sequence

    def _exchanged(self, sync: TimeSync, frame: Frame, device_us: int, host_time: float) -> None:
        sent = self._asked.pop(sync.host_ns, None)
        if sent is None:
            return
        received = device_us + _ahead(sync.received_us - frame.time_us)
        self.clock.exchange(sent, received * 1e-6, device_us * 1e-6, host_time)

    def _sampled(self, frame: Frame, device_us: int, host_time: float) -> list[Sample]:
        rows = SampleRows.unpacked(frame.payload, self.schema)
        stream = self.schema.channels[rows.channel].stream
        samples: list[Sample] = []
        for time_us, value in zip(rows.time_us, rows.value, strict=True):
            stamp = device_us + _ahead(time_us - frame.time_us)
            if stamp <= self._newest.get(rows.channel, -_CLOCK):
                self.stale += 1
                continue
            self._newest[rows.channel] = stamp
            samples.append(self._sample(stream, value, stamp * 1e-6, host_time))
        return samples

    def _sample(self, stream: str, value: Array, device_time: float, host_time: float) -> Sample:
        finite = bool(np.isfinite(value).all())
        line = self.clock.estimate
        latency = 0.0 if line is None else max(host_time - line.host(device_time), 0.0)
        return Sample(
            stream,
            tuple(value.tolist()),
            host_time,
            latency=latency,
            device_time=device_time,
            valid=finite,
            reason="" if finite else f"{self._name} has no value of {stream}",
        )

    def _unwrap(self, time_us: int) -> int:
        """The far end's clock without its wrap [us]."""
        self._unwrapped += _ahead(time_us - self._unwrapped)
        return self._unwrapped

    def _frame(self, kind: MessageType, payload: bytes, host_time: float) -> bytes:
        last = self.parser.last_sequence or 0
        frame = Frame(kind, payload, self._sequence, int(host_time * 1e6), last, self.state)
        self._sequence = (self._sequence + 1) & 0xFFFF
        return packed(frame)


def _ahead(difference: int) -> int:
    """How far one 32-bit clock stands ahead of another, of the two ways round the shorter one."""
    return (difference + _CLOCK // 2) % _CLOCK - _CLOCK // 2
