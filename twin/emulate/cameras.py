"""Emulated cameras that see a simulated machine: OptiTrack's Motive and Vicon's Tracker.

Written from the layouts that `twin.plant.devices.natnet` and `.cameras` cite. What noise and
lateness their values have is the simulated sensor's business.
"""

import struct
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from twin.emulate.emulated import EmulatedPeer
from twin.emulate.machine import Share, Simultaneous
from twin.errors import UnknownName
from twin.plant.devices.cameras import CameraSettings, NatNetSettings, ViconSettings
from twin.rotation import conjugate, matrix, multiply, rotate

Array = NDArray[np.float64]

FREQUENCY = 10_000_000
"""Of the server's clock [ticks/s], that of Windows."""
_FORGETS = 10.0
"""A unicast server that hears nothing from a host for so long stops sending to it [s]."""
BODIES = {"wand": 7, "": 12}
"""Streaming numbers: of something else that the cameras see, and of the body."""

FAULTS: Mapping[str, str] = {
    "lost": "the cameras lose the body for `value` seconds",
    "frozen": "the frames go on, and the body stands still in them for `value` seconds",
    "restart": "the frames' numbers begin anew",
    "renamed": "the body gets another streaming number",
}


class EmulatedCameras(EmulatedPeer):
    """What both systems have in common: frames of a body that a machine moves."""

    def __init__(self, settings: CameraSettings, share: Share, sources: Collection[str]) -> None:
        """Switch them on; `sources` are what the machine shows them."""
        self._instants = Simultaneous(sources)
        self._settings, self._share = settings, share
        self._frame = 1000
        self._now = 0.0
        self._lost = self._frozen = -1.0
        self._attitude = np.array([1.0, 0.0, 0.0, 0.0])
        self._place = np.array(settings.origin)
        self._shown: tuple[Array, Array] | None = None

    def power_cycle(self, time: float) -> None:
        self._frame = 0

    def inject(self, fault: str, value: float = 0.0) -> None:
        if fault not in FAULTS:
            raise UnknownName("fault of cameras", fault, FAULTS)
        if fault == "restart":
            self._frame = 0
        elif fault == "renamed":
            self._rename()
        elif fault == "lost":
            self._lost = self._now + value
        else:
            self._frozen = self._now + value

    def _rename(self) -> None:
        """Only where bodies have numbers."""

    def advance(self, time: float) -> list[bytes]:
        self._now = time
        turn, origin = self._settings.room_from_cameras, np.array(self._settings.origin)
        out: list[bytes] = []
        for exposure, values in self._instants.complete(self._share.step({}, time)):
            if "attitude" in values:
                self._attitude = multiply(conjugate(turn), values["attitude"])
            if "position" in values:
                self._place = rotate(conjugate(turn), values["position"]) + origin
            out += self._framed(exposure, time)
        return out

    def _framed(self, exposure: float, time: float) -> list[bytes]:
        self._frame += 1
        if time >= self._frozen or self._shown is None:
            self._shown = self._attitude, self._place
        attitude, place = self._shown
        sees = time >= self._lost and bool(np.isfinite([*attitude, *place]).all())
        return self._packets(exposure, time, attitude, place, sees=sees)

    def _packets(
        self, exposure: float, time: float, attitude: Array, place: Array, *, sees: bool
    ) -> list[bytes]:
        raise NotImplementedError


def _part(count: int, rows: bytes, version: tuple[int, int]) -> bytes:
    size = struct.pack("<i", len(rows)) if version >= (4, 1) else b""
    return struct.pack("<i", count) + size + rows


def _body(number: int, place: Array, attitude: Array, *, tracked: bool) -> bytes:
    w, x, y, z = attitude
    return struct.pack("<i3f4ffh", number, *place, x, y, z, w, 2e-4, int(tracked))


class EmulatedNatNet(EmulatedCameras):
    """Motive, which sends to the last host that has spoken."""

    listens = True

    def __init__(
        self,
        settings: NatNetSettings,
        share: Share,
        sources: Collection[str],
        version: tuple[int, int] = (4, 1),
    ) -> None:
        """Switch it on; `version` of NatNet."""
        super().__init__(settings, share, sources)
        self._version = version
        self._number = BODIES[""]
        self._changed = False
        self._heard = -np.inf

    def _rename(self) -> None:
        self._number += 1
        self._changed = True

    def receive(self, packet: bytes, time: float) -> list[bytes]:
        if len(packet) < 4:
            return []
        kind, size = struct.unpack_from("<HH", packet)
        if size != len(packet) - 4:
            return []
        self._heard = time
        if kind == 0:
            name = b"Motive".ljust(256, b"\0")
            version = bytes([3, 1, 0, 0, *self._version, 0, 0])
            rest = struct.pack("<QHB4B", FREQUENCY, 1511, 0, 239, 255, 42, 99)
            return [self._message(1, name + version + rest)]
        if kind == 4:
            self._changed = False
            return [self._message(5, self._models())]
        return [] if kind == 10 else [self._message(100, b"")]

    def _models(self) -> bytes:
        """A marker set, a body that is not meant, and the one that is."""
        sets = [(0, b"all\0" + struct.pack("<i", 2) + b"wand_1\0wand_2\0")]
        for name, number in (("wand", BODIES["wand"]), (self._settings.body, self._number)):
            row = name.encode() + b"\0" + struct.pack("<ii3f", number, -1, 0, 0, 0)
            row += struct.pack("<4f", 0, 0, 0, 1) if self._version >= (4, 2) else b""
            row += struct.pack("<i3fi", 1, 0.1, 0.0, 0.0, 0)
            sets.append((1, row + (b"marker\0" if self._version >= (4, 0) else b"")))
        out = struct.pack("<i", len(sets))
        for kind, row in sets:
            sized = struct.pack("<i", len(row)) if self._version >= (4, 1) else b""
            out += struct.pack("<i", kind) + sized + row
        return out

    def _packets(
        self, exposure: float, time: float, attitude: Array, place: Array, *, sees: bool
    ) -> list[bytes]:
        if time > self._heard + _FORGETS:
            return []
        version, still = self._version, np.array([1.0, 0.0, 0.0, 0.0])
        markers = b"all\0" + struct.pack("<i6f", 2, *range(6))
        bodies = _body(BODIES["wand"], np.ones(3), still, tracked=True)
        # of a body that is lost Motive sends what it saw last, without the flag
        known = attitude if np.isfinite(attitude).all() else still
        bodies += _body(self._number, place, known, tracked=sees)
        skeleton = struct.pack("<ii", 1, 1) + _body(1, np.ones(3), still, tracked=True)
        plate = struct.pack("<iii2f", 1, 1, 2, 0.0, 1.0)
        labelled = struct.pack("<i3ffhf", 1, 0.0, 0.0, 0.0, 0.01, 0, 0.0)
        payload = struct.pack("<i", self._frame) + _part(1, markers, version)
        payload += _part(1, struct.pack("<3f", 1, 2, 3), version)
        payload += _part(2, bodies, version) + _part(1, skeleton, version)
        payload += _part(0, b"", version) if version >= (4, 1) else b""
        payload += _part(1, labelled, version) + _part(1, plate, version) + _part(0, b"", version)
        ticks = [round(FREQUENCY * instant) for instant in (exposure, time, time)]
        payload += struct.pack("<IIdQQQ", 0, 0, exposure, *ticks)
        payload += struct.pack("<II", 0, 0) if version >= (4, 1) else b""
        payload += struct.pack("<Hi", 2 if self._changed else 0, 0)
        return [self._message(7, payload)]

    @staticmethod
    def _message(kind: int, payload: bytes) -> bytes:
        return struct.pack("<HH", kind, len(payload)) + payload


class EmulatedVicon(EmulatedCameras):
    """Tracker, which sends to its port whether somebody listens or not."""

    listens = False

    def __init__(self, settings: ViconSettings, share: Share, sources: Collection[str]) -> None:
        """Switch it on."""
        super().__init__(settings, share, sources)
        self._order = settings.order

    def receive(self, packet: bytes, time: float) -> list[bytes]:
        return []

    def _packets(
        self, exposure: float, time: float, attitude: Array, place: Array, *, sees: bool
    ) -> list[bytes]:
        objects = [("wand", np.ones(3), np.zeros(3))]
        if sees:
            objects.append((self._settings.body, 1e3 * place, self._angles(attitude)))
        packet = struct.pack("<IB", self._frame, len(objects))
        for name, where, turn in objects:
            packet += struct.pack("<BH24s3d3d", 0, 72, name.encode()[:23], *where, *turn)
        return [packet.ljust(1024, b"\0")]

    def _angles(self, attitude: Array) -> Array:
        """(3,) about X, Y and Z [rad], of R = Rx Ry Rz or of R = Rz Ry Rx."""
        turn = matrix(attitude)
        if self._order == "xyz":
            middle = np.arcsin(np.clip(turn[0, 2], -1.0, 1.0))
            first = np.arctan2(-turn[1, 2], turn[2, 2])
            last = np.arctan2(-turn[0, 1], turn[0, 0])
        else:
            middle = np.arcsin(np.clip(-turn[2, 0], -1.0, 1.0))
            first = np.arctan2(turn[2, 1], turn[2, 2])
            last = np.arctan2(turn[1, 0], turn[0, 0])
        return np.array([first, middle, last])
