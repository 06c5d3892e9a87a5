"""Host and emulation in step: time stands until both have nothing left to do, then goes on.

How it is kept honest: every byte still goes through the pseudo-terminal and its session, at the
line's rate in emulated time. The host counts the bytes that it has written and lets time go on; the
emulation waits until that many have reached it, advances by beats of a millisecond until it has
said something or the time is over, and tells its time and how many bytes it has said in all; the
host waits until its reader has dealt with that many. So nothing is lost or comes late because a
computer is slow, and time-to-live, ages and clock fits are those of emulated time. What it does
not show is what a slow computer does: the loop's own work takes no time here.
"""

import time

from twin.emulate.line import EmulatedLines
from twin.plant.devices.host_time import HostTime
from twin.plant.devices.port import Port

_PATIENCE = 5.0
"""Longest wait of the wall's clock for bytes that are on their way [s]; then they are lost."""

_LOOK = 5e-5
"""Between two looks [s]."""

_BEGIN = 1000.0
"""Host's time at the emulation's time 0 [s]: the two are not to be mistaken for one another."""


class LockstepTime(HostTime):
    """The emulation's time, and what lets it go on."""

    wall = False

    def __init__(self, line: EmulatedLines) -> None:
        """Of a line that was started in lockstep."""
        self._line = line
        self._now = 0.0
        self._port: Port | None = None
        self._said = self._before = 0

    def now(self) -> float:
        return _BEGIN + self._now

    def sleep(self, seconds: float) -> None:
        end = self._now + seconds
        while self._now < end - 1e-9:
            self._go_on(end)
            if self._port is not None:
                self._wait_until_dealt_with(self._port)

    def read(self, port: Port, timeout: float) -> bytes:
        end, came = self._now + timeout, b""
        while self._now < end - 1e-9 and not came:
            before = self._said
            self._go_on(end, port.sent)
            until = time.monotonic() + _PATIENCE
            while len(came) < self._said - before and time.monotonic() < until:
                came += port.waiting()
        port.dealt_with += len(came)
        return came

    def watch(self, port: Port) -> None:
        # bytes said before this port was opened never count as its own
        self._port, self._before = port, self._said - port.dealt_with

    def _go_on(self, end: float, sent: int | None = None) -> None:
        if sent is None:
            sent = 0 if self._port is None else self._port.sent
        answer = self._line.go_on(end, sent)
        if answer is None:
            # nobody is there any more; time goes on, and the session has to notice
            self._now = end
            time.sleep(0.02)
        else:
            self._now, self._said = answer

    def _wait_until_dealt_with(self, port: Port) -> None:
        until = time.monotonic() + _PATIENCE
        while port.dealt_with < self._said - self._before and not port.unread:
            if time.monotonic() > until:
                self._before = self._said - port.dealt_with
                return
            time.sleep(_LOOK)
