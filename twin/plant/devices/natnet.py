"""NatNet, by which OptiTrack's Motive sends what its cameras see: packets and their fields.

Layout of the "direct depacketization" samples (PythonClient/NatNetClient.py, PacketClient.cpp) of
the public NatNet SDK 3.0 to 4.2; little-endian. A packet is u16 message, u16 bytes that follow, and
these. A frame has a body's streaming number; its name stands in the model definitions alone.

The package `natnet` 0.3 reads the same, but makes memory of what a packet's counts say (four bytes
ask it for 4 GB), takes packets of any sender, and reads a `long` of the platform for 64 bits. Here
every count is held against the bytes that are there.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

OLDEST = (3, 0)
"""Version from which on a frame has the time of its exposure."""
NEWEST = (4, 2)
"""Last whose layout is known; a newer server is asked nothing, and refused."""

_SIZED = (4, 1)
"""From here on each part of a frame states its size, and assets come."""
_NAMED_MARKERS = (4, 0)


class NatNetId(IntEnum):
    """Messages."""

    connect = 0
    server = 1
    request_models = 4
    models = 5
    frame = 7
    unknown = 100
    keep_alive = 10


_HEADER = struct.Struct("<HH")
_SERVER = struct.Struct("<256s4B4BQHB4B")
_BODY = struct.Struct("<i3f4ffh")
"""Number, place [m], quaternion x y z w, mean error [m], flags."""
_TRACKED = 1
_SUFFIX = struct.Struct("<IIdQQQ")
"""Time code and its fraction, time [s], exposure, receipt and sending [ticks]."""
_MODELS_CHANGED = 2
_END = 4
"""Bytes that close a frame."""
_MARKER = struct.Struct("<i3ffhf")
_ASSET_BODY, _ASSET_MARKER = _BODY.size, _MARKER.size
_BODIES = 1
"""Kind of a description that is a rigid body; 0 is a marker set, 2 a skeleton."""


def message(kind: int, payload: bytes = b"") -> bytes:
    """A packet."""
    return _HEADER.pack(kind, len(payload)) + payload


def opened(packet: bytes) -> tuple[int, bytes] | None:
    """Message and payload; None: not a whole packet."""
    if len(packet) < _HEADER.size:
        return None
    kind, size = _HEADER.unpack_from(packet)
    return (kind, packet[_HEADER.size :]) if len(packet) == _HEADER.size + size else None


@dataclass(frozen=True)
class CameraServer:
    """Who streams."""

    name: str
    version: tuple[int, int]
    """Of NatNet."""
    frequency: int
    """Of its clock [ticks/s]."""


def decode_server(payload: bytes) -> CameraServer | None:
    """What a server says of itself; None: nothing whole."""
    if len(payload) < _SERVER.size:
        return None
    name, *rest = _SERVER.unpack_from(payload)
    text = name.split(b"\0", 1)[0].decode("utf-8", "replace")
    frequency = rest[8]
    return CameraServer(text, (rest[4], rest[5]), frequency) if frequency else None


@dataclass(frozen=True)
class SeenBody:
    """A rigid body in one frame."""

    place: tuple[float, float, float]
    """[m], the cameras' axes."""
    attitude: tuple[float, float, float, float]
    """Scalar first, cameras from body."""
    tracked: bool


@dataclass(frozen=True)
class CameraFrame:
    """What all cameras saw at one instant."""

    number: int
    bodies: dict[int, SeenBody]
    """By streaming number."""
    exposure: int
    """Middle of the exposure [ticks of the server]."""
    sent: int
    """[ticks]."""
    models_changed: bool


class _Cursor:
    """Reads on from where it stands."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, form: struct.Struct) -> tuple[object, ...]:
        values = form.unpack_from(self.data, self.at)
        self.at += form.size
        return values

    def count(self, smallest: int = 1) -> int:
        """How many follow, of at least `smallest` bytes each."""
        (number,) = _COUNT.unpack_from(self.data, self.at)
        self.at += _COUNT.size
        if not 0 <= number * smallest <= len(self.data) - self.at:
            raise struct.error("more than there is")
        return number

    def skip(self, size: int) -> None:
        if size > len(self.data) - self.at:
            raise struct.error("beyond the end")
        self.at += size

    def name(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise struct.error("a name without an end")
        text = self.data[self.at : end].decode("utf-8", "replace")
        self.at = end + 1
        return text

    def part(self, version: tuple[int, int], smallest: int) -> int:
        """How many a part of the frame has; its size is not used, for they are read."""
        number = self.count(smallest)
        if version >= _SIZED:
            self.skip(4)
        return number

    def rows(self, number: int, size: int) -> None:
        self.skip(number * size)


_COUNT = struct.Struct("<i")
_NUMBER = struct.Struct("<i")
_FLAGS = struct.Struct("<H")


def decode_frame(payload: bytes, version: tuple[int, int]) -> CameraFrame | None:
    """A frame; None: not one of that version, or not whole."""
    try:
        return _frame(_Cursor(payload), version)
    except struct.error:
        return None


def _frame(cursor: _Cursor, version: tuple[int, int]) -> CameraFrame:
    (number,) = cursor.take(_NUMBER)
    for _ in range(cursor.part(version, 5)):
        cursor.name()
        cursor.rows(cursor.count(12), 12)
    cursor.rows(cursor.part(version, 12), 12)
    bodies: dict[int, SeenBody] = {}
    for _ in range(cursor.part(version, _BODY.size)):
        which, *row = _BODY.unpack_from(cursor.data, cursor.at)
        cursor.skip(_BODY.size)
        x, y, z, a, b, c, w, _, flags = row
        bodies[which] = SeenBody((x, y, z), (w, a, b, c), bool(flags & _TRACKED))
    for _ in range(cursor.part(version, 8)):
        cursor.skip(4)
        cursor.rows(cursor.count(_BODY.size), _BODY.size)
    if version >= _SIZED:
        for _ in range(cursor.part(version, 12)):
            cursor.skip(4)
            cursor.rows(cursor.count(_ASSET_BODY), _ASSET_BODY)
            cursor.rows(cursor.count(_ASSET_MARKER), _ASSET_MARKER)
    cursor.rows(cursor.part(version, _MARKER.size), _MARKER.size)
    for _ in range(2):  # force plates, then other devices
        for _ in range(cursor.part(version, 8)):
            cursor.skip(4)
            for _ in range(cursor.count(4)):
                cursor.rows(cursor.count(4), 4)
    _, _, _, exposure, _, sent = _SUFFIX.unpack_from(cursor.data, cursor.at)
    cursor.skip(_SUFFIX.size)
    if len(cursor.data) - cursor.at >= 8 + _FLAGS.size + _END:
        cursor.skip(8)  # the same time, from a clock that several share: of 4.1 and later
    (flags,) = _FLAGS.unpack_from(cursor.data, cursor.at)
    assert isinstance(number, int)
    return CameraFrame(number, bodies, exposure, sent, bool(flags & _MODELS_CHANGED))


def decode_models(payload: bytes, version: tuple[int, int]) -> dict[str, int] | None:
    """Rigid bodies, name -> streaming number; None: not whole."""
    try:
        return _models(_Cursor(payload), version)
    except struct.error:
        return None


def _models(cursor: _Cursor, version: tuple[int, int]) -> dict[str, int]:
    bodies: dict[str, int] = {}
    for _ in range(cursor.count(4)):
        (kind,) = cursor.take(_NUMBER)
        end = None
        if version >= _SIZED:
            size = cursor.count()
            end = cursor.at + size
        if kind == _BODIES:
            name = cursor.name()
            (number,) = _NUMBER.unpack_from(cursor.data, cursor.at)
            bodies[name] = number
        if end is not None:
            cursor.at = end
        elif kind == _BODIES:
            _skip_body(cursor, version)
        elif kind in _OTHERS:
            _OTHERS[kind](cursor, version)
        else:
            break  # plates, devices and cameras come behind all bodies
    return bodies


def _skip_body(cursor: _Cursor, version: tuple[int, int]) -> None:
    """Behind its name: numbers of it and its parent, offset, and its markers."""
    cursor.skip(4 + 4 + 12)
    markers = cursor.count(16)
    cursor.rows(markers, 16)
    if version >= _NAMED_MARKERS:
        for _ in range(markers):
            cursor.name()


def _skip_markers(cursor: _Cursor, version: tuple[int, int]) -> None:
    cursor.name()
    for _ in range(cursor.count()):
        cursor.name()


def _skip_skeleton(cursor: _Cursor, version: tuple[int, int]) -> None:
    cursor.name()
    cursor.skip(4)
    for _ in range(cursor.count()):
        cursor.name()
        _skip_body(cursor, version)


_OTHERS: dict[object, Callable[[_Cursor, tuple[int, int]], None]] = {
    0: _skip_markers,
    2: _skip_skeleton,
}
