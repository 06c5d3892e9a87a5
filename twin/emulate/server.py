"""One emulated device's end of its line: terminal, bytes on their way, and what is wrong with it.

A pty passes any number of bytes at once and asks nobody for the baud rate. So this end does both:
each byte takes its start, eight data and stop bits, and a host that has set another rate than the
device's gets garbage. A symbolic link names the port, and is pointed to the new one on a replug.
"""

import os
import termios
import time
import tty
from dataclasses import replace
from pathlib import Path

from twin.emulate.emulated import EmulatedDevice
from twin.emulate.faults import BURST, LINE_FAULTS, Fault, Wire
from twin.emulate.pacing import PacedQueue

BEAT = 0.001
"""Longest that the process sleeps [s]: devices send of themselves."""

_PATIENCE = 1.0
"""Longest wait in lockstep for bytes that were written [s]: an unplugged line loses them."""

_RATES = {
    getattr(termios, name): int(name[1:])
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdigit()
}
"""Code of the terminal driver -> baud."""


class _Terminal:
    """Both ends of a pseudo-terminal; ours keeps the other open, else a host's leaving ends it."""

    def __init__(self, link: Path) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        aside = link.with_name(f"{link.name}.{os.getpid()}")
        aside.symlink_to(os.ttyname(self._slave))
        aside.replace(link)
        self._link = link

    def baud(self) -> int:
        """What the host has set."""
        return _RATES.get(termios.tcgetattr(self._slave)[5], 0)

    def read(self) -> bytes:
        try:
            return os.read(self.master, 4096)
        except OSError:
            return b""

    def write(self, data: bytes) -> int:
        """Send; how many went. What a host does not fetch is lost, as in a full receive buffer."""
        try:
            return os.write(self.master, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        self._link.unlink(missing_ok=True)
        os.close(self.master)
        os.close(self._slave)


class Server:
    """The loop's state of one line; time runs from `start`, or in lockstep from 0."""

    def __init__(
        self,
        device: EmulatedDevice,
        link: Path,
        faults: tuple[Fault, ...],
        seed: int,
        *,
        start: float,
        lockstep: bool = False,
    ) -> None:
        """Open the terminal; `start` [s] is the monotonic clock at the emulation's time 0."""
        self._device, self._link = device, link
        self._granted = 0.0 if lockstep else None
        self._early = b""
        self._heard = self._said = 0
        self._start = start
        own = [fault for fault in faults if fault.kind not in LINE_FAULTS]
        self._wire = Wire([fault for fault in faults if fault.kind in LINE_FAULTS], seed)
        self._pending = sorted(
            own + [f for f in self._wire.faults if f.kind == "power_cycle"], key=lambda f: f.start
        )
        self._to_device, self._to_host = PacedQueue(), PacedQueue()
        self._terminal: _Terminal | None = _Terminal(link)

    def add(self, fault: Fault) -> None:
        """Let it happen, counted from now."""
        fault = replace(fault, start=self._now() + fault.start)
        if fault.kind in LINE_FAULTS:
            self._wire.faults.append(fault)
        if fault.kind not in LINE_FAULTS or fault.kind == "power_cycle":
            self._pending.append(fault)
            self._pending.sort(key=lambda each: each.start)

    def go_on(self, until: float, sent: int) -> tuple[float, int]:
        """In lockstep: hear what was sent, then let time pass until it says something."""
        patience = time.monotonic() + _PATIENCE
        while self._heard + len(self._early) < sent and time.monotonic() < patience:
            self._early += b"" if self._terminal is None else self._terminal.read()
        self._granted, said = self._now(), self._said
        while self._granted < until - 1e-9 and self._said == said:
            self._granted = min(self._granted + BEAT, until)
            self.step()
        return self._granted, self._said

    def step(self) -> tuple[bytes, bytes]:
        """Bytes that went out to the host, and those that came in to the device."""
        now = self._now()
        self._happen(now)
        if self._terminal is None:
            self._device.advance(now)
            return b"", b""
        byte_time = (1 + 8 + self._device.stop_bits) / self._device.baud
        came, self._early = self._early + self._terminal.read(), b""
        self._heard += len(came)
        self._to_device.send(came, now, byte_time)
        matched = self._terminal.baud() == self._device.baud
        into = self._wire.carry(self._to_device.arrived(now), now, matched=matched)
        sent = self._device.receive(into, now) if into else b""
        self._to_host.send(sent + self._device.advance(now), now, byte_time)
        burst = self._wire.active("burst", now)
        arrived = self._to_host.arrived(now // BURST * BURST if burst else now)
        out = self._wire.carry(arrived, now, matched=matched)
        if out:
            self._said += self._terminal.write(out)
        return out, into

    @property
    def watched(self) -> list[int]:
        """What becomes readable when the host says something; empty while it is unplugged."""
        return [] if self._terminal is None else [self._terminal.master]

    def _now(self) -> float:
        return time.monotonic() - self._start if self._granted is None else self._granted

    def _happen(self, now: float) -> None:
        while self._pending and self._pending[0].start <= now:
            fault = self._pending.pop(0)
            if fault.kind == "power_cycle":
                self._device.power_cycle(now)
            else:
                self._device.inject(fault.kind, fault.value)
        unplugged = self._wire.active("unplug", now) is not None
        if unplugged and self._terminal is not None:
            self._terminal.close()
            self._terminal = None
            self._to_device.clear()
            self._to_host.clear()
        elif not unplugged and self._terminal is None:
            self._terminal = _Terminal(self._link)
