"""Bytes over UDP between two ends that share a key; whoever lacks it is not heard, nor answered.

A packet is a header, the bytes, and the first 16 bytes of the HMAC-SHA256 of both (RFC 2104, whose
section 5 allows half of it). The header names both ends' sessions, each a number that its end drew
anew, and counts packets. An end takes a packet only if it is made for the session that it has now,
by the session that it speaks with, and newer than the one before: so nothing of another day,
nothing twice, and nothing late or out of order. Nobody is kept from reading along.

| bytes | what |
|---|---|
| 2 | A7 01 |
| 1 | sender: `H` the host, `F` the far end; so no packet can be sent back |
| 8 | the sender's session |
| 8 | the receiver's session, as the sender knows it; zeros: not yet |
| 8 | number of the packet, big-endian |
| ... | bytes of the line, at most 1,200 |
| 16 | tag |
"""

import contextlib
import hmac
import os
import secrets
import stat
import struct
import time
from pathlib import Path

from twin.errors import DeviceError
from twin.plant.devices.counters import Counters
from twin.plant.devices.network import DatagramPort, Peer, peer_of

_HEADER = struct.Struct(">2sc8s8sQ")
_MAGIC = b"\xa7\x01"
_TAG = 16
LONGEST = 1200
"""Bytes of the line in a packet: with all headers below what any network passes whole [B]."""
_SHORTEST_KEY = 16
"""Bytes: as long as the tag."""
_LIVE = 1.0
"""Nobody else begins a session while its peer was heard within this [s]: a packet of another day
cannot disturb the session of today."""
_NOBODY = bytes(8)

HOST, FAR_END = b"H", b"F"


class Seal:
    """One end's state; no input or output."""

    def __init__(self, key: bytes, role: bytes, counters: Counters) -> None:
        """Begin a session; `role` is HOST or FAR_END."""
        self._key, self._role, self._counters = key, role, counters
        self._peer: bytes | None = None
        self._session = _NOBODY
        """With that peer."""
        self._offered = secrets.token_bytes(8)
        """To whoever wants to begin."""
        self._sent = self._heard = 0
        self._live = -_LIVE
        self._reply = b""

    @property
    def greeted(self) -> bool:
        """Both ends know each other."""
        return self._peer is not None

    def packets(self, data: bytes) -> list[bytes]:
        """Packets with these bytes; an offer instead, while the peer is not known."""
        if self._peer is None:
            return [self._packet(self._offered, _NOBODY, b"")]
        cuts = range(0, len(data), LONGEST)
        return [self._packet(self._session, self._peer, data[at : at + LONGEST]) for at in cuts]

    def opened(self, packet: bytes, arrival: float) -> bytes:
        """The bytes in a packet that came at `arrival` [s]; none where it is not to be believed."""
        if len(packet) < _HEADER.size + _TAG:
            self._counters.strangers += 1
            return b""
        magic, role, sender, receiver, number = _HEADER.unpack_from(packet)
        true = self._tag(packet[:-_TAG])
        genuine = hmac.compare_digest(true, packet[-_TAG:])
        if not genuine or magic != _MAGIC or role == self._role:
            self._counters.strangers += 1
            return b""
        if receiver == self._offered:
            self._peer, self._session = sender, self._offered
            self._offered = secrets.token_bytes(8)
        elif receiver != self._session or sender != self._peer:
            if self._peer is None or arrival - self._live > _LIVE:
                self._reply = self._packet(self._offered, sender, b"")
            else:
                self._counters.repeats += 1
            return b""
        elif number <= self._heard:
            self._counters.repeats += 1
            return b""
        self._heard, self._live = number, arrival
        return packet[_HEADER.size : -_TAG]

    def reply(self) -> bytes:
        """What is to be sent because of what was opened, no longer than that; often nothing."""
        reply, self._reply = self._reply, b""
        return reply

    def _packet(self, sender: bytes, receiver: bytes, data: bytes) -> bytes:
        self._sent += 1
        head = _HEADER.pack(_MAGIC, self._role, sender, receiver, self._sent) + data
        return head + self._tag(head)

    def _tag(self, data: bytes) -> bytes:
        return hmac.digest(self._key, data, "sha256")[:_TAG]


def key_of(device: str, peer: Peer) -> bytes:
    """The key that a URL names by its file (`key=board.key`) or variable (`key_env=TWIN_KEY`).

    Raises:
        DeviceError: it names none, or there is none, or others can read it.
    """
    remedy = "make one: umask 077; openssl rand -hex 32 > board.key; both ends have the same"
    file, variable = peer.options.get("key", ""), peer.options.get("key_env", "")
    if bool(file) == bool(variable):
        problem = "a line over UDP has a key: ?key=FILE or ?key_env=VARIABLE, one of them"
        raise DeviceError(device, problem, remedy)
    where = file or f"the environment's {variable}"
    try:
        mode = stat.S_IMODE(os.stat(file).st_mode) if file and os.name == "posix" else 0
        text = Path(file).read_text("ascii") if file else os.environ[variable]
        key = bytes.fromhex(text.strip())
    except KeyError:
        raise DeviceError(device, f"no key: {where} is not set", remedy) from None
    except OSError as error:
        raise DeviceError(device, f"no key in {where} ({error.strerror})", remedy) from error
    except ValueError:
        # the text is a secret: nothing of it stands in the message
        raise DeviceError(device, f"{where} is no hexadecimal number", remedy) from None
    if mode & 0o077:
        raise DeviceError(device, f"others can read the key in {file}", f"chmod 600 {file}")
    if len(key) < _SHORTEST_KEY:
        problem = f"the key in {where} has {len(key)} bytes, it needs {_SHORTEST_KEY}"
        raise DeviceError(device, problem, remedy)
    return key


class SealedLine:
    """The host's end of a line over UDP, in the place of a serial port."""

    def __init__(self, device: str, url: str, counters: Counters, timeout: float) -> None:
        """Open it; `read` waits up to `timeout` [s].

        Raises:
            DeviceError: no such peer, no key, or no network.
        """
        peer = peer_of(device, url, ("key", "key_env"))
        self._seal = Seal(key_of(device, peer), HOST, counters)
        self._port = DatagramPort(device, peer, counters, exact=True)
        self._timeout = timeout
        self._waiting = bytearray()

    @property
    def in_waiting(self) -> int:
        """Bytes that have come."""
        self._take(0.0)
        return len(self._waiting)

    def read(self, size: int) -> bytes:
        """At most so many bytes; waits for the first up to the timeout."""
        end = time.monotonic() + self._timeout
        while not self._waiting and (left := end - time.monotonic()) > 0.0:
            self._take(left)
        data = bytes(self._waiting[:size])
        del self._waiting[:size]
        return data

    def write(self, data: bytes) -> None:
        """Send, in packets."""
        for packet in self._seal.packets(data):
            self._port.send(packet)

    def close(self) -> None:
        """Release it."""
        with contextlib.suppress(DeviceError):
            self._port.close()

    def _take(self, timeout: float) -> None:
        for packet in self._port.receive(timeout):
            self._waiting += self._seal.opened(packet, time.monotonic())
            if reply := self._seal.reply():
                self._port.send(reply)
