"""An emulated device's end of a network, on this computer: packets, and what is wrong with them."""

import contextlib
import socket
from collections.abc import Callable

from twin.emulate.emulated import NETWORK_FAULTS, EmulatedPeer, Fault, PacketWire
from twin.emulate.served import Served
from twin.errors import DeviceError
from twin.plant.devices.counters import Counters
from twin.plant.devices.network import Peer, peer_of
from twin.plant.devices.sealed import FAR_END, Seal, key_of

STRANGER = "127.0.0.2"
"""Address of this computer from which somebody else sends; Linux alone has it by itself."""

_AT_ONCE = 256


def free_port() -> int:
    """A port of this computer that nobody uses now."""
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


class Sockets:
    """The socket of an emulated device, and that of a stranger."""

    def __init__(self, host: str, port: int) -> None:
        """Open them; `port` 0: any.

        Raises:
            DeviceError: the port is taken.
        """
        self._own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._own.setblocking(False)
            self._own.bind((host, port))
            with contextlib.suppress(OSError):
                self._other.bind((STRANGER, 0))
        except OSError as error:
            self.close()
            problem = f"cannot have port {port} of {host} ({error})"
            raise DeviceError("the emulation", problem, "close what listens there") from error

    @property
    def number(self) -> int:
        """File descriptor of the device's."""
        return self._own.fileno()

    def received(self) -> list[tuple[bytes, tuple[str, int]]]:
        """Packets that have come, each with its sender."""
        packets: list[tuple[bytes, tuple[str, int]]] = []
        with contextlib.suppress(BlockingIOError, ConnectionError):
            for _ in range(_AT_ONCE):
                packets.append(self._own.recvfrom(65535))
        return packets

    def send(self, packet: bytes, host: tuple[str, int] | None, *, forged: bool = False) -> None:
        """To the host, if one is known."""
        if host is not None:
            with contextlib.suppress(BlockingIOError, ConnectionError):
                (self._other if forged else self._own).sendto(packet, host)

    def close(self) -> None:
        """Release both."""
        self._own.close()
        self._other.close()


class SealedEnd:
    """The far end of a line over UDP (`twin.plant.devices.sealed`), in the place of a terminal."""

    def __init__(
        self, url: str, faults: list[Fault], seed: int, clock: Callable[[], float]
    ) -> None:
        """Listen at the URL's port.

        Args:
            url: with the key.
            faults: of the network.
            seed: of the faults.
            clock: the emulation's time [s].

        Raises:
            DeviceError: the port is taken, or there is no key.
        """
        peer: Peer = peer_of("the emulation", url, ("key", "key_env"))
        self._key = key_of("the emulation", peer)
        self.counters = Counters()
        self._sockets = Sockets(peer.host, peer.port)
        self._clock = clock
        self._to_device, self._to_host = (
            PacketWire(faults, seed + direction) for direction in (0, 1)
        )
        self._host: tuple[str, int] | None = None
        self._wrote = 0.0
        self.restart()

    @property
    def master(self) -> int:
        """What becomes readable when a packet comes."""
        return self._sockets.number

    def restart(self) -> None:
        """Switched off and on: it knows the key alone."""
        self._seal = Seal(self._key, FAR_END, self.counters)

    def read(self) -> bytes:
        """Bytes of the line that have come."""
        now, data = self._clock(), b""
        for packet, sender in self._sockets.received():
            for passed in self._to_device.carry([packet], now):
                data += self._opened(passed, sender, now)
            for forged in self._to_device.forged(packet, now):
                data += self._opened(forged, sender, now)
        return data

    def _opened(self, packet: bytes, sender: tuple[str, int], arrival: float) -> bytes:
        data = self._seal.opened(packet, arrival)
        reply = self._seal.reply()
        if reply:
            self._sockets.send(reply, sender)
        if data:
            # only whoever has the key is answered
            self._host = sender
        return data

    def write(self, data: bytes) -> int:
        """Send; returns the number of bytes sent."""
        if self._host is None:
            return 0
        now = self._clock()
        passed = self._to_host.carry(self._seal.packets(data), now)
        passed = self._to_host.beaten(passed, now, self._wrote)
        self._wrote = now
        for packet in passed:
            self._sockets.send(packet, self._host)
            for forged in self._to_host.forged(packet, now):
                # from the device's address, which a stranger can forge
                self._sockets.send(forged, self._host)
                self._sockets.send(forged, self._host, forged=True)
        return len(data)

    def close(self) -> None:
        """Release the port."""
        self._sockets.close()


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
        self._host: tuple[str, int] | None = None if device.listens else (peer.host, peer.port)
        """Whom it answers, the last who spoke; None: nobody has yet."""
        self._stepped = 0.0
        self._sockets = Sockets(peer.host, peer.port if device.listens else 0)

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
            self._sockets.send(packet, self._host)
            for forged in self._to_host.forged(packet, now):
                self._sockets.send(forged, self._host, forged=True)
        return b"".join(out), b"".join(into)

    @property
    def watched(self) -> list[int]:
        return [self._sockets.number]

    def close(self) -> None:
        self._sockets.close()

    def _came(self) -> list[bytes]:
        packets: list[bytes] = []
        for packet, sender in self._sockets.received():
            if self._device.listens:
                self._host = sender
            packets.append(packet)
        return packets
