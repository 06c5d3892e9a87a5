"""Several machines in one run: one clock, a radio between them, a law each, one recording."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.clock import SimulatedClock, WallClock
from twin.controller import AnyController
from twin.effects import Effect, parse_effects
from twin.errors import UnknownName, UsageError
from twin.files import check_writable
from twin.flight import Flight, Run, plant_words, prepare
from twin.loop import Ended, FlightProgress, Member, Observer, fly_together
from twin.manoeuvre import TorqueProfile
from twin.metrics import Metrics, begun, settled
from twin.plant.initial import InitialState
from twin.platform import Platform, load_platform
from twin.platform.mjcf import load_mjcf
from twin.radio import Airwaves, Radio, Station, parse_radio
from twin.recording.rrd_reader import MACHINES, SCHEMA
from twin.reference import Reference
from twin.rotation import from_euler_zyx
from twin.shown import Shown
from twin.signals import TOWARDS, Tick
from twin.stream.provenance import provenance
from twin.stream.recorder import FlightRecorder, MemoryRecorder, Recorded
from twin.stream.rows import Placed

Array = NDArray[np.float64]
Triple = tuple[float, float, float]
Say = Callable[[str], None]

RESERVED = ("world", "plots", "provenance")
"""Trees of a recording that are no machine's."""
SPACING = 1.2
"""Between the middles of two machines that stand side by side, in parts of their mean size."""


@dataclass(frozen=True, kw_only=True)
class Seat:
    """What one machine of a run flies with; SI and radians, as the arguments of `twin.fly`."""

    controller: str | Path | AnyController = "free_float"
    gains: Mapping[str, float] | None = None
    reference: str | Reference | None = None
    torque: str | TorqueProfile | None = None
    estimator: str | None = None
    effects: str | Sequence[Effect] = ()
    attitude: Triple = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw at the start [rad]."""
    rate: Triple = (0.0, 0.0, 0.0)
    """Body rates at the start [rad/s]."""
    velocity: Triple = (0.0, 0.0, 0.0)
    """At the start, of a machine that travels [m/s]."""
    origin: Triple | None = None
    """Where the zero of its place is in the room that all share [m]; None: beside the others."""
    hears: Sequence[str] | None = None
    """Whom it hears by radio; None: all."""


SETTINGS = tuple(entry.name for entry in fields(Seat))


@dataclass(frozen=True)
class FormationRun(Shown):
    """A flight of several machines that is over."""

    runs: Mapping[str, Run]
    """Of each machine, by its name."""
    radio: Radio
    relative: Mapping[tuple[str, str], Mapping[str, float]]
    """Of each pair: rms and largest attitude to each other [rad] and distance [m], where both have
    a place, from `Run.settle` on."""

    @property
    def ended(self) -> str:
        """done, degraded, safe_stop or failed: the worst of the machines."""
        order = [Ended.failed, Ended.safe_stop, Ended.degraded, Ended.done]
        return min((run.outcome.ended for run in self.runs.values()), key=order.index).value

    def document(self) -> Mapping[str, Any]:
        """What `twin run --json` prints; SI."""
        return {
            "ended": self.ended,
            "machines": {name: run.document() for name, run in self.runs.items()},
            "radio": self.radio.document(),
            "relative": [{"of": list(pair), **row} for pair, row in self.relative.items()],
        }


def fly_formation(
    machines: Sequence[str | Path | Platform] | Mapping[str, str | Path | Platform],
    controller: str | Path | AnyController = "free_float",
    *,
    radio: str | Radio = "",
    each: Mapping[str, Mapping[str, Any]] | None = None,
    gains: Mapping[str, float] | None = None,
    reference: str | Reference | None = None,
    estimator: str | None = None,
    duration: float | None = None,
    realtime: bool = False,
    seed: int = 0,
    rrd: str | Path | None = None,
    viewer: bool = False,
    keep: bool = True,
    say: Say = lambda line: None,
) -> FormationRun:
    """Fly several simulated machines in one run, each under a law of its settings.

    Each law sees its own machine, and the others by radio (`Estimate.received`). With the radio cut
    each flies to the same bits as alone, machine number k with the seed `seed` + k.

    Args:
        machines: by name, or as a list, each then called as its platform is.
        controller: the law of all, by its name, a file, or itself; what `each` says differs.
        radio: between them: `delay=0.2,loss=0.05,rate=10`, `off`, or itself; all that is estimated,
            at each tick and at once, unless given.
        each: for a machine by its name what differs for it, the fields of `Seat` by theirs.
        gains: of the law.
        reference: of all; None: what each law is usually given.
        estimator: of all; None: each machine's usual one.
        duration: [s]; None: 60, or to the end of the longest table that states a reference.
        realtime: keep to the wall's clock.
        seed: of all random numbers.
        rrd: record into this file, which has a tree for each machine: `twin.read("two.rrd#whorl1")`
            reads one.
        viewer: show it live in the Rerun viewer.
        keep: hold all streams in memory for `Run.recording`; else they are read from `rrd`.
        say: takes what is flown, warnings, and what is said in flight.

    Raises:
        TwinError: names that are not known or given twice, parts that do not fit together, a file
            that is wrong or may not be written, a law that fails.
    """
    platforms = _named(machines)
    common = Seat(controller=controller, gains=gains, reference=reference, estimator=estimator)
    seats = _seats(platforms, common, each or {})
    path = None if rrd is None else Path(rrd)
    if path is not None:
        check_writable(path, ".rrd")
    with ExitStack() as stack:
        recording = None
        if path is not None or viewer:
            recording = stack.enter_context(Recorded(path, viewer=viewer))
        flights = {
            name: _prepared(platform, seats[name], seed + number, duration)
            for number, (name, platform) in enumerate(platforms.items())
        }
        longest = max(flight.duration for flight in flights.values())
        flights = {name: replace(f, duration=longest) for name, f in flights.items()}
        stations = _stations(flights, seats)
        link = _linked(radio, seats)
        air = Airwaves(link, list(stations.values()), (0,), seed)
        warnings = {name: tuple(flight.warnings()) for name, flight in flights.items()}
        _announce(flights, seats, warnings, link, seed, say)
        facts = {
            name: provenance(flight.platform, seed=seed + number)
            | {"origin": list(stations[name].origin)}
            for number, (name, flight) in enumerate(flights.items())
        }
        shared = {"radio": link.document()}
        settle = settled(longest)
        watchers = {
            name: _Watchers(flight, stations[name], facts[name] | shared, settle, keep)
            for name, flight in flights.items()
        }
        every: dict[str, list[Observer]] = {name: w.all() for name, w in watchers.items()}
        every[next(iter(every))].append(FlightProgress(longest))
        if recording is not None:
            placed = {n: Placed(flights[n].platform, s.origin) for n, s in stations.items()}
            provenance_of_all = {"schema": SCHEMA, "kind": "run", **shared, MACHINES: facts}
            trees = recording.recorder.start_several(placed, provenance_of_all)
            for name, observer in trees.items():
                every[name].append(observer)
        for flight in flights.values():
            stack.callback(flight.controller.close)
            stack.enter_context(flight.plant)
        members = [
            Member(f.plant, f.estimator, f.controller, f.reference, every[name], stations[name])
            for name, f in flights.items()
        ]
        clock = WallClock() if realtime else SimulatedClock()
        outcomes = fly_together(members, clock, duration=longest, air=air)
    if recording is not None and recording.problem is not None:
        raise recording.problem
    runs = {
        name: watchers[name].run(
            flights[name],
            outcome,
            warnings[name],
            None if path is None else path.with_name(f"{path.name}#{name}"),
        )
        for name, outcome in zip(flights, outcomes, strict=True)
    }
    pairs = {
        (name, other): row
        for number, (name, w) in enumerate(watchers.items())
        for other in list(watchers)[:number]
        if (row := w.relative.row(other))
    }
    return FormationRun(runs, link, pairs)


def _named(
    machines: Sequence[str | Path | Platform] | Mapping[str, str | Path | Platform],
) -> dict[str, Platform]:
    """The machines by the names that the others know them by."""
    if isinstance(machines, Mapping):
        given = [(name, item) for name, item in machines.items()]
    else:
        given = [("", item) for item in machines]
    platforms: dict[str, Platform] = {}
    for name, item in given:
        platform = item if isinstance(item, Platform) else load_platform(str(item))
        called = name or platform.name
        if called in platforms:
            raise UsageError(
                f"two machines are called {called!r}: name each, as in a={called} b={called}"
            )
        if called in RESERVED or not called or set(called) & set("=,#/ "):
            raise UsageError(
                f"a machine cannot be called {called!r}: give a name without = , # / and spaces "
                f"that is not one of {', '.join(RESERVED)}"
            )
        if platform.base.kind == "hinge":
            raise UsageError(
                f"{platform.name} turns about one axis, and machines of a run of several turn "
                "about three; fly it alone"
            )
        platforms[called] = platform
    if len(platforms) < 2:
        raise UsageError("a run of several machines has two or more")
    return platforms


def _seats(
    platforms: Mapping[str, Platform], common: Seat, each: Mapping[str, Mapping[str, Any]]
) -> dict[str, Seat]:
    for name, settings in each.items():
        if name not in platforms:
            raise UnknownName("machine", name, platforms)
        for key in settings:
            if key not in SETTINGS:
                raise UnknownName("setting of a machine", key, SETTINGS)
    seats: dict[str, Seat] = {}
    for name in platforms:
        settings = dict(each.get(name, {}))
        if settings.get("torque") is not None:
            settings = {"controller": "free_float", "gains": None, **settings}
        elif "controller" in settings:  # the common gains are those of the common law
            settings = {"gains": None, **settings}
        seats[name] = replace(common, **settings)
    return seats


def _prepared(platform: Platform, seat: Seat, seed: int, duration: float | None) -> Flight:
    if isinstance(seat.controller, str) and "://" in seat.controller:
        raise UsageError(
            f"{seat.controller}: a law in another program is not told what the radio brings; name "
            "a shipped law or a file"
        )
    roll, pitch, yaw = seat.attitude
    effects = parse_effects(seat.effects) if isinstance(seat.effects, str) else seat.effects
    return prepare(
        platform,
        controller=str(seat.controller) if isinstance(seat.controller, Path) else seat.controller,
        torque=seat.torque,
        estimator=seat.estimator,
        plant="sim",
        reference=seat.reference,
        duration=duration,
        seed=seed,
        initial=InitialState(
            attitude=from_euler_zyx(np.array(yaw), np.array(pitch), np.array(roll)),
            rate_body=np.array(seat.rate),
            velocity=np.array(seat.velocity),
        ),
        gains=seat.gains,
        effects=effects,
    )


def _stations(flights: Mapping[str, Flight], seats: Mapping[str, Seat]) -> dict[str, Station]:
    """Each machine in the common room; without a stated place beside the one before, along y."""
    stations: dict[str, Station] = {}
    y = before = 0.0
    for name, flight in flights.items():
        platform = flight.platform
        extent = float(load_mjcf(platform.model_path).stat.extent)
        y += 0.5 * SPACING * (before + extent) if stations else 0.0
        before = extent
        origin = seats[name].origin or (0.0, round(y, 2), 0.0)
        stations[name] = Station(name, platform.base.travels, origin)
    return stations


def _linked(radio: str | Radio, seats: Mapping[str, Seat]) -> Radio:
    link = radio if isinstance(radio, Radio) else parse_radio(radio) if radio else Radio()
    hears = {name: tuple(s.hears) for name, s in seats.items() if s.hears is not None}
    return replace(link, hears={**link.hears, **hears}) if hears else link


def _announce(
    flights: Mapping[str, Flight],
    seats: Mapping[str, Seat],
    warnings: Mapping[str, Sequence[str]],
    link: Radio,
    seed: int,
    say: Say,
) -> None:
    for number, (name, flight) in enumerate(flights.items()):
        seat = seats[name]
        what = flight.words(seat.torque or seat.controller, seat.estimator, seat.reference)
        lines = [f"{what}, {plant_words('sim', seed + number, None)}"]
        lines += flight.remarks(warnings[name])
        say(
            "\n".join(line if name == flight.platform.name else f"{name}: {line}" for line in lines)
        )
    say(link.words())


class _Watchers:
    """Observers of one machine."""

    def __init__(
        self,
        flight: Flight,
        station: Station,
        facts: Mapping[str, Any],
        settle: float,
        keep: bool,
    ) -> None:
        self._metrics = Metrics(flight.platform, settle=settle)
        self._last = FlightRecorder(flight.plant)
        self.relative = RelativeMotion(settle)
        named = {**facts, "name": station.name}
        self._memory = MemoryRecorder(flight.platform, named) if keep else None

    def all(self) -> list[Observer]:
        observers: list[Observer] = [self._metrics, self._last, self.relative]
        return observers if self._memory is None else [*observers, self._memory]

    def run(
        self, flight: Flight, outcome: Any, warnings: tuple[str, ...], path: Path | None
    ) -> Run:
        rows = self._metrics.rows().items()
        return Run(
            flight.platform,
            path if self._memory is None else self._memory.recording(),
            outcome,
            {name: value[0] for name, value in rows if np.ndim(value)},
            self._metrics.settle,
            warnings,
            (),
            self._last.records,
            forecast=flight.forecast(),
        )


@dataclass
class RelativeMotion:
    """Observer of a machine of several: its attitude and distance to each other one.

    Of the true motion where the plant knows it, else of the estimated one.
    """

    settle: float
    """It counts from here on [s]."""
    _angles: dict[str, list[float]] = field(default_factory=dict[str, list[float]], repr=False)
    _distances: dict[str, list[float]] = field(default_factory=dict[str, list[float]], repr=False)

    def collect(self, tick: Tick) -> None:
        """One tick; of a batch the first run."""
        if not begun(tick.reading.time, self.settle):
            return
        for name, samples in tick.relative.items():
            if not samples.valid[0, -1]:
                continue
            stream, _, other = name.removeprefix("truth_").partition(TOWARDS)
            value = samples.value[0, -1]
            true = f"truth_{stream}{TOWARDS}{other}" in tick.relative
            if true and not name.startswith("truth_"):
                continue
            if stream == "relative_attitude":
                sine = min(float(np.linalg.norm(value[1:])), 1.0)
                self._angles.setdefault(other, []).append(2.0 * math.asin(sine))
            elif stream == "relative_position":
                self._distances.setdefault(other, []).append(float(np.linalg.norm(value)))

    def row(self, other: str) -> dict[str, float]:
        """Of that machine; empty where nothing was seen."""
        row: dict[str, float] = {}
        if angles := self._angles.get(other):
            row["attitude_rms_rad"] = float(np.sqrt(np.mean(np.square(angles))))
            row["attitude_max_rad"] = max(angles)
        if distances := self._distances.get(other):
            row["distance_min_m"] = min(distances)
            row["distance_max_m"] = max(distances)
        return row
