"""An emulated device's end of a network, on this computer: packets, and what is wrong with them."""

import contextlib
import socket

from twin.emulate.emulated import NETWORK_FAULTS, EmulatedPeer, Fault, PacketWire
from twin.emulate.served import Served
from twin.errors import DeviceError
from twin.plant.devices.network import peer_of

STRANGER = "127.0.0.2"
"""Address of this computer from which somebody else sends; Linux alone has it by itself."""

_AT_ONCE = 256


def free_port() -> int:
    """A port of this computer that nobody uses now."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


class PacketServer(Served):
    """A device in the network of this computer."""

    def __init__(
        self,
        device: EmulatedPeer,
        url: str,
        faults: tuple[Fault, ...],
        seed: int,
        *,
        start: float,
    ) -> None:
        """Open its port; `start` [s] is the monotonic clock at the emulation's time 0.

        Raises:
            DeviceError: the port is taken.
        """
        super().__init__(device, faults, NETWORK_FAULTS, start=start)
        self._device = device
        peer = peer_of("the emulation", url)
        self._to_device, self._to_host = (
            PacketWire(self._of_wire, seed + direction) for direction in (0, 1)
        )
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._host: tuple[str, int] | None = None if device.listens else (peer.host, peer.port)
        """Whom it answers, the last who spoke; None: nobody has yet."""
        self._stepped = 0.0
        try:
            self._socket.setblocking(False)
            self._socket.bind((peer.host, peer.port if device.listens else 0))
            with contextlib.suppress(OSError):
                self._other.bind((STRANGER, 0))
        except OSError as error:
            self.close()
            problem = f"cannot have {url} ({error})"
            raise DeviceError("the emulation", problem, "close what listens there") from error

    def step(self) -> tuple[bytes, bytes]:
        now = self._time()
        self.stalled = max(self.stalled, now - self._stepped)
        self._happen(now)
        into = self._to_device.carry(self._came(), now)
        said = [answer for packet in into for answer in self._device.receive(packet, now)]
        said += self._device.advance(now)
        out = self._to_host.beaten(self._to_host.carry(said, now), now, self._stepped)
        self._stepped = now
        for packet in out:
            self._send(self._socket, packet)
            for forged in self._to_host.forged(packet, now):
                self._send(self._other, forged)
        return b"".join(out), b"".join(into)

    @property
    def watched(self) -> list[int]:
        return [self._socket.fileno()]

    def close(self) -> None:
        self._socket.close()
        self._other.close()

    def _came(self) -> list[bytes]:
        packets: list[bytes] = []
        with contextlib.suppress(BlockingIOError, ConnectionError):
            for _ in range(_AT_ONCE):
                packet, sender = self._socket.recvfrom(65535)
                if self._device.listens:
                    self._host = sender
                packets.append(packet)
        return packets

    def _send(self, source: socket.socket, packet: bytes) -> None:
        if self._host is not None:
            with contextlib.suppress(BlockingIOError, ConnectionError):
                source.sendto(packet, self._host)
