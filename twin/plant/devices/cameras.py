"""Sessions with systems of cameras that see the body: OptiTrack (NatNet) and Vicon.

Both send packets over UDP without a key; whoever is in the network can forge them, so the network
of a laboratory's cameras should be its own. The guard's checks stand behind (docs/safety.md).

Vicon Tracker's "UDP object stream" (Tracker's user guide, Output to UDP): little-endian, u32 frame,
u8 objects, and for each u8 kind (0: an object), u16 bytes that follow (72), its name in 24 bytes
that end in zeros, place in three doubles [mm], rotation in three doubles [rad] about X, Y and Z.
"""

import abc
import math
import struct
import time
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from twin.errors import DeviceError, UsageError
from twin.plant.devices.device import DeviceSettings, Sample, StreamLimits, missing
from twin.plant.devices.natnet import (
    NEWEST,
    OLDEST,
    CameraServer,
    NatNetId,
    decode_frame,
    decode_models,
    decode_server,
    message,
    opened,
)
from twin.plant.devices.network import DatagramPort, is_network, peer_of
from twin.plant.devices.sensor import ListeningSession
from twin.plant.devices.xbus import Promptest, Wrapping
from twin.rotation import from_rotation_vector, multiply, rotate

Array = NDArray[np.float64]

_ANSWER = 0.25
"""How long an answer may take [s]."""
_TRIES = 12
_QUIET = 0.05
_ALIVE = 1.0
"""So often a server of NatNet is told that somebody listens [s]; it forgets after some seconds."""
_LOST_FRAMES = 10_000
"""More missing frames than that are a system that began anew."""
_LONGEST_AGE = 10.0
"""Between exposure and sending [s]: more is a corrupt stamp."""

_TURNS = {"z": (1.0, 0.0, 0.0, 0.0), "y": (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)}
"""Which axis of the cameras points up -> the room's axes from theirs."""


@dataclass(frozen=True, kw_only=True)
class CameraSettings(DeviceSettings):
    """Cameras that send where a body is."""

    baud: int = 0
    """A network has none."""
    body: str
    """Name of the rigid body, as their program has it."""
    up: Literal["y", "z"] = "z"
    """Which of their axes points up."""
    turn: tuple[float, float, float, float] | None = None
    """Unit quaternion that turns their axes into the room's; None: as `up` says."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The room's origin in their axes [m]."""
    rate: int = 100
    """Of their frames [Hz]."""
    silence: float = 0.25
    """So long without a frame [s] is said to be silence."""

    def __post_init__(self) -> None:
        """Hold the parts against each other.

        Raises:
            UsageError: no network, no unit quaternion, no rate.
        """
        if not is_network(self.port):
            raise UsageError(f"{self.name}: {self.port} is no port of cameras; give udp://...")
        if self.turn is not None and abs(math.hypot(*self.turn) - 1.0) > 1e-6:
            raise UsageError(f"{self.name}: turn has the length {math.hypot(*self.turn):g}, not 1")
        if self.rate < 1:
            raise UsageError(f"{self.name}: {self.rate} frames a second; give 1 or more")

    def limits(self) -> dict[str, StreamLimits]:
        """Packets have a checksum of 16 bits; the rest follows from the machine's sensors."""
        return {"attitude": StreamLimits(range=1.01), "position": StreamLimits()}

    @property
    def room_from_cameras(self) -> Array:
        """(4,) unit quaternion."""
        return np.array(_TURNS[self.up] if self.turn is None else self.turn)


class Cameras(ListeningSession[DatagramPort]):
    """Measures `attitude` (world from body) and `position` [m] of one body."""

    def __init__(self, settings: CameraSettings) -> None:
        super().__init__(
            settings.name, streams={"attitude": 4, "position": 3}, silence=settings.silence
        )
        self._camera_settings = settings
        self._frames = Wrapping(1 << 32)
        self._promptest = Promptest()

    @abc.abstractmethod
    def _open(self) -> DatagramPort: ...

    def _new(self, frame: int) -> bool:
        """Whether a frame is after all before it; counts what is missing, and what comes again."""
        step = self._frames.step(frame & 0xFFFFFFFF)
        if step is not None and abs(step) > _LOST_FRAMES:
            self._promptest.forget()
            self.notes.append(f"{self.name}: its frames begin anew, at {frame}")
        elif step is not None and step <= 0:
            self.counters.repeats += 1
            self._frames.step(frame - step & 0xFFFFFFFF)
            return False
        elif step is not None:
            self.counters.gaps += step - 1
        self.counters.frames += 1
        return True

    def _keep_body(
        self, attitude: Array, place: Array, arrival: float, age: float, stamp: float
    ) -> None:
        """Keep one frame's body, (4,) and (3,) [m] in the cameras' axes."""
        turn = self._camera_settings.room_from_cameras
        origin = np.array(self._camera_settings.origin)
        with np.errstate(over="ignore", invalid="ignore"):
            values = {
                "attitude": multiply(turn, attitude),
                "position": rotate(turn, place - origin),
            }
        for stream, value in values.items():
            known = tuple(value.tolist())
            self._keep(Sample(stream, known, arrival, latency=age, device_time=stamp))

    def _keep_lost(self, arrival: float) -> None:
        reason = f"{self.name}: the cameras do not see {self._camera_settings.body}"
        for stream, width in self.streams.items():
            self._keep(missing(stream, width, arrival, reason))


@dataclass(frozen=True, kw_only=True)
class NatNetSettings(CameraSettings):
    """OptiTrack's Motive; `port` is its computer and command port, usually 1510."""

    up: Literal["y", "z"] = "y"
    """Motive's setting "Up Axis"; y from the factory."""
    multicast: str = ""
    """Group to which it sends, usually 239.255.42.99; empty: unicast, to each who asks."""
    data_port: int = 1511
    """Of the group."""

    def session(self) -> "NatNet":
        """A session with this device, not yet connected."""
        return NatNet(self)


class NatNet(Cameras):
    """OptiTrack's cameras."""

    def __init__(self, settings: NatNetSettings) -> None:
        super().__init__(settings)
        self._settings = settings
        self._server = CameraServer("", OLDEST, 1)
        self._which = -1
        self._last_sent = 0.0
        """When the server was last told that somebody listens."""

    def _open(self) -> DatagramPort:
        group = self._settings.multicast
        peer = peer_of(self.name, self._settings.port)
        return DatagramPort(
            self.name,
            peer,
            self.counters,
            group=(group, self._settings.data_port) if group else None,
        )

    def _greet(self, port: DatagramPort) -> None:
        answer = self._ask(port, message(NatNetId.connect, b"Ping\0"), NatNetId.server)
        server = decode_server(answer)
        if server is None or not OLDEST <= server.version <= NEWEST:
            told = "nothing" if server is None else ".".join(map(str, server.version))
            raise DeviceError(
                self.name,
                f"the server says {told} of its version of NatNet",
                f"{'.'.join(map(str, OLDEST))} to {'.'.join(map(str, NEWEST))} are read",
            )
        self._server = server
        self.identity = f"{server.name}, NatNet {server.version[0]}.{server.version[1]}"
        self._find(self._ask(port, message(NatNetId.request_models), NatNetId.models))

    def _find(self, models: bytes) -> None:
        """The body's number.

        Raises:
            DeviceError: there is no such body.
        """
        bodies = decode_models(models, self._server.version) or {}
        if self._settings.body not in bodies:
            known = ", ".join(bodies) or "no rigid body"
            raise DeviceError(
                self.name, f"has no body {self._settings.body!r}", f"it streams {known}"
            )
        self._which = bodies[self._settings.body]

    def _set_up(self, port: DatagramPort) -> None:
        self._frames.forget()
        self._promptest.forget()

    def _ask(self, port: DatagramPort, question: bytes, wanted: NatNetId) -> bytes:
        """Payload of the answer; frames on the way are left out."""
        for _ in range(_TRIES):
            port.send(question)
            deadline = time.monotonic() + _ANSWER
            while (left := deadline - time.monotonic()) > 0.0:
                for packet in port.receive(left):
                    match opened(packet):
                        case (kind, payload) if kind == wanted:
                            return payload
                        case _:
                            pass
            self.counters.timeouts += 1
        where = f"udp://{port.peer.host}:{port.peer.port}"
        raise DeviceError(
            self.name,
            f"no {wanted.name} from {where} in {_TRIES * _ANSWER:g} s",
            "is Motive streaming, to this computer's network, and is that its command port?",
        )

    def _listen(self, port: DatagramPort) -> None:
        clock = time.monotonic()
        if clock - self._last_sent > _ALIVE:
            self._last_sent = clock
            port.send(message(NatNetId.keep_alive))
        packets = port.receive(_QUIET)
        arrival = time.monotonic()
        for packet in packets:
            match opened(packet):
                case (NatNetId.frame, payload):
                    self._framed(port, payload, arrival)
                case (NatNetId.models, payload):
                    self._renamed(payload)
                case None:
                    self.counters.bad_checksums += 1
                case _:
                    pass

    def _renamed(self, payload: bytes) -> None:
        before = self._which
        self._find(payload)
        if before != self._which:
            self.notes.append(f"{self.name}: {self._settings.body} is number {self._which} now")

    def _framed(self, port: DatagramPort, payload: bytes, arrival: float) -> None:
        frame = decode_frame(payload, self._server.version)
        if frame is None:
            self.counters.bad_checksums += 1
            return
        if not self._new(frame.number):
            return
        if frame.models_changed:
            port.send(message(NatNetId.request_models))
        body = frame.bodies.get(self._which)
        if body is None or not body.tracked or not all(map(math.isfinite, body.attitude)):
            self._keep_lost(arrival)
            return
        waited = (frame.sent - frame.exposure) / self._server.frequency
        stamp = frame.sent / self._server.frequency
        if not 0.0 <= waited <= _LONGEST_AGE:
            self.counters.bad_checksums += 1
            return
        # what this computer read late was sent when its stamp says
        age = waited + arrival - min(self._promptest.host(stamp, arrival), arrival)
        self._keep_body(np.array(body.attitude), np.array(body.place), arrival, age, stamp - waited)


@dataclass(frozen=True, kw_only=True)
class ViconSettings(CameraSettings):
    """Vicon Tracker's UDP object stream; `port` is its computer, and the port it sends to."""

    latency: float = 0.0
    """From exposure to sending [s], as Tracker shows it: the stream does not say."""
    order: Literal["xyz", "zyx"] = "xyz"
    """The rotation is R = Rx Ry Rz, or Rz Ry Rx."""

    def session(self) -> "Vicon":
        """A session with this device, not yet connected."""
        return Vicon(self)


_BLOCK = struct.Struct("<IB")
_ITEM = struct.Struct("<BH")
_OBJECT = struct.Struct("<24s3d3d")
_AXES = np.eye(3)


def decode_vicon(packet: bytes) -> tuple[int, dict[str, tuple[float, ...]]] | None:
    """Frame, and its objects: name -> place [mm] and rotation [rad]; None: not a whole packet."""
    if len(packet) < _BLOCK.size:
        return None
    frame, count = _BLOCK.unpack_from(packet)
    at, objects = _BLOCK.size, dict[str, tuple[float, ...]]()
    for _ in range(count):
        if len(packet) < at + _ITEM.size:
            return None
        kind, size = _ITEM.unpack_from(packet, at)
        at += _ITEM.size
        if len(packet) < at + size:
            return None
        if kind == 0:
            if size != _OBJECT.size:
                return None
            name, *values = _OBJECT.unpack_from(packet, at)
            objects[name.split(b"\0", 1)[0].decode("utf-8", "replace")] = tuple(values)
        at += size
    # Tracker fills its packets up
    return (frame, objects) if not any(packet[at:]) else None


class Vicon(Cameras):
    """Vicon's cameras."""

    def __init__(self, settings: ViconSettings) -> None:
        super().__init__(settings)
        self._settings = settings

    def _open(self) -> DatagramPort:
        peer = peer_of(self.name, self._settings.port)
        return DatagramPort(self.name, peer, self.counters, listen=peer.port)

    def _greet(self, port: DatagramPort) -> None:
        seen: set[str] = set()
        end = time.monotonic() + _TRIES * _ANSWER
        while time.monotonic() < end:
            for packet in port.receive(_QUIET):
                decoded = decode_vicon(packet)
                seen |= set(decoded[1]) if decoded is not None else set[str]()
                if self._settings.body in seen:
                    return
        known = f"they send {', '.join(sorted(seen))}" if seen else "is the object stream enabled?"
        problem = f"nothing of {self._settings.body!r} on {self._settings.port}"
        raise DeviceError(self.name, problem, known)

    def _set_up(self, port: DatagramPort) -> None:
        self._frames.forget()
        self._promptest.forget()

    def _listen(self, port: DatagramPort) -> None:
        packets = port.receive(_QUIET)
        arrival = time.monotonic()
        for packet in packets:
            decoded = decode_vicon(packet)
            if decoded is None:
                self.counters.bad_checksums += 1
            elif self._new(decoded[0]):
                self._measured(decoded[1].get(self._settings.body), arrival)

    def _measured(self, values: tuple[float, ...] | None, arrival: float) -> None:
        # an object that is hidden is absent, or stands at zero without a rotation
        if values is None or not any(values) or not all(map(math.isfinite, values)):
            self._keep_lost(arrival)
            return
        stamp = self._frames.total / self._settings.rate
        age = self._settings.latency + arrival - min(self._promptest.host(stamp, arrival), arrival)
        turns = [
            from_rotation_vector(axis * angle)
            for axis, angle in zip(_AXES, values[3:], strict=True)
        ]
        first, second, third = turns if self._settings.order == "xyz" else turns[::-1]
        attitude = multiply(multiply(first, second), third)
        self._keep_body(attitude, 1e-3 * np.array(values[:3]), arrival, age, stamp)
