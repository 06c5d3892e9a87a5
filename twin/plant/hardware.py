"""The real machine: several devices, each with its own clock and rate, behind the plant interface.

Devices read in threads of their own, so that the loop never waits. Until it is armed, whatever is
written goes nowhere: the loop reads and computes only. Put a guard round it (`twin.plant.guard`).
"""

from collections.abc import Mapping

import numpy as np

from twin.errors import DeviceError, UnknownName, UsageError
from twin.plant.devices.device import Counters, Device
from twin.plant.devices.host_time import WALL, HostTime
from twin.plant.hardware_setup import HardwareSetup
from twin.plant.limits import Limits
from twin.plant.merged import Merged
from twin.plant.plant import Plant
from twin.plant.routes import Route
from twin.platform import Platform
from twin.signals import Command, Reading


class HardwarePlant(Plant):
    """One machine on its bench."""

    def __init__(
        self,
        platform: Platform,
        setup: HardwareSetup,
        devices: Mapping[str, Device] | None = None,
        host: HostTime = WALL,
    ) -> None:
        """Nothing is opened yet.

        Args:
            platform: the machine.
            setup: what is wired to it.
            devices: sessions by name; made from the setup unless given.
            host: the time by which they are read.

        Raises:
            UsageError: a route to a stream that its device lacks, or that is wider there.
        """
        self.platform, self.setup = platform, setup
        self.n = 1
        self.stopped = {}
        self.armed = False
        self.devices = devices or {name: s.session() for name, s in setup.devices.items()}
        self._check_routes()
        self._limits = Limits(platform)
        self._merged = Merged(platform, setup.measured)
        self._measured = {(route.device, route.source): route for route in setup.measured}
        self._columns = {
            (route.device, route.source, part): column
            for route in setup.measured
            for column, part in enumerate(platform.columns(route.stream))
        }
        self._host = host
        self._zero = host.now()
        self._until = np.inf
        self._applied: Command = {}

    @property
    def zero(self) -> float:
        """When its time 0 was, or is, by the host's time [s]."""
        return self._zero

    @property
    def counters(self) -> dict[str, Counters]:
        """What went over each line, by device."""
        return {name: device.counters for name, device in self.devices.items()}

    @property
    def out_of_range(self) -> int:
        """Samples at or beyond the range that the platform states of their sensor."""
        return self._merged.out_of_range

    def connect(self) -> None:
        """Open, greet and configure every device; one that fails leaves none open.

        Raises:
            DeviceError: the first that does not answer, refuses, or is another one.
        """
        try:
            for device in self.devices.values():
                device.connect()
                device.configure()
        except BaseException:
            self.close()
            raise
        self.stopped = {}

    def read(self, until: float) -> Reading:
        """As `Plant` says; time begins anew with a reading that is not after the one before."""
        now = self._host.now()
        if until <= self._until:
            self._zero = now - until
            self._merged.begin_anew()
        self._until = until
        for name, device in self.devices.items():
            for sample in device.read():
                route = self._measured.get((name, sample.stream))
                if route is not None:
                    column = self._columns.get((name, sample.stream, sample.part))
                    self._merged.add(sample, route, self._zero, column)
            if device.fault and self.armed:
                self._fail(device.fault)
            elif device.fault:
                self.stopped.setdefault(0, device.fault)
        return self._merged.take(until)

    def write(self, command: Command) -> Command:
        self._limits.check(command, self.n)
        idle = {name: np.zeros((1, width)) for name, width in self.platform.commands.items()}
        if not self.armed:
            return idle | self._applied
        bad = [name for name, value in command.items() if not np.isfinite(value).all()]
        if bad:
            self._fail(f"{bad[0]} is {command[bad[0]][0].tolist()}")
            return idle | self._applied
        for name, device in self.devices.items():
            routes = [route for route in self.setup.commanded if route.device == name]
            if routes:
                try:
                    self._give(device, routes, command)
                except DeviceError as problem:
                    self._fail(str(problem))
                    break
        return idle | self._applied

    def engage(self) -> None:
        for device in self.devices.values():
            try:
                device.arm()
            except BaseException:
                self.disengage()
                raise
        self.stopped = {}
        self._applied = {}
        self.armed = True

    def disengage(self) -> None:
        self.armed = False
        for device in self.devices.values():
            device.disarm()

    def safe_stop(self, rest: Command, *, floating: bool) -> None:
        self.armed = False
        for device in self.devices.values():
            device.safe_stop(floating)
        self._applied = dict(rest)

    def close(self) -> None:
        self.armed = False
        for device in self.devices.values():
            device.close()

    def notes(self) -> list[str]:
        """What devices have told since the last call, a sentence each."""
        told: list[str] = []
        for device in self.devices.values():
            while device.notes:
                told.append(device.notes.popleft())
        return told

    def _check_routes(self) -> None:
        """A mistake in the wiring is told before a port is opened."""
        for routes, commanded in ((self.setup.measured, False), (self.setup.commanded, True)):
            for route in routes:
                device = self.devices[route.device]
                there = device.commands if commanded else device.streams
                if route.source not in there:
                    raise UnknownName(f"stream of {route.device}", route.source, there)
                if there[route.source] != len(route.columns):
                    raise UsageError(
                        f"{route.device} has {there[route.source]} columns of {route.source}, "
                        f"{route.stream} takes {len(route.columns)} from it; correct `parts`"
                    )

    def _give(self, device: Device, routes: list[Route], command: Command) -> None:
        """Tell one device its share, and note what it really does."""
        wish = {
            route.source: route.given(command[route.stream][0, list(route.columns)])
            for route in routes
            if route.stream in command
        }
        done = device.write(wish)
        for route in routes:
            if route.source in done:
                width = self.platform.commands[route.stream]
                whole = self._applied.get(route.stream, np.zeros((1, width))).copy()
                whole[0, list(route.columns)] = route.taken(done[route.source])
                self._applied[route.stream] = whole

    def _fail(self, reason: str) -> None:
        """A device is lost or refuses: all are made safe, and nothing floats away for it."""
        self.stopped[0] = reason
        self.armed = False
        for device in self.devices.values():
            device.safe_stop(floating=True)
