"""What an emulated device is: bytes in, bytes out, and the time told to it.

An emulation is written from a device's documents, never from the driver's code, so that the two
check each other. It knows nothing of ports, threads or the real clock.
"""

import abc


class EmulatedDevice(abc.ABC):
    """One device, or several on one line."""

    baud: int
    """At which it talks and listens now."""
    stop_bits: int = 1

    @abc.abstractmethod
    def receive(self, data: bytes, now: float) -> bytes:
        """Bytes have come in at `now` [s]; what it sends at once."""

    @abc.abstractmethod
    def advance(self, now: float) -> bytes:
        """Time has come to `now` [s]; what it has sent since the last call."""

    @abc.abstractmethod
    def power_cycle(self, now: float) -> None:
        """Switched off and on again: all is forgotten but what it keeps without power."""

    @abc.abstractmethod
    def inject(self, fault: str, value: float = 0.0) -> None:
        """Begin to fail in a way of its own.

        Raises:
            UnknownName: it cannot fail so.
        """
