"""Emulated devices of makers, attached to a simulated machine: they show its sensors, their drives
push its masses.

What noise and delay a value has is the simulated sensor's business, so the devices add none.
"""

from collections.abc import Sequence
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from twin.emulate.emulated import EmulatedDevice
from twin.emulate.machine import Share, Shown
from twin.emulate.mdrive import EmulatedDrive
from twin.emulate.mdrive_axis import Axis
from twin.emulate.mdrive_line import EmulatedMDrives
from twin.emulate.mti import EmulatedMti
from twin.emulate.solar2 import EmulatedSolar2
from twin.plant.devices.mdrive.mdrive import MDriveSettings
from twin.plant.devices.mdrive.settings import DriveSettings
from twin.plant.devices.solar2.solar2 import Solar2Settings
from twin.plant.devices.xbus.mti import MtiSettings

Array = NDArray[np.float64]
Inner = TypeVar("Inner", bound=EmulatedDevice)

_ITEMS = {
    "gyro": 0x8020,
    "accelerometer": 0x4020,
    "magnetometer": 0xC020,
    "attitude": 0x2010,
    "temperature": 0x0810,
}
"""Stream -> data identifier of an MTi."""

_KELVIN = 273.15
_HOMED = 31002
"""What a host leaves in a drive's user register that is set up and homed (docs/hardware.md)."""

_MARGIN = 0.0005
"""From the end of the travel to the limit switch of an emulated stage [m]."""


class _Attached(EmulatedDevice, Generic[Inner]):
    """An emulated device that is a maker's in all but what it measures and moves."""

    _inner: Inner

    @property
    def baud(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self._inner.baud

    def receive(self, data: bytes, now: float) -> bytes:
        return self._inner.receive(data, now)

    def power_cycle(self, now: float) -> None:
        self._inner.power_cycle(now)

    def inject(self, fault: str, value: float = 0.0) -> None:
        self._inner.inject(fault, value)


class AttachedMti(_Attached[EmulatedMti]):
    """An MTi on the machine: one packet a sample, of the instant at which it was true."""

    def __init__(self, settings: MtiSettings, share: Share) -> None:
        """Switch it on."""
        self._share = share
        self._unit = settings.magnetic_unit or 1.0
        self._inner = EmulatedMti(
            baud=settings.baud,
            device_id=EmulatedMti.device_id if settings.device_id is None else settings.device_id,
            has_orientation="attitude" in settings.rates,
            on_the_beat=True,
            noise={},
        )

    def advance(self, now: float) -> bytes:
        said = b""
        for shown in self._share.step({}, now):
            # a packet that is due before this sample has those before it
            said += self._inner.advance(max(shown.time - 1e-6, 0.0))
            self._show(shown)
        return said + self._inner.advance(now)

    def _show(self, shown: Shown) -> None:
        value = shown.value
        if shown.source == "magnetometer":
            value = value / self._unit
        elif shown.source == "temperature":
            value = value - _KELVIN
        self._inner.values[_ITEMS[shown.source]] = tuple(value.tolist())


class AttachedSolar2(_Attached[EmulatedSolar2]):
    """A SOLAR-2 on the machine, which shows its newest angles whenever it is asked."""

    def __init__(self, settings: Solar2Settings, share: Share) -> None:
        """Switch it on, in the mode in which it is expected."""
        self._share = share
        self._inner = EmulatedSolar2(
            baud=settings.baud,
            text=settings.mode != "binary",
            x_first=settings.x_first,
            noise=0.0,
            interval=1.0 / settings.rate,
            streaming=settings.mode == "stream",
        )

    def advance(self, now: float) -> bytes:
        for shown in self._share.step({}, now):
            if np.isfinite(shown.value).all():
                self._inner.show(*np.degrees(shown.value).tolist())
        return self._inner.advance(now)


class AttachedMDrives(_Attached[EmulatedMDrives]):
    """MDrives whose carriages are the machine's masses; they were homed in a session before."""

    def __init__(self, settings: MDriveSettings, share: Share, start: Sequence[float]) -> None:
        """Switch them on.

        Args:
            settings: of the line and its drives.
            share: of the machine.
            start: where the carriages stand, by the drives' order [m].
        """
        self._per_metre = np.array([_per_metre(drive) for drive in settings.drives])
        self._share = share
        self._inner = EmulatedMDrives(drives=[])
        for drive, place, steps in zip(settings.drives, start, self._per_metre, strict=True):
            end = max(map(abs, drive.travel)) + _MARGIN
            made = EmulatedDrive(
                name=drive.address,
                baud=settings.baud,
                inputs=dict(drive.inputs),
                axis=Axis(
                    position=round(place * steps),
                    travel=round(end * steps),
                    home=round(drive.home_position * steps),
                ),
            )
            made.axis.count_from(round(place * steps), 0.0)
            # in its memory of now, not in the one that outlives a power cycle
            made.values[settings.mark] = _HOMED
            self._inner.drives.append(made)
        share.drive = self._places

    def advance(self, now: float) -> bytes:
        said = self._inner.advance(now)
        self._share.step({}, now)
        return said

    def _places(self, time: float) -> Array:
        """(drives,) where the carriages are then [m]."""
        carriages = [drive.axis.carriage(time) for drive in self._inner.drives]
        return np.array(carriages) / self._per_metre


def _per_metre(drive: DriveSettings) -> float:
    """Microsteps."""
    return drive.full_steps * drive.microsteps / drive.lead
