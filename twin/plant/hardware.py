"""The real machine: several devices, each with its own clock and rate, behind the plant interface.

Devices read in threads of their own, so that the loop never waits. Until it is armed, whatever is
written goes nowhere: the loop reads and computes only. Put a guard round it (`twin.plant.guard`).
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import DeviceError, UnknownName, UsageError
from twin.plant.devices.device import Counters, Device, Sample
from twin.plant.devices.host_time import WALL, HostTime
from twin.plant.hardware_setup import HardwareSetup, Route
from twin.plant.limits import Limits
from twin.plant.plant import Plant
from twin.plant.plausibility import MotionAgreement, SampleChecks, StreamCount
from twin.platform import Platform
from twin.signals import Command, Reading, Samples

Array = NDArray[np.float64]


class SampleRow(NamedTuple):
    """What one sample is to the machine."""

    time: float
    """[s]."""
    value: Array
    """(columns,)."""
    valid: bool
    reason: str
    """Why it is not."""


class Merged:
    """The streams of one machine, row by row."""

    def __init__(self, platform: Platform, routes: Iterable[Route]) -> None:
        """Nothing has come."""
        self.counts: dict[str, StreamCount] = {}
        """What came of each stream."""
        self._widths = {route.stream: len(platform.columns(route.stream)) for route in routes}
        self._rows: dict[str, list[SampleRow]] = {name: [] for name in self._widths}
        self._parts: dict[str, dict[int, SampleRow]] = {name: {} for name in self._widths}

    def add(self, sample: Sample, route: Route, zero: float, column: int | None = None) -> None:
        """One sample of a device.

        Args:
            sample: as it came.
            route: to the machine.
            zero: the host's monotonic clock at tick 0 [s].
            column: of the one part that the sample is of; None: of all of the route's.
        """
        time = sample.host_time - sample.latency - zero
        with np.errstate(invalid="ignore"):
            value = np.asarray(sample.value)
            value = route.taken(value) if column is None else route.taken_of(column, value)
        valid = sample.valid and bool(np.isfinite(value).all())
        columns = route.columns if column is None else (column,)
        if len(columns) == self._widths[route.stream]:
            ordered = np.empty(len(columns))
            ordered[list(columns)] = value
            self._rows[route.stream].append(SampleRow(time, ordered, valid, sample.reason))
        else:
            self._join(route.stream, columns, SampleRow(time, value, valid, sample.reason))

    def take(self, until: float) -> Reading:
        """All rows since the last call, in the order of their times."""
        streams: dict[str, Samples] = {}
        for name, rows in self._rows.items():
            if rows:
                rows.sort(key=lambda row: row.time)
                streams[name] = Samples(
                    np.array([[row.value for row in rows]]),
                    np.array([[row.time for row in rows]]),
                    np.array([[row.valid for row in rows]]),
                )
                self._count(name, rows)
                self._rows[name] = []
        return Reading(until, streams)

    def begin_anew(self) -> None:
        """Forget parts that wait for others: their times are of another zero."""
        for parts in self._parts.values():
            parts.clear()
        for count in self.counts.values():
            count.newest = -np.inf

    def _count(self, stream: str, rows: list[SampleRow]) -> None:
        count = self.counts.setdefault(stream, StreamCount())
        count.rows += len(rows)
        for row in rows:
            count.believed = row.valid
            if row.valid:
                count.newest = max(count.newest, row.time)
            else:
                count.bad += 1
                count.reason = row.reason or "not a number"

    def _join(self, stream: str, columns: tuple[int, ...], row: SampleRow) -> None:
        """Keep the columns of some parts until all have come: then they are one row.

        Its time is the mean of theirs: what drives on one line tell one after the other.
        """
        parts = self._parts[stream]
        for place, column in enumerate(columns):
            parts[column] = row._replace(value=row.value[place : place + 1])
        if len(parts) == self._widths[stream]:
            whole = [parts[column] for column in range(len(parts))]
            self._rows[stream].append(
                SampleRow(
                    float(np.mean([part.time for part in whole])),
                    np.concatenate([part.value for part in whole]),
                    all(part.valid for part in whole),
                    next((part.reason for part in whole if not part.valid), ""),
                )
            )
            parts.clear()


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
        self._checks = {
            name: SampleChecks(name, setup.limits(platform, name)) for name in self.devices
        }
        self._agreement = MotionAgreement(platform, setup.agreement)
        self._measured = {(route.device, route.source): route for route in setup.measured}
        self._columns = {
            (route.device, route.source, part): column
            for route in setup.measured
            for column, part in enumerate(platform.columns(route.stream))
        }
        self._host = host
        self._zero = host.time()
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
    def counts(self) -> Mapping[str, StreamCount]:
        """What came of each of the machine's streams."""
        return self._merged.counts

    @property
    def doubt(self) -> str:
        return next(iter(self._agreement.doubts.values()), "")

    def why_bad(self, stream: str) -> str:
        count = self.counts.get(stream)
        return "" if count is None or count.believed else count.reason

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
        now = self._host.time()
        if until <= self._until:
            self._zero = now - until
            self._merged.begin_anew()
            self._agreement.begin_anew()
        self._until = until
        for name, device in self.devices.items():
            checks = self._checks[name]
            for raw in device.read():
                sample = checks.judged(raw, now)
                route = self._measured.get((name, sample.stream))
                if route is not None:
                    column = self._columns.get((name, sample.stream, sample.part))
                    self._merged.add(sample, route, self._zero, column)
            if device.fault and self.armed:
                self._fail(device.fault)
            elif device.fault:
                self.stopped.setdefault(0, device.fault)
        reading = self._merged.take(until)
        self._agreement.take(reading)
        return reading

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
