"""What the ends of all connections of emulated devices have in common: time and faults."""

import abc
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from twin.emulate.emulated import Emulated, Fault


class Served(abc.ABC):
    """One device's end of its connection; time runs from `start`, or in lockstep from 0."""

    def __init__(
        self,
        device: Emulated,
        faults: Sequence[Fault],
        known: Mapping[str, str],
        *,
        start: float,
        lockstep: bool = False,
    ) -> None:
        """Take its faults.

        Args:
            device: whose end it is.
            faults: that begin of themselves.
            known: kinds of faults of the connection; the others are of the device.
            start: the monotonic clock at the emulation's time 0 [s].
            lockstep: time goes on as the host lets it.
        """
        self._failing, self._known = device, known
        self._start = start
        self._granted: float | None = 0.0 if lockstep else None
        self._of_wire = [fault for fault in faults if fault.kind in known]
        self._pending = sorted(
            (f for f in faults if f.kind not in known or f.kind == "power_cycle"),
            key=lambda f: f.start,
        )
        self.stalled = 0.0
        """The longest time for which it was not run [s]."""

    def add(self, fault: Fault) -> None:
        """Let it happen, counted from now."""
        fault = replace(fault, start=self._time() + fault.start)
        if fault.kind in self._known:
            self._of_wire.append(fault)
        if fault.kind not in self._known or fault.kind == "power_cycle":
            self._pending.append(fault)
            self._pending.sort(key=lambda each: each.start)

    @abc.abstractmethod
    def step(self) -> tuple[bytes, bytes]:
        """Bytes sent to the host, and bytes received by the device."""

    @property
    @abc.abstractmethod
    def watched(self) -> list[int]:
        """What becomes readable when the host says something; empty while it is unplugged."""

    @abc.abstractmethod
    def close(self) -> None:
        """Release its port."""

    def _time(self) -> float:
        return time.monotonic() - self._start if self._granted is None else self._granted

    def _happen(self, instant: float) -> None:
        while self._pending and self._pending[0].start <= instant:
            fault = self._pending.pop(0)
            if fault.kind == "power_cycle":
                self._power_cycle(instant)
            else:
                self._failing.inject(fault.kind, fault.value)

    def _power_cycle(self, instant: float) -> None:
        self._failing.power_cycle(instant)
