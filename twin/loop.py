"""The one loop: read, estimate, control, write, record.

It cannot tell whether the plant is simulated, replayed, emulated or real, nor how many runs the
batch holds.
"""

import logging
import signal
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

import numpy as np

from twin import stop
from twin.clock import Clock, Timing
from twin.controller import AnyController
from twin.controller.load import tell_mistake, tell_refused
from twin.errors import CommandError, TwinError, UnknownName
from twin.estimators.estimator import Estimator
from twin.estimators.place import PlaceFilter
from twin.plant.plant import Plant
from twin.reference import Reference
from twin.signals import Command, Estimate, Quantity, Target, Tick
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

    def __init__(self, duration: float, *, at_most: bool = False) -> None:
        """Nothing is logged yet.

        Args:
            duration: of the flight [s].
            at_most: it may end before.
        """
        self._duration, self._most = duration, "at most " if at_most else ""
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
    try:
        return _fly(plant, estimator, controller, reference, clock, duration, observers)
    except TwinError as problem:
        timing = clock.timing
        now = max(timing.ticks - 1 + timing.overruns, 0) * plant.platform.tick
        problem.outcome = Outcome(Ended.failed, str(problem), now, dict(plant.stopped), timing)
        raise


def _fly(
    plant: Plant,
    estimator: Estimator,
    controller: AnyController,
    reference: Reference,
    clock: Clock,
    duration: float,
    observers: Sequence[Observer],
) -> Outcome:
    platform, n = plant.platform, plant.n
    runs = range(n)
    estimate = estimator.init(platform, n)
    place = PlaceFilter.of(platform, n) if estimate.position is None else None
    state = controller.init(platform, n)
    targets = _Ahead(reference, platform.tick)
    now, reason, ended, asked = 0.0, "", Ended.done, 0
    with stop.listening():
        for now in clock.ticks(platform.tick, duration):
            reading = plant.read(now)
            clock.lap("read")
            estimate = estimator.update(estimate, reading)
            if place is not None:
                estimate = place.located(estimate, reading)
            clock.lap("estimate")
            target = targets.at(now)
            try:
                wanted, state = controller.update(state, estimate, target, now)
            except stop.Stopped as request:  # a procedure waited for a fit
                asked = request.number
                break
            except (Exception, SystemExit) as problem:
                tell_mistake(controller, platform, problem)
                raise
            if estimate.awaited:
                wanted = _where_seen(wanted, estimate, plant)
            clock.lap("control")
            try:
                applied = plant.write(wanted)
            except (CommandError, UnknownName) as problem:
                tell_refused(controller, platform, problem)
                raise
            estimate = estimator.told(estimate, applied)
            if place is not None:
                place.command(estimate.attitude, applied)
            clock.lap("write")
            if observers:
                truth, cycle = plant.truth(), clock.cycle()
                tick = Tick(reading, estimate, target, wanted, applied, truth, cycle)
                for observer in observers:
                    observer.collect(tick)
                clock.lap("record")
            if plant.safe_reason:
                ended, reason = Ended.safe_stop, plant.safe_reason
                break
            if len(plant.stopped) == n:
                ended = Ended.failed
                reason = next(iter(plant.stopped.values()))
                break
            reason = controller.lost(state)
            if reason:
                ended = Ended.safe_stop
                break
            finished = controller.finished(state)
            if finished is not None and all(finished[run] or run in plant.stopped for run in runs):
                break
            asked = stop.requested() or 0
            if asked:
                break
    if asked:
        ended, reason = Ended.safe_stop, f"{_by(asked)} at {now:.2f} s"
    if ended is Ended.done and plant.stopped:
        ended = Ended.degraded
        reason = f"{len(plant.stopped)} of {n} runs were stopped"
    remarks = tuple(estimator.remarks(estimate))
    stated = estimate.quantities() if estimate.valid.any() else {}
    return Outcome(ended, reason, now, dict(plant.stopped), clock.timing, asked, remarks, stated)


def _by(number: int) -> str:
    """By whom it was stopped: at a terminal it is the operator."""
    if number == signal.SIGINT:
        return "stopped by the operator"
    return f"stopped by {stop.name_of(number)}"


def _where_seen(wanted: Command, estimate: Estimate, plant: Plant) -> Command:
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
