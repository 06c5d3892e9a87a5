"""Sessions of the CubeSat table over its own link, in lockstep, with faults at random times.

Loop, guard, driver, pseudo-terminal, line, board and simulated table are those of `--plant pty
--lockstep`, but in one process, so that what the board says and is told can be held against what
the loop believes and is allowed.
"""

import re
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import numpy as np

from twin.bench import Bench
from twin.controller import load_controller
from twin.emulate.emulated import LINE_FAULTS, EmulatedDevice, Fault
from twin.emulate.line import Server
from twin.emulate.microcontroller import FAULTS, EmulatedMicrocontroller
from twin.emulate.platform import EmulatedPlatform
from twin.errors import TwinError
from twin.estimators import load_estimator
from twin.loop import Observer, fly
from twin.plant.devices.link import MessageType, Parser, SampleRows, Schema
from twin.plant.guard.guarded import Held
from twin.plant.hardware_setup import HardwareSetup, read_hardware
from twin.plant.limits import Limits
from twin.platform import Platform, load_platform
from twin.recording import open_log
from twin.reference import Hold
from twin.service.first_use import armed
from twin.signals import Tick
from twin.stream.provenance import provenance
from twin.stream.recorder import FileRecorder

LONG = 5.0
"""Of a flight [s]."""

WATCHED = 1.3
"""Before it, it is greeted, watched and armed [s]; one fault in ten comes so early."""

KINDS = (*LINE_FAULTS, *FAULTS)
VALUES = {"gap": 50.0, "corrupt": 20.0, "drift": 1e-3, "fault": 3.0}
"""Largest value of a board's fault; of the others it is a time, up to 0.8 s."""

TRIED, RECORDED = 5, 25
"""Every so many sessions actuators are tried first; is recorded in a file that is read back."""


def drawn(seed: int) -> tuple[Fault, ...]:
    """One to five faults over a session."""
    rng = np.random.default_rng(seed)
    return tuple(
        Fault(
            kind,
            start=float(rng.uniform(WATCHED, LONG + 1.0) if rng.random() < 0.9 else rng.random()),
            duration=float(rng.uniform(0.02, 1.5)),
            share=float(10.0 ** rng.uniform(-4.0, -1.0)),
            value=VALUES.get(kind, 0.8) * float(rng.random()),
        )
        for kind in rng.choice(KINDS, size=rng.integers(1, 6)).tolist()
    )


class Heard(EmulatedDevice):
    """A board; keeps what it has said, and what it was told beyond what it may be told."""

    def __init__(self, board: EmulatedMicrocontroller, limits: Limits) -> None:
        self.board, self.limits = board, limits
        self.baud, self.stop_bits = board.baud, board.stop_bits
        self.said: set[tuple[str, tuple[float, ...]]] = set()
        self.outside: list[str] = []

    def receive(self, data: bytes, time: float) -> bytes:
        return self._kept(self.board.receive(data, time))

    def advance(self, time: float) -> bytes:
        return self._kept(self.board.advance(time))

    def power_cycle(self, time: float) -> None:
        self.board.power_cycle(time)

    def inject(self, fault: str, value: float = 0.0) -> None:
        self.board.inject(fault, value)

    def _kept(self, out: bytes) -> bytes:
        schema = self.board.schema
        for piece in out.split(b"\0"):
            for frame in Parser(schema, "far end").feed(piece + b"\0"):
                if frame.type == MessageType.samples:
                    rows = SampleRows.unpacked(frame.payload, schema)
                    stream = schema.channels[rows.channel].stream
                    self.said |= {(stream, tuple(row)) for row in rows.value.tolist()}
        for number, value in self.board.far_end.setpoint.items():
            self._check(schema, number, value)
        return out

    def _check(self, schema: Schema, number: int, value: np.ndarray) -> None:
        stream = schema.channels[number].stream
        if stream == "command_dipole":
            allowed = self.limits.dipole(value[None])[1][0]
        else:
            allowed = self.limits.stage_position(value[None])[0]
        if np.abs(allowed - value).max() > 1e-5 * np.abs(value).max() + 1e-9:
            self.outside.append(f"{stream} {value.tolist()}")


class _Lines:
    """The table's one line, in this process."""

    alive = True

    def __init__(self, server: Server, links: Mapping[str, Path]) -> None:
        self._server, self.links = server, dict(links)

    def go_on(self, until: float, sent: int) -> tuple[float, int]:
        return self._server.go_on(until, sent)


class Here(EmulatedPlatform):
    """The emulation in this process, its board listened to."""

    heard: Heard

    def __init__(
        self, platform: Platform, setup: HardwareSetup, *, seed: int, faults: tuple[Fault, ...]
    ) -> None:
        super().__init__(platform, setup, seed=seed, faults=faults, lockstep=True)
        self._limits = Limits(platform)

    def __enter__(self) -> Self:
        folder = tempfile.TemporaryDirectory(prefix="twin-")
        self._folder = folder
        ((name, board),) = self._devices().items()
        assert isinstance(board, EmulatedMicrocontroller)
        self.heard = Heard(board, self._limits)
        link = Path(folder.name) / name
        faults = tuple(self._faults)
        server = Server(self.heard, link, faults, self._seed, start=0.0, lockstep=True)
        self._lines = _Lines(server, {name: link})
        return self

    def __exit__(self, *words: object) -> None:
        assert self._folder is not None
        self._folder.cleanup()

    @property
    def line(self) -> _Lines:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self._lines


class Checked:
    """Observer: what was believed that was never said, and how many rows there were."""

    def __init__(self, heard: Heard) -> None:
        self._heard = heard
        self.rows: dict[str, int] = {}
        self.false: list[str] = []
        self.ticks = 0

    def collect(self, tick: Tick) -> None:
        self.ticks += 1
        for stream, samples in tick.reading.streams.items():
            self.rows[stream] = self.rows.get(stream, 0) + samples.value.shape[1]
            for value in samples.value[0, samples.valid[0]].tolist():
                if (stream, tuple(value)) not in self._heard.said:
                    self.false.append(f"{stream} {value}")


def session(seed: int) -> dict[str, Any]:
    """Fly one; how it ended, and what must never be (`problems`, empty)."""
    platform = load_platform("cubesat")
    setup: HardwareSetup = read_hardware(platform)
    faults = drawn(seed)
    emulation = Here(platform, setup, seed=seed, faults=faults)
    problems: list[str] = []
    told: list[str] = []
    again: list[str] = []
    ended, reason, damaged, heard = "refused", "", 0, None
    undetected = 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "session.rrd" if seed % RECORDED == 0 else None
        try:
            with Bench(platform, setup, held=Held.floating, emulation=emulation) as bench:
                heard = emulation.heard
                checked = Checked(heard)
                streams = platform.commands if seed % TRIED == 0 else ()
                clock = armed(bench, streams, told.append) if streams else bench.begin()
                law, estimator = load_controller("mass_magnetic_pid"), load_estimator("filter")
                observers: list[Observer] = [checked]
                with ExitStack() as stack:
                    if file is not None:
                        recorder = stack.enter_context(FileRecorder(file))
                        recorder.start(platform, provenance(platform, seed=seed, command=[]))
                        observers.append(recorder)
                    outcome = fly(
                        bench, estimator, law, Hold(), clock, duration=LONG, observers=observers
                    )
                ended, reason = outcome.ended.value, outcome.reason
                if checked.ticks != outcome.timing.ticks:
                    problems.append(f"{checked.ticks} of {outcome.timing.ticks} ticks were kept")
                problems += [f"believed: {value}" for value in checked.false]
                undetected = len(checked.false)
                counters = bench.hardware.counters["feather"]
                damaged = counters.bad_checksums + counters.resyncs
                told = bench.messages()
                again = _again(bench) if ended == "safe_stop" else []
            if file is not None:
                problems += _missing(file, checked)
        except TwinError as refusal:
            ended, reason = "refused", str(refusal)
        if heard is not None:
            problems += [f"told: {value}" for value in dict.fromkeys(heard.outside)]
    if ended == "done":
        lines = [line for line in told if "none wrong" not in line and "set-points" not in line]
        ended, reason = ("degraded", "; ".join(lines)) if lines else ("continued", "")
    if ended in ("safe_stop", "refused", "degraded", "failed") and not reason:
        problems.append(f"{ended} without a reason")
    return {
        "machine": "cubesat",
        "seed": seed,
        "faults": [f"{fault.kind} {fault.start:.2f}" for fault in faults],
        "ended": ended,
        "reason": _anywhere(reason),
        "again": [_anywhere(item) for item in again],
        "damaged": damaged,
        "undetected": undetected,
        "problems": problems,
    }


def _again(bench: Bench) -> list[str]:
    """Connect and arm anew, twice, after all faults are over; what came of each."""
    came: list[str] = []
    for _ in range(2):
        try:
            bench.hardware.close()
            bench._host.sleep(2.0)  # pyright: ignore[reportPrivateUsage]
            bench.hardware.connect()
            bench.begin()
            came.append("armed")
        except TwinError as refusal:
            came.append(str(refusal))
        bench.guard.disarm()
    return came


def _missing(file: Path, checked: Checked) -> list[str]:
    """Streams of which the file has other rows than the loop has seen."""
    log = open_log(file)
    return [
        f"recorded {len(log[stream].time)} of {count} rows of {stream}"
        for stream, count in checked.rows.items()
        if len(log[stream].time) != count
    ]


def _anywhere(sentence: str) -> str:
    """Without the folder in which the port happened to lie."""
    return re.sub(r"/\S*twin-\w+/", "", sentence)
