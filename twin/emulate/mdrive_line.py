"""Several emulated MDrives on one RS-422 or RS-485 line."""

from dataclasses import dataclass, field

from twin.emulate.emulated import EmulatedDevice
from twin.emulate.mdrive import EmulatedDrive
from twin.emulate.mdrive_tables import FAULTS
from twin.errors import UnknownName


@dataclass
class EmulatedMDrives(EmulatedDevice):
    """Drives that share one line."""

    drives: list[EmulatedDrive] = field(default_factory=lambda: [EmulatedDrive()])

    def __post_init__(self) -> None:
        self._now = 0.0

    @property
    def baud(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.drives[0].baud

    def receive(self, data: bytes, now: float) -> bytes:
        return _together([drive.receive(data, now) for drive in self.drives])

    def advance(self, now: float) -> bytes:
        self._now = now
        return _together([drive.advance(now) for drive in self.drives])

    def power_cycle(self, now: float) -> None:
        for drive in self.drives:
            drive.start(now)

    def inject(self, fault: str, value: float = 0.0) -> None:
        """Upon the first drive; `2:stall` is the drive named 2."""
        name, _, kind = fault.rpartition(":")
        if kind not in FAULTS:
            raise UnknownName("fault of an MDrive", kind, FAULTS)
        drive = next((d for d in self.drives if d.name == name), self.drives[0])
        drive.inject(kind, value, self._now)


def _together(said: list[bytes]) -> bytes:
    """Who talks alone is heard; two at once pull the line both ways."""
    voices = [each for each in said if each]
    if len(voices) < 2:
        return b"".join(voices)
    longest = max(map(len, voices))
    padded = [each.ljust(longest, b"\xff") for each in voices]
    mixed = bytearray(padded[0])
    for other in padded[1:]:
        for k, byte in enumerate(other):
            mixed[k] &= byte
    return bytes(mixed)
