"""The host's clock, as a session and the hardware plant see it: the wall's, unless one is given."""

import abc
import time

from twin.plant.devices.port import Port


class HostTime(abc.ABC):
    """What time it is, and how one waits."""

    wall: bool
    """It goes on by itself."""

    @abc.abstractmethod
    def now(self) -> float:
        """Monotonic [s]."""

    @abc.abstractmethod
    def sleep(self, seconds: float) -> None:
        """Let time pass [s]."""

    @abc.abstractmethod
    def read(self, port: Port, timeout: float) -> bytes:
        """What arrives within `timeout` [s] where no thread reads; the first of it is enough."""

    @abc.abstractmethod
    def watch(self, port: Port) -> None:
        """A thread reads this port from now on."""


class WallTime(HostTime):
    """`time.monotonic`."""

    wall = True

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(max(seconds, 0.0))

    def read(self, port: Port, timeout: float) -> bytes:
        return port.read(timeout)

    def watch(self, port: Port) -> None:
        del port


WALL = WallTime()
