"""Emulated devices on pseudo-terminals, in a process of their own, at their lines' true rates.

One emulated device's end of its line: terminal, bytes on their way, and what is wrong with it.
A pty passes any number of bytes at once and asks nobody for the baud rate. So this end does both:
each byte takes its start, eight data and stop bits, and a host that has set another rate than the
device's gets garbage. A symbolic link names the port, and is pointed to the new one on a replug.
"""

import contextlib
import math
import multiprocessing
import os
import select
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Self

from twin.emulate.emulated import (
    BURST,
    LINE_FAULTS,
    NETWORK_FAULTS,
    Emulated,
    EmulatedDevice,
    EmulatedPeer,
    Fault,
    Wire,
)
from twin.emulate.packets import PacketServer, SealedEnd
from twin.emulate.served import Served
from twin.errors import DeviceError, TwinError, UsageError
from twin.processes import beginning
from twin.stop import LOOK, ignore, until

if sys.platform != "win32":
    import termios
    import tty


class PacedQueue:
    """Bytes on their way, each due one byte time after the one before."""

    def __init__(self) -> None:
        self._due = deque[tuple[float, int]]()
        self._free = 0.0

    def send(self, data: bytes, instant: float, byte_time: float) -> None:
        """Begin to send at `instant`, or when the bytes before are through [s]."""
        time = max(self._free, instant)
        for byte in data:
            time += byte_time
            self._due.append((time, byte))
        self._free = time

    def arrived(self, instant: float) -> bytes:
        """Bytes that are through by `instant`."""
        out = bytearray()
        while self._due and self._due[0][0] <= instant:
            out.append(self._due.popleft()[1])
        return bytes(out)

    def clear(self) -> None:
        """The cable is out: what was on its way is lost."""
        self._due.clear()
        self._free = 0.0


BEAT = 0.001
"""Longest that the process sleeps [s]: devices send of themselves."""

Link = Path | str
"""A symbolic link to a terminal, or the URL of a port of a network."""

_STALL = 0.02
"""When the process was not run for longer, all that waits is taken to have come evenly meanwhile
[s]: a board would have heard each set-point as it came, and let none run out."""

_PATIENCE = 1.0
"""Longest wait in lockstep for bytes that were written [s]: an unplugged line loses them."""


class _Terminal:
    """Both ends of a pseudo-terminal; ours keeps the other open, else a host's leaving ends it."""

    def __init__(self, link: Path) -> None:
        self.master, self._slave = os.openpty()
        self._rates = {
            getattr(termios, name): int(name[1:])
            for name in dir(termios)
            if name[0] == "B" and name[1:].isdigit()
        }
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        aside = link.with_name(f"{link.name}.{os.getpid()}")
        aside.symlink_to(os.ttyname(self._slave))
        aside.replace(link)
        self._link = link

    def baud(self) -> int:
        """What the host has set; 0 of a rate that the terminal driver has no name for."""
        return self._rates.get(termios.tcgetattr(self._slave)[5], 0)

    def read(self) -> bytes:
        try:
            return os.read(self.master, 4096)
        except OSError:
            return b""

    def write(self, data: bytes) -> int:
        """Send; returns the number of bytes sent. The rest is lost, as in a full receive buffer."""
        try:
            return os.write(self.master, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        self._link.unlink(missing_ok=True)
        os.close(self.master)
        os.close(self._slave)


class Server(Served):
    """A device on a line."""

    def __init__(
        self,
        device: EmulatedDevice,
        link: Link,
        faults: tuple[Fault, ...],
        seed: int,
        *,
        start: float,
        lockstep: bool = False,
    ) -> None:
        """Open the terminal, or the port of a network.

        Args:
            device: whose end it is.
            link: names the port.
            faults: that begin of themselves.
            seed: of the faults.
            start: the monotonic clock at the emulation's time 0 [s].
            lockstep: time goes on as the host lets it.

        Raises:
            DeviceError: a port of a network that is taken, or has no key.
        """
        known = LINE_FAULTS if isinstance(link, Path) else NETWORK_FAULTS
        super().__init__(device, faults, known, start=start, lockstep=lockstep)
        self._device, self._link = device, link
        self._early = b""
        self._heard = self._said = 0
        self._wire = Wire(self._of_wire if isinstance(link, Path) else [], seed)
        self._seed = seed
        self._to_device, self._to_host = PacedQueue(), PacedQueue()
        self._terminal: _Terminal | SealedEnd | None = self._opened()
        self._stepped: float | None = None

    def go_on(self, until: float, sent: int) -> tuple[float, int]:
        """In lockstep: hear what was sent, then let time pass until it says something."""
        patience = time.monotonic() + _PATIENCE
        while self._heard + len(self._early) < sent and time.monotonic() < patience:
            self._early += b"" if self._terminal is None else self._terminal.read()
        self._granted, said = self._time(), self._said
        while self._granted < until - 1e-9 and self._said == said:
            self._granted = min(self._granted + BEAT, until)
            self.step()
        return self._granted, self._said

    def step(self) -> tuple[bytes, bytes]:
        now = self._time()
        before = now if self._stepped is None or self._granted is not None else self._stepped
        self._stepped = now
        self.stalled = max(self.stalled, now - before)
        came, self._early = self._early, b""
        if self._terminal is not None:
            came += self._terminal.read()
        beats = math.ceil((now - before) / BEAT) if now - before > _STALL else 1
        said, heard = b"", b""
        for beat in range(1, beats + 1):
            part = came[len(came) * (beat - 1) // beats : len(came) * beat // beats]
            out, into = self._beat(part, before + (now - before) * beat / beats)
            said, heard = said + out, heard + into
        return said, heard

    def _beat(self, came: bytes, instant: float) -> tuple[bytes, bytes]:
        """As `step`, with what came in, at one time."""
        self._happen(instant)
        if self._terminal is None:
            self._device.advance(instant)
            return b"", b""
        byte_time = (1 + 8 + self._device.stop_bits) / self._device.baud
        self._heard += len(came)
        self._to_device.send(came, instant, byte_time)
        # a network has no rate
        matched = (
            isinstance(self._terminal, SealedEnd) or self._terminal.baud() == self._device.baud
        )
        into = self._wire.carry(self._to_device.arrived(instant), instant, matched=matched)
        sent = self._device.receive(into, instant) if into else b""
        self._to_host.send(sent + self._device.advance(instant), instant, byte_time)
        burst = self._wire.active("burst", instant)
        arrived = self._to_host.arrived(instant // BURST * BURST if burst else instant)
        out = self._wire.carry(arrived, instant, matched=matched)
        if out:
            self._said += self._terminal.write(out)
        return out, into

    @property
    def watched(self) -> list[int]:
        return [] if self._terminal is None else [self._terminal.master]

    def close(self) -> None:
        if self._terminal is not None:
            self._terminal.close()
            self._terminal = None

    def _happen(self, instant: float) -> None:
        super()._happen(instant)
        unplugged = self._wire.active("unplug", instant) is not None
        if unplugged and self._terminal is not None:
            self.close()
            self._to_device.clear()
            self._to_host.clear()
        elif not unplugged and self._terminal is None:
            self._terminal = self._opened()

    def _power_cycle(self, instant: float) -> None:
        super()._power_cycle(instant)
        if isinstance(self._terminal, SealedEnd):
            self._terminal.restart()

    def _opened(self) -> _Terminal | SealedEnd:
        if isinstance(self._link, Path):
            return _Terminal(self._link)
        return SealedEnd(self._link, self._of_wire, self._seed, self._time)


_START = 60.0
"""Longest wait for the process [s]: it may have a machine to compile."""

MadeDevices = Callable[[], Mapping[str, Emulated]]


class EmulatedLines:
    """Starts the process on entry, ends it on exit; faults are scheduled or injected."""

    def __init__(
        self,
        devices: MadeDevices,
        links: Mapping[str, Link],
        faults: Sequence[Fault] = (),
        *,
        seed: int = 0,
        log: Path | None = None,
        lockstep: bool = False,
    ) -> None:
        """Nothing is started yet.

        Args:
            devices: makes them by their names, in the process where they will live; what they
                share, they share there.
            links: will name their ports, or are the URLs of a network's; the first name's is
                the device of faults without one.
            faults: counted from the start.
            seed: of the faults.
            log: takes the raw bytes of all directions.
            lockstep: time passes by `go_on` only (`twin.bench`); for a single device.

        Raises:
            UsageError: this system has no pseudo-terminals.
        """
        if sys.platform == "win32":
            raise UsageError(
                "Windows has no pseudo-terminals for emulated devices; fly the simulated machine "
                "(--plant sim), or emulate on Linux or macOS"
            )
        self.links = dict(links)
        self.stalled = 0.0
        """The longest time for which its process was not run [s]; known when it has ended."""
        # A fork would copy the threads' locks of whoever starts this.
        context = multiprocessing.get_context("forkserver")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve,
            args=(devices, self.links, tuple(faults), seed, log, theirs, lockstep),
            daemon=True,
        )

    def __enter__(self) -> Self:
        """Start it, and wait until its ports are there.

        Raises:
            TwinError: what its devices refuse, as they would in this process.
            DeviceError: it ended at once, or took too long.
            Stopped: a stop was requested meanwhile.
        """
        with beginning():
            self._process.start()
        said = self._missing_ports(f"did not start within {_START:g} s")
        try:
            ready = until(lambda: self._pipe.poll(min(LOOK, _START)), _START)
        except BaseException:
            self.kill()
            raise
        if ready:
            try:
                said = self._pipe.recv()
            except EOFError:
                said = self._missing_ports("ended before its ports were there")
        if isinstance(said, TwinError):
            self.kill()
            raise said
        return self

    def __exit__(self, *error: object) -> None:
        if self._process.is_alive():
            self._pipe.send(None)
            with contextlib.suppress(EOFError, OSError):
                if self._pipe.poll(5.0):
                    last = self._pipe.recv()
                    self.stalled = last if isinstance(last, float) else 0.0
            self._process.join(5.0)
        if self._process.is_alive():
            self._process.kill()

    def _missing_ports(self, problem: str) -> DeviceError:
        names = ", ".join(map(str, self.links.values()))
        remedy = "what it printed says why; else look whether this computer is busy"
        return DeviceError(f"the emulation at {names}", problem, remedy)

    @property
    def alive(self) -> bool:
        """Its process runs."""
        return self._process.is_alive()

    def inject(self, fault: Fault) -> None:
        """Begin a fault; its start counts from now."""
        self._pipe.send(fault)

    def go_on(self, until: float, sent: int) -> tuple[float, int] | None:
        """Let time pass in lockstep, at most until it says something.

        Args:
            until: the emulation's time [s].
            sent: bytes that the host has written so far; they are waited for.

        Returns:
            Its time [s], and how many bytes it has said so far; None: it is gone.
        """
        try:
            self._pipe.send((until, sent))
            while not self._pipe.poll(0.5):
                if not self.alive:
                    return None
            return self._pipe.recv()
        except (EOFError, OSError):
            return None

    def kill(self) -> None:
        """End the process at once, as a crash does."""
        self._process.kill()
        self._process.join(5.0)


class EmulatedLine(EmulatedLines):
    """One device on its line."""

    def __init__(
        self,
        device: EmulatedDevice | Callable[[], EmulatedDevice],
        link: Link,
        faults: Sequence[Fault] = (),
        *,
        seed: int = 0,
        log: Path | None = None,
        lockstep: bool = False,
    ) -> None:
        """`link` will name the port; `log` takes the raw bytes of both directions.

        A `device` that cannot travel to another process is made there: give what makes it.
        """
        self.link = link
        made = _Alone(device)
        super().__init__(made, {"": link}, faults, seed=seed, log=log, lockstep=lockstep)


class _Alone:
    """Makes a single device, without a name."""

    def __init__(self, device: EmulatedDevice | Callable[[], EmulatedDevice]) -> None:
        self._device = device

    def __call__(self) -> dict[str, EmulatedDevice]:
        device = self._device
        return {"": device if isinstance(device, EmulatedDevice) else device()}


def _serve(
    devices: MadeDevices,
    links: Mapping[str, Link],
    faults: tuple[Fault, ...],
    seed: int,
    log: Path | None,
    pipe: Connection,
    lockstep: bool,
) -> None:
    """Run the devices until a stop is requested or the parent process has ended."""
    # A request to stop is meant for the loop, which still has to bring the devices to rest.
    ignore()
    first = next(iter(links))
    try:
        made = devices()
    except TwinError as mistake:
        pipe.send(mistake)
        return
    start = time.monotonic()
    servers: dict[str, Served] = {}
    try:
        for name, link in links.items():
            of_device = tuple(fault for fault in faults if (fault.device or first) == name)
            device, lone = made[name], (of_device, seed)
            match device:
                case EmulatedDevice():
                    servers[name] = Server(device, link, *lone, start=start, lockstep=lockstep)
                case EmulatedPeer():
                    servers[name] = PacketServer(device, str(link), *lone, start=start)
                case _:
                    raise AssertionError(type(device))
    except TwinError as mistake:
        pipe.send(mistake)
        return
    pipe.send("ready")
    with open(log, "wb", buffering=0) if log else open(os.devnull, "wb") as record:
        while True:
            try:
                while pipe.poll():
                    order = pipe.recv()
                    if order is None:
                        pipe.send(max(server.stalled for server in servers.values()))
                        return
                    if isinstance(order, Fault):
                        servers[order.device or first].add(order)
                    else:
                        server = servers[first]
                        assert isinstance(server, Server)
                        pipe.send(server.go_on(*order))
            except (EOFError, OSError):
                return
            if lockstep:
                pipe.poll(None)
                continue
            watched: list[int | Connection] = [pipe]
            for name, server in servers.items():
                sent, into = server.step()
                for mark, data in (("<", into), (">", sent)):
                    if data:
                        record.write(f"{name}{mark}{data.hex()}\n".encode())
                watched += server.watched
            # until a host or the owner says something, or the next beat
            select.select(watched, [], [], BEAT)
