"""The far end of our link: what docs/link.md says a firmware must do, and no more.

No input or output: bytes and the far end's own clock come in, bytes go out. The C99 firmware in
docs/firmware is held against it, byte for byte.
"""

import numpy as np
from numpy.typing import NDArray

from twin.plant.devices.link.frame import Frame, Parser, packed
from twin.plant.devices.link.messages import FarEndState, Flag, MessageType
from twin.plant.devices.link.payloads import (
    ArmRequest,
    Event,
    Hello,
    SampleRows,
    SetPoint,
    TimeSync,
)
from twin.plant.devices.link.schema import Schema

Array = NDArray[np.float64]

ALL_CHANNELS = 255
"""Stands for a channel's number where none is meant."""

_CLOCK = 2**32
_MS = 1000


class FarEnd:
    """The state machine of one far end. Clocks are its own, microseconds, 32 bits."""

    def __init__(self, schema: Schema, name: str, longest_valid_ms: int, device_us: int) -> None:
        """Begin: safe, not greeted, a greeting on its way."""
        self.schema = schema
        self.state = FarEndState.safe
        self.flags = Flag(0)
        self.parser = Parser(schema, "host")
        self.setpoint: dict[int, Array] = {}
        """Of channels that have a set-point in force, SI."""
        self.heard: dict[int, int] = {}
        """Of the same channels: the last frame of ours that the host had heard as it said so."""
        self.last_event: Event | None = None
        """The latest that it told."""
        self._hello = Hello(schema.hash, longest_valid_ms, name).packed()
        self._longest = longest_valid_ms
        self._until: dict[int, int] = {}
        """Channel -> when its set-point runs out [us]; `ALL_CHANNELS` before the first one."""
        self._sequence = 0
        self._out: list[bytes] = []
        self._send(MessageType.hello, self._hello, device_us)

    def receive(self, data: bytes, device_us: int) -> None:
        """Bytes of the host; what they ask for waits in `take`."""
        self.advance(device_us)
        # frame by frame, so that an answer acknowledges its own question
        for piece in data.split(b"\0")[:-1]:
            self._hear(piece + b"\0", device_us)
        self.parser.feed(data.rsplit(b"\0", 1)[-1])

    def advance(self, device_us: int) -> None:
        """Let set-points run out."""
        over = [c for c, until in self._until.items() if (device_us - until) % _CLOCK < _CLOCK // 2]
        if over:
            self._make_safe()
            first = ALL_CHANNELS if ALL_CHANNELS in over else min(over)
            self.event("EXPIRED", first, device_us)

    def take(self) -> bytes:
        """What it has said since the last call."""
        out, self._out = b"".join(self._out), []
        return out

    @property
    def last_sequence(self) -> int:
        """Of the last frame that was made."""
        return (self._sequence - 1) & 0xFFFF

    def sample(self, channel: int, time_us: int, value: Array, device_us: int) -> None:
        """Send values (columns,) of a measured channel that were true at `time_us`."""
        rows = SampleRows(channel, (time_us % _CLOCK,), value[None])
        self._send(MessageType.samples, rows.packed(self.schema), device_us)

    def event(self, code: str, value: float, device_us: int) -> None:
        """Tell the host something."""
        self.last_event = Event(code, value)
        self._send(MessageType.event, self.last_event.packed(), device_us)

    def skip(self, frames: int) -> None:
        """Lose the next frames: their numbers are never sent."""
        self._sequence = (self._sequence + frames) & 0xFFFF

    def fault(self, code: str, value: float, device_us: int) -> None:
        """Be safe until a DISARM acknowledges it."""
        self._make_safe()
        self.state = FarEndState.fault
        self.event(code, value, device_us)

    def _hear(self, packet: bytes, device_us: int) -> None:
        for frame in self.parser.feed(packet):
            match frame.type:
                case MessageType.hello:
                    self._greeted(Hello.unpacked(frame.payload), device_us)
                case MessageType.timesync:
                    asked = TimeSync.unpacked(frame.payload)
                    answer = TimeSync(asked.host_ns, device_us % _CLOCK).packed()
                    self._send(MessageType.timesync, answer, device_us)
                case MessageType.arm:
                    self._arm(ArmRequest.unpacked(frame.payload), device_us)
                case MessageType.setpoint:
                    self._set_point(frame, device_us)
                case MessageType.disarm:
                    self._make_safe()
                    self.state = FarEndState.safe
                    self.event("SAFE", 0.0, device_us)
                case _:
                    self._make_safe()
                    self.event("SAFE", 0.0, device_us)

    def _greeted(self, hello: Hello, device_us: int) -> None:
        # who greets begins anew: what the last host armed is not this one's
        self._make_safe()
        same = hello.schema_hash == self.schema.hash
        self.flags = Flag.greeted if same else Flag(0)
        self._send(MessageType.hello, self._hello, device_us)
        if not same:
            self.event("SCHEMA", 0.0, device_us)

    def _arm(self, arm: ArmRequest, device_us: int) -> None:
        if arm.schema_hash != self.schema.hash or Flag.greeted not in self.flags:
            self.event("SCHEMA", 0.0, device_us)
        elif self.state is FarEndState.fault:
            self.event("FAULTED", 0.0, device_us)
        elif not 0 < arm.valid_for_ms <= self._longest:
            self.event("VALUE", ALL_CHANNELS, device_us)
        else:
            self._make_safe()
            self.state = FarEndState.armed
            self._until[ALL_CHANNELS] = device_us + _MS * arm.valid_for_ms
            self.event("ARMED", 0.0, device_us)

    def _set_point(self, frame: Frame, device_us: int) -> None:
        wish = SetPoint.unpacked(frame.payload, self.schema)
        if self.state is not FarEndState.armed:
            self.event("UNARMED", MessageType.setpoint, device_us)
        elif (
            frame.payload[1]
            or not 0 < wish.valid_for_ms <= self._longest
            or not np.isfinite(wish.value).all()
        ):
            self.event("VALUE", wish.channel, device_us)
        else:
            self._until.pop(ALL_CHANNELS, None)
            self._until[wish.channel] = device_us + _MS * wish.valid_for_ms
            self.setpoint[wish.channel] = wish.value
            self.heard[wish.channel] = frame.last_received
            self.flags |= Flag.live

    def _make_safe(self) -> None:
        if self.state is FarEndState.armed:
            self.state = FarEndState.safe
        self.flags &= ~Flag.live
        self._until.clear()
        self.setpoint.clear()
        self.heard.clear()

    def _send(self, kind: MessageType, payload: bytes, device_us: int) -> None:
        heard = self.parser.last_sequence or 0
        frame = Frame(kind, payload, self._sequence, device_us, heard, self.state, self.flags)
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._out.append(packed(frame))
