"""A body that swings, as emulated devices see it, and their ends of a network in a thread."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from twin.emulate.emulated import EmulatedPeer, Fault
from twin.emulate.machine import DeviceValue
from twin.emulate.packets import PacketServer
from twin.rotation import from_rotation_vector

PERIOD = 0.01


def attitude_at(time: float) -> np.ndarray:
    """(4,) world from body; it turns about a slanted axis, never twice the same."""
    return from_rotation_vector(np.array([0.3, -0.5, 0.8]) * np.sin(0.9 * time) + 0.01 * time)


def place_at(time: float) -> np.ndarray:
    """(3,) [m]."""
    return np.array([0.4 * np.sin(time), 0.2 * time, 0.9])


def rate_at(time: float) -> np.ndarray:
    """(3,) [rad/s]; only numbers."""
    return np.array([0.1 * np.sin(time), 0.2, 0.01 * time])


class Swing:
    """In the place of a machine's share: values every 10 ms."""

    def __init__(self, *sources: str) -> None:
        self._sources = sources or ("attitude", "position")
        self._next = 0

    def step(self, commands: object, time: float) -> list[DeviceValue]:
        """All that is due by then."""
        shown: list[DeviceValue] = []
        values = {"attitude": attitude_at, "position": place_at, "gyro": rate_at}
        while self._next * PERIOD <= time:
            at = self._next * PERIOD
            shown += [DeviceValue(name, at, values[name](at)) for name in self._sources]
            self._next += 1
        return shown


@contextmanager
def served(device: EmulatedPeer, url: str, *faults: Fault, seed: int = 0) -> Iterator[PacketServer]:
    """A device at its port until the block ends."""
    server = PacketServer(device, url, faults, seed, start=time.monotonic())
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(0.001):
            server.step()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        ended.set()
        thread.join()
        server.close()
