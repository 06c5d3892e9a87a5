"""A serial port, or its like on the network, as the sessions use it.

Opens by path or pyserial URL, asks for low latency where the adapter has it, and turns what goes
wrong (no such port, no permission, unplugged) into one sentence.
"""

import contextlib
import errno
import os
import time
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

import serial

from twin.errors import DeviceError
from twin.plant.devices.counters import Counters
from twin.plant.devices.network import SCHEME
from twin.plant.devices.sealed import SealedLine

SLICE = 0.02
"""Longest that one read of the port blocks [s]: so fast does a session hear that it shall end."""

_REMEDIES = {
    errno.ENOENT: "check the cable and the path",
    errno.EACCES: "ask for membership of the group that owns the port (often `dialout`)",
    errno.EBUSY: "close the other program that has it open",
}


_SCHEMES = {
    "": True,
    "spy": True,
    "alt": True,
    "hwgrep": True,
    "socket": False,
    "rfc2217": False,
    "cp2110": False,
    "loop": False,
    SCHEME: False,
}
"""Kinds of URLs, pyserial's and ours, and whether they are a port of this computer: then nobody
else may have it open."""

LOG = ".spy"
"""What the name of a line's log ends in."""


def _logged(device: str, url: str) -> tuple[str, Path | None]:
    """A spy's URL with a log that no file stood at before, and that log.

    A platform that somebody shared may name any file, and pyserial would empty it.

    Raises:
        DeviceError: the log is no `.spy` file, or cannot be created.
    """
    options = parse_qs(urlsplit(url).query, keep_blank_values=True)
    if "file" not in options:
        return url, None
    wanted = Path(options["file"][0])
    if wanted.suffix != LOG:
        raise DeviceError(
            device, f"cannot log into {wanted}", f"give a name that ends in {LOG}, as in imu{LOG}"
        )
    for number in count(1):
        path = wanted if number == 1 else wanted.with_stem(f"{wanted.stem}-{number}")
        try:
            # new, and no link: an older log is kept
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
        except FileExistsError:
            continue
        except OSError as error:
            problem = f"cannot log into {path} ({os.strerror(error.errno or 0)})"
            raise DeviceError(device, problem, "name another place") from error
        options["file"] = [str(path)]
        return f"{url.partition('?')[0]}?{urlencode(options, doseq=True)}", path
    raise AssertionError


class Port:
    """One open line to a device. Reading belongs to one thread; so does writing."""

    def __init__(
        self,
        device: str,
        url: str,
        *,
        baud: int,
        stop_bits: int = 1,
        counters: Counters | None = None,
    ) -> None:
        """Open it, and throw away what had arrived before.

        Args:
            device: by the laboratory's name, for the sentences.
            url: path or URL.
            baud: of the line.
            stop_bits: of the line.
            counters: which count what strangers send, where the line is a network.

        Raises:
            DeviceError: there is no such port, or it cannot be had.
        """
        self.device = device
        self.url = url
        self.byte_time = (1 + 8 + stop_bits) / baud
        """Of one byte on the line [s]."""
        scheme = url.partition("://")[0].lower() if "://" in url else ""
        if scheme not in _SCHEMES:
            known = ", ".join(f"{name}://" for name in _SCHEMES if name)
            raise DeviceError(
                device, f"cannot open {url}: no such kind of port", f"give a path, or {known}"
            )
        self.sent = 0
        """Bytes written."""
        self.dealt_with = 0
        """Bytes read that whoever reads has dealt with; counted there."""
        self.unread = False
        """Nobody reads it any more: it is gone, or its session has failed."""
        self.low_latency = False
        """The adapter passes bytes on at once, instead of up to 16 ms later."""
        if scheme == SCHEME:
            self._serial: Any = SealedLine(device, url, counters or Counters(), SLICE)
            return
        opened, log = _logged(device, url) if scheme == "spy" else (url, None)
        try:
            self._serial = serial.serial_for_url(
                opened,
                baudrate=baud,
                stopbits=stop_bits,
                timeout=SLICE,
                write_timeout=1.0,
                exclusive=True if _SCHEMES[scheme] else None,
            )
        except (OSError, ValueError) as error:
            if log is not None:
                log.unlink(missing_ok=True)
            code = error.errno if isinstance(error, OSError) else None
            # pyserial says of a port that another program holds: EAGAIN, from flock
            code = errno.EBUSY if code in (errno.EAGAIN, errno.EWOULDBLOCK) else code
            remedy = _REMEDIES.get(code or 0, "check the path or URL, and the baud rate")
            raise DeviceError(device, f"cannot open {url} ({_why(error)})", remedy) from error
        # pseudo-terminals refuse with ValueError, network ports do not know the method
        with contextlib.suppress(AttributeError, ValueError, NotImplementedError, OSError):
            self._serial.set_low_latency_mode(True)
            self.low_latency = True

    def read(self, timeout: float) -> bytes:
        """All that has arrived; waits for the first byte up to `timeout` [s], then gives nothing.

        Raises:
            DeviceError: the port is gone.
        """
        deadline = time.monotonic() + timeout
        try:
            while True:
                data = self._serial.read(1)
                if data:
                    waiting = self._serial.in_waiting
                    return data + self._serial.read(waiting) if waiting else data
                if time.monotonic() >= deadline:
                    return b""
        # closing a port in the middle of a read gives TypeError; unplugging, either of OSError
        # and its child SerialException
        except (OSError, TypeError) as error:
            raise self._lost(error) from error

    def waiting(self) -> bytes:
        """What has arrived, without waiting for more.

        Raises:
            DeviceError: the port is gone.
        """
        try:
            waiting = self._serial.in_waiting
            return self._serial.read(waiting) if waiting else b""
        except (OSError, TypeError) as error:
            raise self._lost(error) from error

    def write(self, data: bytes) -> None:
        """Send.

        Raises:
            DeviceError: the port is gone, or takes nothing for a second.
        """
        try:
            self._serial.write(data)
            self.sent += len(data)
        except (OSError, TypeError) as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Release it; raises nothing."""
        self.unread = True
        with contextlib.suppress(OSError, TypeError):
            self._serial.close()

    def _lost(self, error: Exception) -> DeviceError:
        self.unread = True
        problem = f"lost {self.url} ({_why(error)})"
        return DeviceError(self.device, problem, "plug it in again, then connect anew")


def _why(error: Exception) -> str:
    """The core of an error text of pyserial, which repeats the port and its own name."""
    if isinstance(error, OSError) and error.errno is not None:
        return os.strerror(error.errno)
    text = str(error).splitlines()[0].rstrip(".")
    # this is how pyserial sees an unplugged adapter
    return "unplugged" if "returned no data" in text else text
