"""Packets of a network: whose they may be, and from which address they come.

A port of a network is `udp://ADDRESS:PORT`, the computer that is spoken with. Only packets from
that address are taken; what others send is dropped and counted. UDP's addresses can be forged by
whoever is in the same network.
"""

import contextlib
import ipaddress
import select
import socket
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit

from twin.errors import DeviceError
from twin.plant.devices.counters import Counters

SCHEME = "udp"
_LARGEST = 65535
"""Bytes of a UDP packet."""
_AT_ONCE = 256
"""Packets that one call takes: a flood must not keep a session from its other work."""
_BUFFER = 1 << 20
"""Bytes that the system keeps for us [B]: a second of a camera system's largest frames."""


@dataclass(frozen=True)
class Peer:
    """The computer that is spoken with."""

    host: str
    port: int
    options: Mapping[str, str]
    """What stands behind the question mark; empty text where a name stands alone."""

    @property
    def local(self) -> bool:
        """It is this computer."""
        return ipaddress.ip_address(self.host).is_loopback


def is_network(url: str) -> bool:
    """Whether a port is one of packets."""
    return url.partition("://")[0].lower() == SCHEME and "://" in url


def peer_of(device: str, url: str, known: tuple[str, ...] = ()) -> Peer:
    """The peer that a URL names.

    Args:
        device: by the laboratory's name, for the sentences.
        url: `udp://ADDRESS:PORT?remote&...`.
        known: options that it may have beside `remote`.

    Raises:
        DeviceError: no such URL, or another computer without `remote`.
    """
    parts = urlsplit(url)
    try:
        host, port = parts.hostname or "", parts.port
        address = ipaddress.IPv4Address(host)
    except ValueError:
        host, port, address = "", None, None
    if parts.scheme != SCHEME or port is None or address is None or parts.path.strip("/"):
        remedy = "give udp://ADDRESS:PORT, the address as four numbers"
        raise DeviceError(device, f"cannot speak with {url}: no address and port", remedy)
    given = {key: each[-1] for key, each in parse_qs(parts.query, keep_blank_values=True).items()}
    for option in given:
        if option not in (*known, "remote"):
            may = ", ".join((*known, "remote"))
            raise DeviceError(device, f"{url} has the option {option!r}", f"it may have {may}")
    if address.is_multicast or address.is_unspecified:
        problem = f"{host} in {url} is no computer"
        raise DeviceError(device, problem, "give the address of the computer that sends")
    if not address.is_loopback and "remote" not in given:
        raise DeviceError(
            device,
            f"{host} in {url} is another computer",
            "add ?remote to speak with it over the network (docs/hardware.md)",
        )
    return Peer(host, port, given)


class DatagramPort:
    """Packets to and from one computer. Reading belongs to one thread; so does writing."""

    def __init__(
        self,
        device: str,
        peer: Peer,
        counters: Counters,
        *,
        listen: int = 0,
        group: tuple[str, int] | None = None,
        exact: bool = False,
    ) -> None:
        """Open it.

        Args:
            device: by the laboratory's name, for the sentences.
            peer: that is spoken with.
            counters: which count what strangers send.
            listen: the port of this computer at which packets come; 0: any.
            group: address and port of a multicast that the peer sends to, which is joined too.
            exact: the peer sends from its port, and from no other.

        Raises:
            DeviceError: the port is taken, or there is no such network.
        """
        self.device, self.peer = device, peer
        self._counters, self._exact = counters, exact
        self._sockets: list[socket.socket] = []
        # bound to this computer alone, nobody else can send at all
        here = "127.0.0.1" if peer.local else ""
        try:
            self._sockets.append(_bound(here, listen))
            if group is not None:
                self._sockets.append(_joined(group, here))
        except OSError as error:
            self.close()
            where = group or (here or "any address", listen)
            raise DeviceError(
                device,
                f"cannot listen at {where[0]}, port {where[1]} ({error.strerror or error})",
                "close the other program that listens there, or look at the network",
            ) from error

    @property
    def here(self) -> int:
        """The port of this computer."""
        return self._sockets[0].getsockname()[1]

    def receive(self, timeout: float) -> list[bytes]:
        """Packets that have come from the peer; waits for the first up to `timeout` [s].

        Raises:
            DeviceError: the network is gone.
        """
        end = time.monotonic() + timeout
        packets: list[bytes] = []
        while not packets:
            left = end - time.monotonic()
            try:
                ready = select.select(self._sockets, [], [], max(left, 0.0))[0]
                for each in ready:
                    packets += self._taken(each)
            except (OSError, ValueError) as error:
                raise self._lost(error) from error
            if left <= 0.0:
                break
        return packets

    def send(self, packet: bytes) -> None:
        """Send to the peer; a packet for which there is no room is lost, as on its way.

        Raises:
            DeviceError: the network is gone.
        """
        try:
            with contextlib.suppress(BlockingIOError, ConnectionError):
                self._sockets[0].sendto(packet, (self.peer.host, self.peer.port))
        except OSError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Release it; raises nothing."""
        for each in self._sockets:
            each.close()

    def _taken(self, source: socket.socket) -> list[bytes]:
        packets: list[bytes] = []
        for _ in range(_AT_ONCE):
            try:
                packet, sender = source.recvfrom(_LARGEST)
            except BlockingIOError:
                break
            except ConnectionError:
                # the peer's computer says that nobody listens there yet
                continue
            if sender[0] != self.peer.host or (self._exact and sender[1] != self.peer.port):
                self._counters.strangers += 1
            else:
                packets.append(packet)
        return packets

    def _lost(self, error: Exception) -> DeviceError:
        problem = f"lost udp://{self.peer.host}:{self.peer.port} ({error})"
        return DeviceError(self.device, problem, "look at the network, then connect anew")


def _bound(host: str, port: int) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        with contextlib.suppress(OSError):
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        made.bind((host, port))
    except BaseException:
        made.close()
        raise
    return made


def _joined(group: tuple[str, int], here: str) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        made.setblocking(False)
        # several programs of one computer may follow the same cameras
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with contextlib.suppress(OSError):
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        # Windows and macOS bind to no group; what others send is refused by its address
        made.bind((group[0] if sys.platform == "linux" else "", group[1]))
        membership = socket.inet_aton(group[0]) + socket.inet_aton(here or "0.0.0.0")
        made.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    except BaseException:
        made.close()
        raise
    return made
