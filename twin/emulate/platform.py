"""A platform's devices, emulated: its [hardware] on pseudo-terminals, one simulation behind them.

Emulated devices of makers, attached to a simulated machine: they show its sensors, their drives
push its masses.
What noise and delay a value has is the simulated sensor's business, so the devices add none.

The devices and the machine behind them live together in another process, on the wall's clock and at
their lines' rates; they know of this one what comes over the lines.
"""

import pickle
import secrets
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from twin.emulate.cameras import EmulatedNatNet, EmulatedVicon
from twin.emulate.emulated import Emulated, EmulatedDevice, Fault
from twin.emulate.imus import EmulatedBno08x, EmulatedVn100
from twin.emulate.line import EmulatedLines, Link
from twin.emulate.machine import DeviceValue, EmulatedMachine, Share, SimulatedMachine
from twin.emulate.mdrive import Axis, EmulatedDrive, EmulatedMDrives
from twin.emulate.microcontroller import EmulatedMicrocontroller
from twin.emulate.mti import EmulatedMti
from twin.emulate.packets import free_port
from twin.emulate.replayed import ReplayedDevice, Said
from twin.emulate.solar2 import EmulatedSolar2
from twin.errors import UnknownName, UsageError
from twin.plant.devices.bno08x import RATE, Bno08xSettings
from twin.plant.devices.cameras import CameraSettings, NatNetSettings, ViconSettings
from twin.plant.devices.device import Device, DeviceSettings
from twin.plant.devices.host_time import HostTime
from twin.plant.devices.link import Schema
from twin.plant.devices.mdrive import MDriveSettings
from twin.plant.devices.mdrive_line import DriveSettings
from twin.plant.devices.microcontroller import Microcontroller, MicrocontrollerSettings
from twin.plant.devices.mti import MtiSettings
from twin.plant.devices.network import is_network
from twin.plant.devices.solar2 import Solar2Settings
from twin.plant.devices.vn100 import Vn100Settings
from twin.plant.hardware_setup import HardwareSetup
from twin.plant.initial import InitialState
from twin.platform import Platform

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

    def receive(self, data: bytes, time: float) -> bytes:
        return self._inner.receive(data, time)

    def power_cycle(self, time: float) -> None:
        self._inner.power_cycle(time)

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

    def advance(self, time: float) -> bytes:
        said = b""
        for shown in self._share.step({}, time):
            # a packet that is due before this sample has those before it
            said += self._inner.advance(max(shown.time - 1e-6, 0.0))
            self._show(shown)
        return said + self._inner.advance(time)

    def _show(self, shown: DeviceValue) -> None:
        value = shown.value
        if shown.source == "magnetometer":
            value = value / self._unit
        elif shown.source == "temperature":
            value = value - _KELVIN
        self._inner.values[_ITEMS[shown.source]] = tuple(value.tolist())


class AttachedSolar2(_Attached[EmulatedSolar2]):
    """A SOLAR-2 on the machine, which answers each request with its newest angles."""

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

    def advance(self, time: float) -> bytes:
        for shown in self._share.step({}, time):
            if np.isfinite(shown.value).all():
                self._inner.show(*np.degrees(shown.value).tolist())
        return self._inner.advance(time)


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

    def advance(self, time: float) -> bytes:
        said = self._inner.advance(time)
        self._share.step({}, time)
        return said

    def _places(self, time: float) -> Array:
        """(drives,) where the carriages are then [m]."""
        carriages = [drive.axis.carriage(time) for drive in self._inner.drives]
        return np.array(carriages) / self._per_metre


def _per_metre(drive: DriveSettings) -> float:
    """Microsteps."""
    return drive.full_steps * drive.microsteps / drive.lead


_STAGES = "command_stage_position"


@dataclass(frozen=True)
class Devices:
    """Makes the emulated devices with their machine, in the process where they will live."""

    settings: Mapping[str, DeviceSettings]
    machine: EmulatedMachine
    said: Mapping[str, tuple[Said, ...]]
    """By devices that say again what they said once."""

    def __call__(self) -> dict[str, Emulated]:
        """Switched on, at time 0."""
        machine = self.machine.simulated()
        return {name: self._made(name, machine) for name in self.settings}

    def _made(self, name: str, machine: SimulatedMachine) -> Emulated:
        settings, share = self.settings[name], machine.share(name)
        if name in self.said:
            return ReplayedDevice(self.said[name], baud=settings.baud)
        sources = {each.source for each in self.machine.measured if each.device == name}
        match settings:
            case MicrocontrollerSettings():
                return EmulatedMicrocontroller(
                    Schema(settings.channels),
                    {},
                    machine=share,
                    name=f"emulated {settings.name}"[:32],
                    longest_valid_ms=max(500, round(2000 * settings.valid_for)),
                    baud=settings.baud,
                )
            case MDriveSettings():
                (route,) = (
                    route
                    for route in self.machine.commanded
                    if route.stream == _STAGES and route.device == name
                )
                start = route.given(machine.place[list(route.columns)])
                return AttachedMDrives(settings, share, start.tolist())
            case MtiSettings():
                return AttachedMti(settings, share)
            case Solar2Settings():
                return AttachedSolar2(settings, share)
            case NatNetSettings():
                return EmulatedNatNet(settings, share, sources)
            case ViconSettings():
                return EmulatedVicon(settings, share, sources)
            case Vn100Settings():
                return EmulatedVn100(share, sources, settings.baud)
            case Bno08xSettings():
                return EmulatedBno08x(share, sources, settings.baud)
            case _:
                raise UsageError(f"{name}: there is no emulation of {type(settings).__name__}")


class EmulatedPlatform:
    """Starts the emulation on entry, ends it on exit."""

    def __init__(
        self,
        platform: Platform,
        setup: HardwareSetup,
        *,
        seed: int = 0,
        initial: InitialState | None = None,
        faults: Sequence[Fault] = (),
        lockstep: bool = False,
        said: Mapping[str, tuple[Said, ...]] | None = None,
    ) -> None:
        """Nothing is started yet.

        Args:
            platform: which is simulated, with its effects.
            setup: its [hardware]; ports and calibration are not used.
            seed: of its sensors' noise.
            initial: its state at time 0; level and at rest unless given.
            faults: of the lines and the devices.
            lockstep: time passes only as the host lets it, as fast as both can
                (`twin.bench`).
            said: by devices that say it again, whatever the machine does, by name.

        Raises:
            UsageError: wiring that cannot be emulated.
            UnknownName: a device that is not there.
        """
        _check(platform, setup, lockstep=lockstep)
        for name in (*(fault.device for fault in faults if fault.device), *(said or {})):
            if name not in setup.devices:
                raise UnknownName("device", name, setup.devices)
        self._setup = setup
        sampled = _sampled(platform, setup)
        machine = EmulatedMachine(sampled, setup.measured, setup.commanded, seed, initial)
        self._devices = Devices(dict(setup.devices), machine, dict(said or {}))
        try:
            pickle.dumps(self._devices)
        except (pickle.PicklingError, AttributeError, TypeError) as problem:
            raise UsageError(
                "an effect from a file of one's own cannot be emulated: it would have to travel to "
                f"another process ({problem}); simulate it with --plant sim"
            ) from problem
        self._faults, self._seed = faults, seed
        self.lockstep = lockstep
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._line: EmulatedLines | None = None

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="twin-")
        folder = Path(self._folder.name)
        links = {name: self._link(folder, name) for name in self._setup.devices}
        try:
            line = EmulatedLines(
                self._devices, links, self._faults, seed=self._seed, lockstep=self.lockstep
            )
            self._line = line.__enter__()
        except BaseException:
            self._folder.cleanup()
            raise
        return self

    def _link(self, folder: Path, name: str) -> Link:
        """Where a device will be opened: a terminal, or a port of this computer with its key."""
        settings = self._setup.devices[name]
        # in lockstep a line's bytes are counted, and a network may lose them
        if self.lockstep or not is_network(settings.port):
            return folder / name
        url = f"udp://127.0.0.1:{free_port()}"
        if isinstance(settings, CameraSettings):
            return url
        key = folder / f"{name}.key"
        key.touch(0o600)
        key.write_text(secrets.token_hex(32), encoding="ascii")
        return f"{url}?key={key}"

    def __exit__(self, *error: object) -> None:
        if self._line is not None:
            self._line.__exit__(*error)
        if self._folder is not None:
            self._folder.cleanup()

    @property
    def line(self) -> EmulatedLines:
        """Of the devices, to be made to fail; while it runs."""
        assert self._line is not None
        return self._line

    @property
    def stalled(self) -> float:
        """The longest time for which its process was not run [s]; known when it has ended."""
        return 0.0 if self._line is None else self._line.stalled

    @property
    def ports(self) -> dict[str, Link]:
        """Where each device can be opened, by its name; while it runs."""
        return self.line.links

    def sessions(self, host: HostTime) -> dict[str, Device]:
        """Sessions in lockstep, not yet connected, that go by that time; while it runs."""
        return {
            name: Microcontroller(settings, host)
            for name, settings in self.setup.devices.items()
            if isinstance(settings, MicrocontrollerSettings)
        }

    @property
    def setup(self) -> HardwareSetup:
        """The wiring with these ports; while it runs."""
        return _at(self._setup, {name: str(port) for name, port in self.ports.items()})


def with_port(setup: HardwareSetup, port: str) -> HardwareSetup:
    """The same wiring at other ports.

    Args:
        setup: of a machine.
        port: of its only device, or `NAME=PORT,NAME=PORT` of several.

    Raises:
        UsageError: it has several, and not each is named.
        UnknownName: a device that it has not.
    """
    if port.partition("=")[0] in setup.devices:
        ports = dict(item.split("=", 1) for item in port.split(",") if "=" in item)
        for name in ports:
            if name not in setup.devices:
                raise UnknownName("device", name, setup.devices)
        return _at(setup, ports)
    if len(setup.devices) != 1:
        several = ",".join(f"{name}=PORT" for name in setup.devices)
        raise UsageError(
            f"{', '.join(setup.devices)}: one port cannot be that of {len(setup.devices)} devices; "
            f"give serial:{several}, or write a file with [hardware] and their ports, and give "
            "serial:FILE.toml"
        )
    return _at(setup, dict.fromkeys(setup.devices, port))


def _at(setup: HardwareSetup, ports: Mapping[str, str]) -> HardwareSetup:
    devices = {
        name: replace(settings, port=ports.get(name, settings.port))
        for name, settings in setup.devices.items()
    }
    return replace(setup, devices=devices)


def _sampled(platform: Platform, setup: HardwareSetup) -> Platform:
    """The machine with its sensors sampled as the devices on them do it.

    An MTi has rates of its own, as have cameras. A SOLAR-2 has its angles ready at all
    times: it measures at each physics step, and is asked when it is.
    """
    sensors = dict(platform.sensors)
    for route in setup.measured:
        settings, sensor = setup.devices[route.device], sensors.get(route.stream)
        if sensor is None:
            continue
        if isinstance(settings, MtiSettings):
            sensors[route.stream] = replace(sensor, rate=float(settings.rates[route.source]))
        elif isinstance(settings, Bno08xSettings):
            sensors[route.stream] = replace(sensor, rate=RATE)
        elif isinstance(settings, CameraSettings | Vn100Settings):
            sensors[route.stream] = replace(sensor, rate=float(settings.rate))
        elif isinstance(settings, Solar2Settings):
            sensors[route.stream] = replace(sensor, rate=1.0 / platform.step)
    return replace(platform, sensors=sensors)


def _check(platform: Platform, setup: HardwareSetup, *, lockstep: bool) -> None:
    if not setup.devices:
        raise UsageError(f"{platform.name} has no device in its [hardware]; state one")
    boards = [isinstance(device, MicrocontrollerSettings) for device in setup.devices.values()]
    if lockstep and boards != [True]:
        raise UsageError(
            f"--lockstep is for one microcontroller on our own link; {platform.name} has "
            f"{', '.join(setup.devices)}, whose drivers go by the wall's clock: leave it out"
        )
    stages = [setup.devices[r.device] for r in setup.commanded if r.stream == _STAGES]
    driven = {isinstance(settings, MDriveSettings) for settings in stages}
    if len(driven) > 1:
        raise UsageError("stages on MDrives and stages on a board cannot be emulated together")
    for name, settings in setup.devices.items():
        drives = isinstance(settings, MDriveSettings)
        mine = [r for r in setup.commanded if r.device == name and r.stream == _STAGES]
        if drives and len(mine) != 1:
            raise UsageError(f"{name}: [hardware.commands] must give it its stages once")
