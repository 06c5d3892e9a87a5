"""The one loop: read, estimate, control, write, record.

It cannot tell whether the plant is simulated, replayed, emulated or real, nor how many runs the
batch holds. Several machines go round it together, on one clock, with a radio between them.
"""

import logging
import math
import signal
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from fractions import Fraction
from functools import reduce
from typing import Protocol

import numpy as np

from twin import stop
from twin.clock import Clock, Timing
from twin.controller import AnyController
from twin.controller.load import tell_mistake, tell_refused
from twin.errors import CommandError, TwinError, UnknownName, UsageError
from twin.estimators.estimator import Estimator
from twin.estimators.place import PlaceFilter
from twin.plant.plant import Plant
from twin.radio import Airwaves, Station, as_estimated, as_true
from twin.reference import Reference
from twin.signals import Command, Estimate, Quantity, Samples, Target, Tick
from twin.units import span

_LOGGER = logging.getLogger(__name__)


class Ended(Enum):
    """How a run came to its end; the value is the word that goes into JSON."""

    done = "done"
    """The whole duration, or until the controller had finished with every run."""
    degraded = "degraded"
    """The whole duration, but some runs of the batch were stopped."""
    safe_stop = "safe_stop"
    """Asked to stop by a signal, its law was lost, or the machine was brought to its safe state."""
    failed = "failed"
    """No run is left."""


class Observer(Protocol):
    """Sees every tick: a recorder, a flight recorder, metrics. It must not change what it sees."""

    def collect(self, tick: Tick) -> None:
        """One tick."""
        ...


class FlightProgress:
    """Observer that logs how far a flight is and how long the rest takes, twice a second.

    The log is that of this module, at level INFO.
    """

    PERIOD = 0.5
    """Between two lines [s of the wall]."""

    def __init__(self, duration: float, *, may_end_early: bool = False) -> None:
        """Nothing is logged yet.

        Args:
            duration: of the flight [s].
            may_end_early: it may end before.
        """
        self._duration, self._most = duration, "at most " if may_end_early else ""
        self._began = self._logged = time.monotonic()

    def collect(self, tick: Tick) -> None:
        """One tick."""
        now = time.monotonic()
        if now - self._logged < self.PERIOD or not tick.reading.time > 0.0:
            return
        self._logged = now
        flown = tick.reading.time
        left = (now - self._began) * max(self._duration - flown, 0.0) / flown
        _LOGGER.info(
            "%.0f of %s%g s flown, %s%s left",
            *(flown, self._most, self._duration, self._most, span(left)),
        )


@dataclass(frozen=True)
class Outcome:
    """How a loop ended."""

    ended: Ended
    reason: str
    """A sentence; empty when all went to its end."""
    duration: float
    """Time of the last tick [s]."""
    stopped: dict[int, str]
    """Runs that ended early: row -> reason."""
    timing: Timing
    asked: int = 0
    """Number of the signal by which its operator stopped it, an end as good as any; 0: nobody."""
    remarks: tuple[str, ...] = ()
    """What the estimator could not use, or nobody saw; a sentence each."""
    quantities: Mapping[str, Quantity] = field(default_factory=dict[str, Quantity])
    """What the estimator states in the end with its sigma, by name; empty if it never was valid."""


@dataclass(frozen=True)
class Member:
    """A machine in the loop, and what flies it."""

    plant: Plant
    estimator: Estimator
    controller: AnyController
    reference: Reference
    observers: Sequence[Observer] = ()
    station: Station = field(default_factory=lambda: Station("machine"))
    """As the other machines of the run know it."""


def fly(
    plant: Plant,
    estimator: Estimator,
    controller: AnyController,
    reference: Reference,
    clock: Clock,
    *,
    duration: float,
    observers: Sequence[Observer] = (),
) -> Outcome:
    """Run the loop for `duration` [s]; the caller owns plant and observers and closes them.

    A request to stop (`twin.stop`) ends it after the tick in hand, so that no row is half written.

    Raises:
        ControllerError: the law is of somebody's file, and something in it raises or the machine
            refuses its command.
        TwinError: a device, or a recorder, failed. Each has the outcome until then with it.
    """
    member = Member(plant, estimator, controller, reference, observers)
    return fly_together([member], clock, duration=duration)[0]


def fly_together(
    members: Sequence[Member],
    clock: Clock,
    *,
    duration: float,
    air: Airwaves | None = None,
) -> list[Outcome]:
    """Run the loop for several machines on one clock, `duration` [s]; raises as `fly`.

    Each machine has its ticks where it has them alone. At a tick all that have one are read first,
    then each sends what it knows and receives what has come, then all are commanded: without a
    delay each law sees what the others know at the same instant. The run ends for all as soon as it
    ends for one that has not merely finished.

    Args:
        members: the machines, with as many runs each.
        clock: of all of them.
        duration: [s].
        air: the radio between them; None: they know nothing of each other.

    Returns:
        The outcome of each machine.
    """
    period, every = common_period([member.plant.platform.control_rate for member in members])
    try:
        return _fly(members, clock, duration, air, period, every)
    except TwinError as problem:
        timing = clock.timing
        now = max(timing.ticks - 1 + timing.overruns, 0) * period
        stopped = dict(members[0].plant.stopped) if len(members) == 1 else {}
        problem.outcome = Outcome(Ended.failed, str(problem), now, stopped, timing)
        raise


FASTEST = 1e4
"""Of the clock that has the ticks of all machines of a run among its own [Hz]."""


def common_period(rates: Sequence[float]) -> tuple[float, list[int]]:
    """Period of the slowest clock that ticks with every machine [s], and its ticks in each of
    theirs, of control rates [Hz].

    Raises:
        UsageError: the rates have no common multiple below `FASTEST`.
    """
    if len(set(rates)) == 1:
        return 1.0 / rates[0], [1] * len(rates)
    shares = [Fraction(rate).limit_denominator(1000) for rate in rates]
    common = reduce(
        lambda a, b: Fraction(
            math.lcm(a.numerator, b.numerator), math.gcd(a.denominator, b.denominator)
        ),
        shares,
    )
    if common > FASTEST:
        listed = ", ".join(f"{rate:g}" for rate in rates)
        raise UsageError(
            f"control rates of {listed} Hz have no common clock below {FASTEST:g} Hz; state rates "
            "in whole ratios ([simulation] control_rate)"
        )
    return 1.0 / float(common), [int(common / share) for share in shares]


def _fly(
    members: Sequence[Member],
    clock: Clock,
    duration: float,
    air: Airwaves | None,
    period: float,
    every: Sequence[int],
) -> list[Outcome]:
    cycles = [_Cycle(member, clock, ticks) for member, ticks in zip(members, every, strict=True)]
    now, asked = 0.0, 0
    with stop.listening():
        for now in clock.ticks(period, duration):
            due = cycles if len(cycles) == 1 else [c for c in cycles if c.due(round(now / period))]
            try:
                for cycle in due:
                    cycle.sense(now)
                if air is not None:
                    _exchange(air, due)
                for cycle in due:
                    cycle.act()
            except stop.Stopped as request:  # a procedure waited for a fit
                asked = request.number
                break
            if len(due) > 1:
                _relate(due)
            for cycle in due:
                cycle.record()
            if any([cycle.ends() for cycle in due]) or all(cycle.finished() for cycle in cycles):
                break
            asked = stop.requested() or 0
            if asked:
                break
    halted = f"{_by(asked)} at {now:.2f} s" if asked else ""
    culprits = [cycle for cycle in cycles if cycle.ended is not Ended.done]
    if culprits and not halted and len(cycles) > 1:
        halted = f"the run ended with {culprits[0].member.station.name}: {culprits[0].reason}"
    return [cycle.outcome(asked, halted) for cycle in cycles]


def _exchange(air: Airwaves, due: "Sequence[_Cycle]") -> None:
    """Each machine sends what it knows, then each receives what has come by now."""
    for cycle in due:
        cycle.send(air)
    for cycle in due:
        cycle.receive(air)


def _relate(due: "Sequence[_Cycle]") -> None:
    """True states relative to each other, where they are recorded."""
    truths = {cycle.member.station: cycle.true() for cycle in due if cycle.member.observers}
    for cycle in due:
        station = cycle.member.station
        others = {other: truth for other, truth in truths.items() if other != station}
        cycle.relative = as_true(station, truths[station], others) if station in truths else {}


class _Cycle:
    """One machine from tick to tick: read, estimate, control, write, record."""

    def __init__(self, member: Member, clock: Clock, every: int) -> None:
        """Before its first tick; it has one at each `every`th of the clock's."""
        self.member = member
        plant = member.plant
        platform, n = plant.platform, plant.n
        self.ended, self.reason = Ended.done, ""
        self.relative: Mapping[str, Samples] = {}
        self._clock = clock
        self._every, self._last = every, -1
        self._estimate = member.estimator.init(platform, n)
        travels = self._estimate.position is None
        self._place = PlaceFilter.of(platform, n) if travels else None
        self._state = member.controller.init(platform, n)
        self._targets = _Ahead(member.reference, platform.tick)
        self._now = 0.0
        self._truth: Mapping[str, Samples] | None = None

    def due(self, number: int) -> bool:
        """Whether it has a tick at this one of the clock, or had one that the clock skipped."""
        count, before = number // self._every, self._last
        self._last = count
        return count > before

    def sense(self, tick_time: float) -> None:
        """Read and estimate; of several machines the tick is where it would be alone."""
        member = self.member
        self.relative = {}
        self._now = tick_time if self._last < 0 else self._last * member.plant.platform.tick
        self._reading = member.plant.read(self._now)
        self._clock.lap("read")
        self._estimate = member.estimator.update(self._estimate, self._reading)
        if self._place is not None:
            self._estimate = self._place.located(self._estimate, self._reading)
        self._clock.lap("estimate")

    def send(self, air: Airwaves) -> None:
        """Say what it knows, if it is time."""
        name = self.member.station.name
        if air.due(name, self._now):
            extra = self.member.controller.message(self._state, self._estimate, self._now)
            air.send(name, self._now, self._estimate, extra)

    def receive(self, air: Airwaves) -> None:
        """Hear what has come by now."""
        received = air.received(self.member.station.name, self._now)
        self._estimate = replace(self._estimate, received=received)
        self._clock.lap("estimate")

    def act(self) -> None:
        """Control and write."""
        member, now = self.member, self._now
        plant, platform, estimate = member.plant, member.plant.platform, self._estimate
        self._target = self._targets.at(now)
        try:
            wanted, self._state = member.controller.update(self._state, estimate, self._target, now)
        except stop.Stopped:
            raise
        except (Exception, SystemExit) as problem:
            tell_mistake(member.controller, platform, problem)
            raise
        if estimate.awaited:
            wanted = _hold_unmeasured(wanted, estimate, plant)
        self._clock.lap("control")
        try:
            applied = plant.write(wanted)
        except (CommandError, UnknownName) as problem:
            tell_refused(member.controller, platform, problem)
            raise
        self._estimate = member.estimator.with_command(estimate, applied)
        if self._place is not None:
            self._place.command(self._estimate.attitude, applied)
        self._wanted, self._applied, self._truth = wanted, applied, None
        self._clock.lap("write")

    def true(self) -> Mapping[str, Samples]:
        """The plant's true states at this tick."""
        if self._truth is None:
            self._truth = self.member.plant.truth()
        return self._truth

    def record(self) -> None:
        """Let the observers see the tick."""
        if not self.member.observers:
            return
        relative = self.relative
        if self._estimate.received:
            relative = {**as_estimated(self._estimate), **relative}
        tick = Tick(
            self._reading,
            self._estimate,
            self._target,
            self._wanted,
            self._applied,
            self.true(),
            self._clock.cycle(),
            relative,
        )
        for observer in self.member.observers:
            observer.collect(tick)
        self._clock.lap("record")

    def ends(self) -> bool:
        """Whether the run cannot go on, which `ended` and `reason` then say."""
        plant = self.member.plant
        if plant.safe_reason:
            self.ended, self.reason = Ended.safe_stop, plant.safe_reason
        elif len(plant.stopped) == plant.n:
            self.ended, self.reason = Ended.failed, next(iter(plant.stopped.values()))
        elif reason := self.member.controller.lost(self._state):
            self.ended, self.reason = Ended.safe_stop, reason
        return self.ended is not Ended.done

    def finished(self) -> bool:
        """Whether its law needs no more ticks in any run."""
        done, plant = self.member.controller.finished(self._state), self.member.plant
        return done is not None and all(done[run] or run in plant.stopped for run in range(plant.n))

    def outcome(self, signal: int, halted: str) -> Outcome:
        """How it ended; `halted` says why, where nothing of its own ended it."""
        plant, estimate, estimator = self.member.plant, self._estimate, self.member.estimator
        ended, reason = self.ended, self.reason
        if signal or (halted and ended is Ended.done):
            ended, reason = Ended.safe_stop, halted
        if ended is Ended.done and plant.stopped:
            ended = Ended.degraded
            reason = f"{len(plant.stopped)} of {plant.n} runs were stopped"
        remarks = tuple(estimator.remarks(estimate))
        stated = estimate.quantities() if estimate.valid.any() else {}
        return Outcome(
            ended,
            reason,
            self._now,
            dict(plant.stopped),
            self._clock.timing,
            signal,
            remarks,
            stated,
        )


def _by(number: int) -> str:
    """By whom it was stopped: at a terminal it is the operator."""
    if number == signal.SIGINT:
        return "stopped by the operator"
    return f"stopped by {stop.name_of(number)}"


def _hold_unmeasured(wanted: Command, estimate: Estimate, plant: Plant) -> Command:
    """Stages that nobody has seen stay; laws take them to stand at 0, and would send them there."""
    unseen, move = estimate.awaited.get("stage_position"), "command_stage_position"
    if unseen is None or move not in wanted:
        return wanted
    # told to stay, and not left out where all are unseen: a run has the same bits in any company
    held = plant.write({})[move]
    stay = unseen & ~estimate.valid
    return {**wanted, move: np.where(stay[:, None], held, wanted[move])}


class _Ahead:
    """Targets computed for many ticks at once: a reference costs more than the rest of a tick."""

    _TICKS = 512

    def __init__(self, reference: Reference, tick: float) -> None:
        self._reference = reference
        self._tick = tick
        self._first = 0
        self._block: Target | None = None

    def at(self, time: float) -> Target:
        number = round(time / self._tick)
        if self._block is None or not 0 <= number - self._first < self._TICKS:
            self._first = number
            numbers = np.arange(number, number + self._TICKS, dtype=np.float64)
            self._block = self._reference.at(numbers * self._tick)
        row, block = number - self._first, self._block
        if block.position is None or block.velocity is None or block.acceleration is None:
            return Target(block.attitude[row], block.rate_body[row], block.acceleration_body[row])
        return Target(
            block.attitude[row],
            block.rate_body[row],
            block.acceleration_body[row],
            block.position[row],
            block.velocity[row],
            block.acceleration[row],
        )
