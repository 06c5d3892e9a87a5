"""A device that says what a real one once said: a line's bytes, kept by pyserial's `spy://`.

A port that is opened as `spy:///dev/ttyUSB0?file=imu.spy` writes all bytes of both directions with
their times, whatever device is on it. Here the device's part is said again, byte for byte: to the
host that asks as the one did then, when it has asked, as long after as then.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from twin.emulate.emulated import EmulatedDevice
from twin.errors import UnknownName, UsageError


@dataclass(frozen=True)
class Said:
    """Bytes that were sent together in one direction."""

    time: float
    """[s]."""
    by_host: bool
    data: bytes


def spied(path: Path) -> tuple[Said, ...]:
    """What a spy wrote: lines of time, direction, place and bytes in hexadecimal; what a port was
    told besides is left out.

    Raises:
        UsageError: no such file, or a line that is none of a spy's.
    """
    saids: list[Said] = []
    try:
        lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError as problem:
        raise UsageError(f"{path}: {problem.strerror}; give a file that spy:// wrote") from None
    for number, line in enumerate(lines, start=1):
        head = line[:22].split()
        try:
            time, way = float(head[0]), head[1]
            if way in ("TX", "RX"):
                # sixteen bytes a line, eight and eight, then what they are as text
                saids.append(Said(time, way == "TX", bytes.fromhex(line[22:72])))
        except (ValueError, IndexError):
            raise UsageError(
                f"{path}:{number}: {line[:40]!r} is no line of a spy; give a file that a port "
                "opened as spy://PORT?file=FILE has written"
            ) from None
    if not any(not item.by_host for item in saids):
        raise UsageError(f"{path}: the device says nothing in it; keep a line that does")
    return tuple(saids)


class ReplayedDevice(EmulatedDevice):
    """Says again what a device said; what it is told now counts by its length alone."""

    def __init__(self, said: Sequence[Said], *, baud: int) -> None:
        """Switch it on.

        Args:
            said: by both ends, in the order of time.
            baud: of the line.
        """
        self.baud = baud
        self._said = tuple(said)
        self.power_cycle(0.0)

    def receive(self, data: bytes, time: float) -> bytes:
        self._heard += len(data)
        return self.advance(time)

    def advance(self, time: float) -> bytes:
        out = bytearray()
        while self._next < len(self._said):
            item = self._said[self._next]
            if item.by_host:
                if self._heard < len(item.data):
                    break
                self._heard -= len(item.data)
                self._later = time - item.time
            elif item.time + self._later > time:
                break
            else:
                out += item.data
            self._next += 1
        return bytes(out)

    def power_cycle(self, time: float) -> None:
        self._next, self._heard, self._later = 0, 0, time

    def inject(self, fault: str, value: float = 0.0) -> None:
        raise UnknownName("fault of a replayed device", fault, ())
