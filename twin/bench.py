"""A machine on its bench, or its emulation: opened, watched, armed if somebody says so, closed.

The loop is that of every plant. What differs is told here: time is the wall's, nothing leaves
until it is armed, and in the end the machine is left in its safe state.

Host and emulation in step: time stands until both have nothing left to do, then goes on.
How it is kept honest: every byte still goes through the pseudo-terminal and its session, at the
line's rate in emulated time. The host counts the bytes that it has written and lets time go on; the
emulation waits until that many have reached it, advances by beats of a millisecond until it has
said something or the time is over, and tells its time and how many bytes it has said in all; the
host waits until its reader has dealt with that many. So nothing is lost or comes late because a
computer is slow, and time-to-live, ages and clock fits are those of emulated time. What it does
not show is what a slow computer does: the loop's own work takes no time here.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from twin import stop
from twin.clock import Clock, WallClock, last_tick
from twin.emulate.emulated import Fault
from twin.emulate.line import EmulatedLines
from twin.emulate.platform import EmulatedPlatform, with_port
from twin.errors import UnknownName, UsageError
from twin.plant.devices.device import Device
from twin.plant.devices.host_time import WALL, HostTime
from twin.plant.devices.port import Port
from twin.plant.guard.guarded import YES, Guarded, Held
from twin.plant.hardware import HardwarePlant
from twin.plant.hardware_setup import HardwareSetup, read_hardware
from twin.plant.initial import InitialState
from twin.plant.plant import Plant
from twin.platform import Platform
from twin.recording import Recording, Series
from twin.signals import Array, Command, Reading, stream_named, valid_rows

_PATIENCE = 5.0
"""Longest wait of the wall's clock for bytes that are on their way [s]; then they are lost."""

_LOOK = 5e-5
"""Between two looks [s]."""

_BEGIN = 1000.0
"""Host's time at the emulation's time 0 [s]: the two are not to be mistaken for one another."""


class LockstepTime(HostTime):
    """The emulation's time, and what lets it go on."""

    wall = False

    def __init__(self, line: EmulatedLines) -> None:
        """Of a line that was started in lockstep."""
        self._line = line
        self._now = 0.0
        self._port: Port | None = None
        self._said = self._before = 0

    def time(self) -> float:
        return _BEGIN + self._now

    def sleep(self, seconds: float) -> None:
        end = self._now + seconds
        while self._now < end - 1e-9:
            self._go_on(end)
            if self._port is not None:
                self._wait_until_dealt_with(self._port)

    def read(self, port: Port, timeout: float) -> bytes:
        end, came = self._now + timeout, b""
        while self._now < end - 1e-9 and not came:
            before = self._said
            self._go_on(end, port.sent)
            until = time.monotonic() + _PATIENCE
            while len(came) < self._said - before and time.monotonic() < until:
                came += port.waiting()
        port.dealt_with += len(came)
        return came

    def watch(self, port: Port) -> None:
        # bytes said before this port was opened never count as its own
        self._port, self._before = port, self._said - port.dealt_with

    def _go_on(self, end: float, sent: int | None = None) -> None:
        if sent is None:
            sent = 0 if self._port is None else self._port.sent
        answer = self._line.go_on(end, sent)
        if answer is None:
            # nobody is there any more; time goes on, and the session has to notice
            self._now = end
            time.sleep(0.02)
        else:
            self._now, self._said = answer

    def _wait_until_dealt_with(self, port: Port) -> None:
        until = time.monotonic() + _PATIENCE
        while port.dealt_with < self._said - self._before and not port.unread:
            if time.monotonic() > until:
                self._before = self._said - port.dealt_with
                return
            time.sleep(_LOOK)


WATCHED = 1.0
"""So long it is read before it is armed [s]."""

_SILENT = 1.0
"""A stream that has brought nothing valid for longer is said to be silent [s]."""

_STALLED = 0.1
"""An emulation that was not run for longer at a time says so [s]."""

_ARMING = 0.2
"""Between arming and the first tick [s], which a slow line may take to arm every device."""


class LockstepClock(Clock):
    """Each tick comes when the emulation has got there; none is ever late."""

    def __init__(self, host: LockstepTime, start: float) -> None:
        """`start`: host's time at which tick 0 is due [s]."""
        super().__init__()
        self._host, self._start = host, start

    def ticks(self, period: float, duration: float) -> Iterator[float]:
        for number in range(last_tick(period, duration) + 1):
            self._host.sleep(self._start + number * period - self._host.time())
            self._tick()
            yield number * period


class Bench(Plant):
    """One machine behind its guard; opened when it is entered."""

    def __init__(
        self,
        platform: Platform,
        setup: HardwareSetup,
        *,
        held: Held | None = None,
        emulation: EmulatedPlatform | None = None,
    ) -> None:
        """Nothing is opened yet.

        Args:
            platform: the machine.
            setup: its wiring.
            held: arm it, and whether it floats, both as the operator says; None: a dry run.
            emulation: what stands for the machine, started and ended with this.
        """
        self.platform = platform
        self.n = 1
        self.stopped = {}
        self.emulation = emulation
        self.setup, self._held = setup, held
        self._stack = ExitStack()
        self._remarks: list[str] = []
        self.trial_readings: list[Reading] = []
        """Of the first use of its actuators, from before the first push."""
        self.trial_applied: list[tuple[float, Command]] = []
        """What was applied in it, and from when on [s]."""
        self.trial_told: list[str] = []
        """What came of it, a sentence for each actuator."""

    def __enter__(self) -> Self:
        """Start the emulation, if there is one, and connect every device.

        Raises:
            DeviceError: one that is not there, or another.
        """
        with ExitStack() as stack:
            stack.enter_context(stop.shield())
            setup = self.setup
            if self.emulation is not None:
                setup = stack.enter_context(self.emulation).setup
            self._host: HostTime = WALL
            devices: dict[str, Device] | None = None
            if self.emulation is not None and self.emulation.lockstep:
                self._host = LockstepTime(self.emulation.line)
                # what the wall's clock says of a loop in lockstep means nothing
                setup = replace(setup, guard=replace(setup.guard, watchdog=np.inf))
                devices = self.emulation.sessions(self._host)
            self.hardware = HardwarePlant(self.platform, setup, devices, self._host)
            # an emulated machine is what its platform says: there is nothing to calibrate
            calibrated = setup.calibration is not None or self.emulation is not None
            guard = Guarded(self.hardware, setup.guard, calibrated=calibrated)
            self.guard = stack.enter_context(guard)
            self.hardware.connect()
            self._stack = stack.pop_all()
        return self

    def read(self, until: float) -> Reading:
        reading = self.guard.read(until)
        self._note()
        return reading

    def write(self, command: Command) -> Command:
        applied = self.guard.write(command)
        self._note()
        return applied

    def stop(self, reason: str) -> None:
        """Bring it to its safe state, because of `reason`; the run ends with it."""
        self.guard.stop(reason)
        self._note()

    def close(self) -> None:
        self._stack.close()

    def begin(self) -> Clock:
        """Watch it, then arm it if that was said; the clock whose first tick is at hand.

        Raises:
            SafetyError: why it is not armed.
            DeviceError: a device refuses.
        """
        ticks = int(np.ceil(_ARMING / self.platform.tick))
        self.watch(-ticks)
        if self._held is not None:
            self.guard.arm(YES, held=self._held)
            self._rest(ticks)
        return self._clock(self.hardware.zero)

    @property
    def to_be_armed(self) -> bool:
        """Somebody has said so."""
        return self._held is not None

    @property
    def in_lockstep(self) -> bool:
        """Whether its time stands still between the ticks."""
        return isinstance(self._host, LockstepTime)

    def begin_anew(self) -> Clock:
        """Count time from 0 again, armed as it is; the clock whose first tick is the next one."""
        return self._clock(self._host.time() + self.platform.tick)

    def _rest(self, ticks: int) -> None:
        """Renew what keeps it at rest until tick 0: a board may wait less for its first set-point.

        Nothing is read: the law's first reading holds what has come meanwhile.
        """
        tick, zero, host = self.platform.tick, self.hardware.zero, self._host
        for number in range(-ticks, 0):
            stop.check()
            host.sleep(zero + number * tick - host.time())
            self.write({})

    def _clock(self, zero: float) -> Clock:
        """Whose tick 0 is due at `zero` by the host's clock [s]."""
        host = self._host
        return LockstepClock(host, zero) if isinstance(host, LockstepTime) else WallClock(zero)

    def watch(self, last: int = 0) -> None:
        """Read for `WATCHED` seconds, up to the tick of that number."""
        tick = self.platform.tick
        first = last - int(np.ceil(WATCHED / tick))
        self._watch(first, last, self._host.time() - first * tick)

    def watch_on(self) -> None:
        """Read for `WATCHED` seconds more, in the same time as before."""
        tick, zero = self.platform.tick, self.hardware.zero
        first = int(np.ceil((self._host.time() - zero) / tick))
        self._watch(first, first + int(np.ceil(WATCHED / tick)), zero)

    def _watch(self, first: int, last: int, zero: float) -> None:
        """Read at these ticks, of which number 0 is due at `zero` by the host's clock [s]."""
        tick, host = self.platform.tick, self._host
        for number in range(first, last + 1):
            stop.check()
            host.sleep(zero + number * tick - host.time())
            self.read(number * tick)

    def late(self, time: float) -> float:
        """How long ago its time `time` was, by the host's clock [s]."""
        return self._host.time() - self.hardware.zero - time

    def remark(self, sentence: str) -> None:
        """Say this at the end, once, however often it comes."""
        self._remarks = [item for item in self._remarks if item[:20] != sentence[:20]]
        self._remarks.append(sentence)

    def messages(self) -> list[str]:
        """What devices, line and guard have to say of the time since the last call."""
        lines = [*dict.fromkeys(self.hardware.notes()), *self._remarks]
        lines += [f"{name}: {c.words()}" for name, c in self.hardware.counters.items()]
        lines += self._of_streams()
        stalled = 0.0 if self.emulation is None else self.emulation.stalled
        if stalled > _STALLED:
            lines.append(
                f"the emulation was not run for {stalled:.2f} s at a time: its computer is busy"
            )
        acted = ", ".join(f"{rule} {count}" for rule, count in self.guard.limited.items())
        return [*lines, f"ticks in which a rule limited the command: {acted}"] if acted else lines

    def first_use(self) -> Recording | None:
        """What was read and applied while actuators were tried; None: nothing was tried."""
        streams: dict[str, Series] = {}
        for name in sorted({name for reading in self.trial_readings for name in reading.streams}):
            rows = [row for reading in self.trial_readings for row in valid_rows(reading, name)]
            if rows:
                times, values = (np.array(each) for each in zip(*rows, strict=True))
                streams[name] = self._series(name, times, values)
        if self.trial_applied:
            times = np.array([time for time, _ in self.trial_applied])
            for name in self.trial_applied[0][1]:
                values = np.array([command[name][0] for _, command in self.trial_applied])
                streams[name] = self._series(name, times, values)
        facts = {"platform": self.platform.name, "of": "first use"}
        return Recording(streams, facts) if streams else None

    def _series(self, name: str, times: Array, values: Array) -> Series:
        order = np.argsort(times, kind="stable")
        columns, unit = self.platform.columns(name), stream_named(name).unit
        return Series(times[order], values[order], columns, unit)

    def document(self) -> dict[str, Any]:
        """What `told` says, and the first use of actuators, for JSON."""
        counts = self.hardware.counts
        return {
            "devices": {name: asdict(each) for name, each in self.hardware.counters.items()},
            "streams": {
                name: {
                    "samples": counts[name].rows if name in counts else 0,
                    "not_believed": counts[name].bad if name in counts else 0,
                    "last_reason": (counts[name].reason if name in counts else "") or None,
                    "silent": self.silent(name) if name in counts else True,
                }
                for name in self.platform.sensors
            },
            "limited": dict(self.guard.limited),
            "first_use": list(self.trial_told),
            "remarks": [*dict.fromkeys(self.hardware.notes()), *self._remarks],
        }

    def _of_streams(self) -> list[str]:
        """Which streams have samples that were not believed, and which have fallen silent."""
        lines: list[str] = []
        for name, count in self.hardware.counts.items():
            if count.bad:
                lines.append(
                    f"{name}: {count.bad} of {count.rows} samples not believed; the last: "
                    f"{count.reason}"
                )
            if self.silent(name):
                since = "" if np.isinf(count.newest) else f" since {count.newest:.2f} s"
                lines.append(f"{name}: silent{since}")
        heard = self.hardware.counts.keys()
        never = [name for name in self.platform.sensors if name not in heard]
        return [*lines, *(f"{name}: no sample ever came" for name in never)]

    def silent(self, stream: str) -> bool:
        """Whether a stream of which something came has had nothing valid for long."""
        sensor = self.platform.sensors.get(stream)
        if sensor is None:
            return False
        age = self.guard.seen.time - self.hardware.counts[stream].newest
        return age > max(_SILENT, 5.0 / sensor.rate + sensor.latency)

    def _note(self) -> None:
        """The loop looks here for how the guard's run ended."""
        self.stopped, self.safe_reason = self.guard.stopped, self.guard.safe_reason


def captured(machine: Platform) -> Platform:
    """The same machine with its ball held; one on another joint moves as ever."""
    base = machine.base
    if base.kind != "ball":
        return machine
    return replace(machine, base=replace(base, locked=(base.joint, *base.planar)))


def carried(machine: Platform, setup: HardwareSetup) -> Platform:
    """The machine with the sensors that a device carries: no other tells the loop anything."""
    streams = {route.stream for route in setup.measured}
    sensors = {name: sensor for name, sensor in machine.sensors.items() if name in streams}
    return replace(machine, sensors=sensors)


def open_bench(
    machine: Platform,
    plant: str,
    *,
    held: Held | None = None,
    seed: int = 0,
    initial: InitialState | None = None,
    faults: Sequence[Fault] = (),
    lockstep: bool = False,
) -> Bench:
    """What a plant's name stands for, not yet entered.

    Args:
        machine: with the effects of its emulation.
        plant: `pty`, its emulation; `pty:FILE.toml`, wired as the [hardware] of that file says;
            `serial`, its own [hardware] at the ports that stand there; `serial:URL`, with its
            device at that port, or `serial:NAME=URL,NAME=URL` with several; or
            `serial:FILE.toml`, the [hardware] of that file.
        held: see `Bench`; an emulated table that is captured stands still, level.
        seed: of an emulation's noise.
        initial: of an emulation.
        faults: of an emulation.
        lockstep: an emulation and this process wait for each other instead of for the wall's clock.

    Raises:
        UnknownName: another plant.
        UsageError: wiring that does not fit.
        PlatformError: no [hardware], or something wrong in it.
    """
    kind, _, where = plant.partition(":")
    if plant == "pty" or (kind == "pty" and where.endswith(".toml")):
        setup = read_hardware(machine, Path(where) if where else None)
        simulated = captured(machine) if held is Held.captured else machine
        emulation = EmulatedPlatform(
            simulated, setup, seed=seed, initial=initial, faults=faults, lockstep=lockstep
        )
        return Bench(carried(machine, setup), setup, held=held, emulation=emulation)
    if kind != "serial":
        raise UnknownName("plant", plant, ("pty", "pty:FILE.toml", "serial", "serial:URL"))
    if plant == "serial":
        setup = read_hardware(machine)
    elif not where:
        raise UsageError(
            "--plant serial: names no port; give serial alone for those of [hardware], "
            "serial:/dev/serial/by-id/..., a URL such as serial:socket://HOST:PORT, or "
            "serial:FILE.toml with [hardware]"
        )
    elif where.endswith(".toml"):
        setup = read_hardware(machine, Path(where))
    else:
        setup = with_port(read_hardware(machine), where)
    return Bench(carried(machine, setup), setup, held=held)
