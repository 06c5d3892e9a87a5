"""A run put together from names: platform, law, estimator, plant and reference; checked, flown."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from twin.budget import (
    GyroBudget,
    MomentumBudget,
    constant_gyros,
    gyro_budget,
    momentum_budget,
)
from twin.clock import Clock, Timing, check_duration
from twin.controller import AnyController, Controller, OpenLoop, load_controller
from twin.controller.exchange import Gyros
from twin.controller.load import tell_mistake
from twin.controller.thrusters import Wrenches
from twin.drives import travelling_mass
from twin.effects import Effect, effects_of, with_effects
from twin.errors import ControllerError, TwinError, UnknownName, UsageError
from twin.estimators import (
    Estimator,
    InclinometerDifferences,
    Passthrough,
    heading_sigma,
    load_estimator,
    name_of,
    usual_estimator,
)
from twin.loop import Ended, FlightProgress, Observer, Outcome, fly
from twin.manoeuvre import TorqueProfile, parse_torque
from twin.plant.initial import InitialState
from twin.plant.plant import Plant
from twin.plant.replayed import ReplayedPlant
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.recording import Recording, open_log
from twin.reference import Reference, Tabulated, parse_reference
from twin.rotation import IDENTITY, from_rotation_vector, multiply, to_euler_zyx
from twin.shown import Shown
from twin.signals import Command, Target
from twin.stop import Stopped

if TYPE_CHECKING:
    from twin.bench import Bench
    from twin.plant.guard.guarded import Held

PLANTS = ("sim", "replay:LOG", "pty", "pty:FILE.toml", "serial:URL")

_TURNING = {
    "command_dipole",
    "command_gimbal_rate",
    "command_thruster",
    "command_wheel_torque",
}
"""What turns a body about the vertical; masses do not."""
_LEVEL = 1e-6
"""Yaw that is none [rad]."""
_TURN = 1e-3
"""By which a law is asked what torque holds the body [rad]."""


@dataclass(frozen=True)
class Flight:
    """Everything one call of the loop needs."""

    plant: Plant
    estimator: Estimator
    controller: AnyController
    reference: Reference
    duration: float
    """[s]."""
    initial: InitialState = field(default_factory=InitialState)
    """Of a simulated plant."""
    bench: "Bench | None" = None
    """The plant, where it is a machine on its bench or its emulation."""

    @property
    def platform(self) -> Platform:
        """The machine."""
        return self.plant.platform

    @property
    def effects(self) -> tuple[Effect, ...]:
        """What a simulated machine has beyond its parts; nothing of a log or a real machine."""
        simulated = self.plant if self.bench is None else self.bench.emulation
        real = simulated is None or isinstance(simulated, ReplayedPlant)
        return () if real else effects_of(self.platform)

    def words(
        self,
        controller: str | Path | AnyController | TorqueProfile,
        estimator: str | None,
        reference: str | Reference | None,
    ) -> str:
        """What is flown, by the names under which it was asked for; a torque for a controller."""
        law = str(controller) if isinstance(controller, str | Path) else type(controller).__name__
        law = f"torque {law}" if isinstance(self.controller, OpenLoop) else law
        motion = reference or self.controller.reference
        return (
            f"{self.platform.name}: {law} with estimator "
            f"{estimator or usual_estimator(self.platform)}, reference "
            f"{motion if isinstance(motion, str) else type(motion).__name__}, "
            f"{self.duration:g} s at {self.platform.control_rate:g} Hz"
        )

    def remarks(self, warnings: Sequence[str]) -> list[str]:
        """Effects of a simulated machine and what is foretold, a sentence each."""
        effects = [f"with {effect.words()}" for effect in self.effects]
        return [*effects, *(f"warning: {warning}" for warning in warnings)]

    def warnings(self) -> list[str]:
        """What will go wrong, known before it starts; a sentence each."""
        if isinstance(self.plant, ReplayedPlant) and self.plant.of_other:
            return [
                f"the log is of {self.plant.of_other}, and is replayed as if it were of "
                f"{self.platform.name}: filter and law take it for that machine"
            ]
        heading = self._unseen_heading(self._wanted)
        return [*self._unsteered(), *heading, *self._saturation()]

    def _unsteered(self) -> list[str]:
        """That the law, or the thrusters, cannot follow the place that the reference asks for."""
        if self.reference.at(0.0).position is None or not self.platform.base.travels:
            return []
        if type(self.controller).first_command is not Controller.first_command:
            return []  # another program, which is not asked
        if "place" in _answers_to(self.controller, self.platform):
            return self._beyond_thrust()
        return [
            f"the reference asks for a place, and {type(self.controller).__name__} steers none: "
            f"{self.platform.name} drifts; use a law that does (thruster_five)"
        ]

    def _beyond_thrust(self) -> list[str]:
        try:
            nozzles = Wrenches.of(self.platform, type(self.controller).__name__)
        except ControllerError:
            return []
        pushes = self.reference.at(np.linspace(0.0, self.duration, 1000)).acceleration
        if pushes is None:
            return []
        largest = pushes[np.argmax(np.sum(np.square(pushes), axis=1))]
        wrench = np.append(travelling_mass(self.platform) * largest, np.zeros(3))
        scale = float(nozzles.allocate(wrench[None]).scale[0])
        if scale > 1.0 - 1e-3:
            return []
        size = float(np.linalg.norm(largest))
        return [
            f"the reference asks for {size:.3g} m/s^2, and the thrusters of {self.platform.name}, "
            f"level, give {scale * size:.3g} m/s^2 that way: it will lag behind"
        ]

    def forecast(self) -> dict[str, str | float | None] | None:
        """For JSON: which of wheels and gyros are used up first, and when [s], None if they last;
        None where their momentum is not foretold."""
        budget = None if isinstance(self.plant, ReplayedPlant) else self._budget
        if isinstance(budget, GyroBudget):
            return {"of": "gyros", "used_up_at_s": budget.singular_at}
        if budget is None:
            return None
        return {"of": budget.first or "wheels", "used_up_at_s": budget.saturates_at}

    def _unseen_heading(self, wanted: Command) -> list[str]:
        """That the law steers a heading which no sensor shows."""
        platform, law = self.platform, type(self.controller).__name__
        unseen = "heading" not in self.estimator.shows(platform)
        if platform.base.kind == "hinge" or not unseen or not _TURNING & wanted.keys():
            return []
        flat = isinstance(self.estimator, InclinometerDifferences)  # knows no turn whatever
        if not flat and "heading" not in _answers_to(self.controller, platform):
            return []
        times = np.linspace(0.0, self.duration, 1000)
        yaw = float(np.max(np.abs(to_euler_zyx(self.reference.at(times).attitude)[..., 0])))
        follows = (
            f"{law} neither sees the heading drift nor holds it"
            if yaw < _LEVEL
            else f"{law} steers for the {np.degrees(yaw):.3g} deg of yaw that the reference asks "
            "for and never sees them reached"
        )
        remedy = (
            f"use the estimator {usual_estimator(platform)!r}"
            if "attitude" in platform.sensors
            else "give it [sensors.attitude], or a law that needs no heading (mass_pid) and a "
            "reference without yaw"
        )
        told = (
            "taken for 0"
            if flat
            else f"that of the start, carried by the gyro to a sigma of "
            f"{np.degrees(heading_sigma(platform, self.duration)):.2g} deg in {self.duration:g} s"
        )
        return [
            f"no sensor that the estimator {name_of(self.estimator)!r} reads shows the heading of "
            f"{platform.name}, which is {told}: {follows}; {remedy}"
        ]

    def _saturation(self) -> list[str]:
        platform, budget = self.platform, self._budget
        if isinstance(budget, GyroBudget):
            return self._singular_gyros(budget)
        if budget is None or budget.saturates_at is None:
            return []
        offset = platform.center_of_mass_offset / platform.mass * 1e6
        torque = platform.gravity * np.hypot(*platform.center_of_mass_offset[:2]) * 1e3
        limit = next(w.momentum_limit for w in platform.wheels if w.name == budget.first)
        return [
            f"the wheels will saturate: the CM stands {_triple(offset)} um from the CR, gravity "
            f"turns the level body with {torque:.3g} mN m, and following the reference takes "
            f"{budget.first} to its {limit:g} N m s at {budget.saturates_at:.0f} s "
            f"of {self.duration:g} s"
        ]

    @cached_property
    def _budget(self) -> MomentumBudget | GyroBudget | None:
        """Momentum that wheels or gyros will need; None where the law turns the body by something
        else too, or follows no reference, or the machine hangs on no ball."""
        platform, n, wheels = self.platform, self.plant.n, self.platform.wheels
        wanted = self._wanted
        if platform.base.kind != "ball" or isinstance(self.controller, OpenLoop):
            return None
        if _by_gyros(platform, wanted):
            return self._gyro_budget()
        # what a wheel takes in a gimbal depends on where that stands
        if "command_wheel_torque" not in wanted or any(w.gimbal is not None for w in wheels):
            return None
        start = np.broadcast_to(self.initial.wheel_speeds(platform), (n, len(wheels)))[0]
        return momentum_budget(platform, self.reference, self.duration, start)

    def _singular_gyros(self, budget: GyroBudget) -> list[str]:
        """That the array comes to a singular state."""
        platform = self.platform
        if budget.singular_at is None:
            return []
        means = "in which no turn of the gimbals gives the torque that is asked for"
        if budget.singular_at == 0.0:
            return [f"the gyros begin in a singular state, {means}"]
        torque = platform.gravity * np.hypot(*platform.center_of_mass_offset[:2]) * 1e3
        leans = (
            f", at a lean of {np.degrees(budget.lean):.3g} deg which the law lets it have,"
            if budget.lean > np.radians(0.01)
            else ""
        )
        row = np.searchsorted(budget.time, budget.singular_at)
        return [
            f"the gyros will fill: gravity turns the level body with {torque:.3g} mN m, and "
            f"following the reference{leans} takes them to a momentum of "
            f"{np.linalg.norm(budget.momentum[row]):.3g} N m s at {budget.singular_at:.0f} s of "
            f"{self.duration:g} s, next to a singular state, {means} (none is within "
            f"{budget.radius:.3g} N m s)"
        ]

    def _gyro_budget(self) -> GyroBudget:
        """With the lean that the law lets the body have, if it says what torque holds it."""
        platform, law = self.platform, self.controller
        array = Gyros.of(platform, type(law).__name__)
        turns = np.vstack([np.zeros((1, 3)), _TURN * np.eye(3)])
        estimate = Passthrough().init(platform, len(turns))
        home = estimate.gimbal_angle[0]
        given = home if self.initial.gimbal_angle is None else self.initial.gimbal_angle
        angles = np.broadcast_to(given, (self.plant.n, len(home)))[0]
        stiffness = None
        if type(law).first_command is Controller.first_command:
            estimate = replace(
                estimate,
                gimbal_angle=np.tile(angles, (len(turns), 1)),
                attitude=from_rotation_vector(turns),
                valid=np.ones(len(turns), dtype=np.bool_),
                awaited={},
            )
            rates = law.first_command(platform, estimate, Target(IDENTITY))["command_gimbal_rate"]
            torque = -np.einsum("ngi,ng->ni", array.columns(estimate), rates)
            stiffness = (torque[1:] - torque[0]).T / _TURN
        return gyro_budget(platform, self.reference, self.duration, angles, stiffness)

    def fly(
        self,
        clock: Clock,
        observers: Sequence[Observer] = (),
        tell: Callable[[str], None] = lambda line: None,
    ) -> Outcome:
        """Run the loop to its end.

        A bench has its own clock, and is watched and armed first; then each actuator that the law
        commands is tried, and `tell` takes a sentence for it (`twin.service.first_use`).

        Raises:
            SafetyError: why it is not armed, or which actuator does otherwise than predicted.
            DeviceError: a device refuses.
        """
        with ExitStack() as stack:
            stack.callback(self.controller.close)
            if self.bench is not None:
                # its drivers take a while to import
                from twin.service.answer import BodyAnswer
                from twin.service.first_use import armed

                clock = armed(self.bench, self._wanted, tell)
                observers = [*observers, stack.enter_context(BodyAnswer(self.bench))]
            return fly(
                self.plant,
                self.estimator,
                self.controller,
                self.reference,
                clock,
                duration=self.duration,
                observers=[*observers, *self._progress()],
            )

    def _progress(self) -> list[Observer]:
        """A machine on its bench has a view of its own, and keeps to the wall's clock."""
        return [FlightProgress(self.duration)] if self.bench is None else []

    @cached_property
    def _wanted(self) -> Command:
        """What the law commands at its beginning; its mistakes are told before anything moves."""
        law, target = self.controller, self.reference.at(0.0)
        estimate = self.estimator.init(self.platform, self.plant.n)
        try:
            wanted = cast(object, law.first_command(self.platform, estimate, target))
            if not isinstance(wanted, dict):
                raise TypeError(
                    f"the command is of type {type(wanted).__name__}, not a dict of streams"
                )
        except (Exception, SystemExit) as problem:
            tell_mistake(law, self.platform, problem)
            raise
        return cast(Command, wanted)


@dataclass(frozen=True)
class Run(Shown):
    """A flight that is over."""

    platform: Platform
    recorded: Recording | Path | None = field(repr=False)
    """All streams, in memory or in a file; None where they were not kept."""
    outcome: Outcome
    metrics: Mapping[str, Any]
    """By name with its unit: of tracking, tilt, wheels (`twin.metrics`)."""
    settle: float
    """From which on tracking counts [s]."""
    warnings: tuple[str, ...] = ()
    """What was foretold to go wrong, a sentence each."""
    notes: tuple[str, ...] = ()
    """Of a machine on its bench: what its devices, line and guard reported, a sentence each."""
    last_seconds: Mapping[int, Recording] = field(default_factory=dict[int, Recording], repr=False)
    """Of each run that was stopped: what came just before; the reason is in the provenance."""
    first_use: Recording | None = field(default=None, repr=False)
    """What was read and applied while the actuators of an armed machine were tried."""
    bench: Mapping[str, Any] = field(default_factory=dict[str, Any], repr=False)
    """Of a machine on its bench, for JSON: devices, streams, limits, first use."""
    forecast: Mapping[str, Any] | None = None
    """When wheels or gyros were foretold to be used up (`Flight.forecast`)."""

    @cached_property
    def recording(self) -> Recording:
        """All streams, a simulation's true states too.

        Raises:
            UsageError: the run was neither kept in memory nor recorded into a file.
        """
        if self.recorded is None:
            raise UsageError("the run was not kept: fly it with keep=True, or with a file in rrd")
        return self.recorded if isinstance(self.recorded, Recording) else open_log(self.recorded)

    @property
    def ended(self) -> str:
        """done, degraded, safe_stop or failed."""
        return self.outcome.ended.value

    def document(self) -> Mapping[str, Any]:
        """What `twin run --json` prints; SI."""
        timing = self.outcome.timing
        late = {name: timing.lateness_at(share) for name, share in _PERCENTILES.items()}
        return {
            "ended": self.outcome.ended.value,
            "reason": self.outcome.reason or None,
            "duration": self.outcome.duration,
            "overruns": timing.overruns,
            "ticks": timing.ticks,
            "lateness_s": late if timing.lateness else None,
            "warnings": list(self.warnings),
            "forecast": self.forecast,
            "remarks": list(self.outcome.remarks),
            "estimates": {
                name: {
                    "value": None if stated.value is None else stated.value[0].tolist(),
                    "sigma": stated.sigma[0].tolist(),
                    "unit": stated.unit,
                }
                for name, stated in self.outcome.quantities.items()
            },
            "metrics": self.metrics,
            "seconds": timing.seconds,
            **self.bench,
        }


BENCHES = ("pty", "serial")
"""Kinds of plants that are a machine on its bench, or the emulation of one."""
_PERCENTILES = {"p50": 50.0, "p99": 99.0, "max": 100.0}


def plant_words(plant: str, seed: int, arm: str | None) -> str:
    """What flies, which noise it has, and on a bench whether commands leave."""
    kind = plant.partition(":")[0]
    words = [f"plant {plant}", *([] if kind == "serial" else [f"seed {seed}"])]
    if kind in BENCHES:
        words.append(f"armed as {arm}" if arm else "not armed: nothing leaves")
    return ", ".join(words)


def broken_off(problem: TwinError | Stopped) -> Outcome:
    """How a flight ended that this broke off."""
    if isinstance(problem, Stopped):
        reason = f"{problem} before its law began"
        return Outcome(Ended.safe_stop, reason, 0.0, {}, Timing(), problem.number)
    return problem.outcome or Outcome(Ended.failed, str(problem), 0.0, {}, Timing())


def check_start(plant: str, identified: str | Path | None, motion: Sequence[float]) -> None:
    """Refuse options of a flight that its plant cannot have.

    Raises:
        UsageError: an identification without a guard, or a start of a real machine.
    """
    kind = plant.partition(":")[0]
    if identified is not None and kind not in BENCHES:
        raise UsageError(f"--identified is for a machine on its bench; plant {plant} has no guard")
    if kind == "serial" and any(motion):
        raise UsageError(
            "--attitude, --rate and --velocity are of a simulated machine; a real one starts "
            "as it stands: leave them out"
        )


def prepare(
    platform: str | Platform,
    *,
    controller: str | AnyController,
    torque: str | TorqueProfile | None = None,
    estimator: str | None,
    plant: str,
    reference: str | Reference | None,
    duration: float | None,
    seed: int = 0,
    initial: InitialState | None = None,
    gains: Mapping[str, float] | None = None,
    effects: Sequence[Effect] = (),
    held: "Held | None" = None,
    lockstep: bool = False,
    tell: Callable[[str], None] = lambda line: None,
) -> Flight:
    """Find everything by its name and put it together.

    Args:
        platform: a shipped name, or a folder; `:variant` may follow; or the machine itself.
        controller: a shipped name, a file, or the address of a law in another program
            (`twin.controller.remote`), which is waited for; or the law itself.
        torque: in place of a law other than free_float: see `twin.manoeuvre.parse_torque`, or a
            profile itself.
        estimator: a name of `twin.estimators`; None for the machine's usual one.
        plant: `sim`, `replay:LOG`, or one that `twin.bench.open_bench` knows.
        reference: see `twin.reference.parse_reference`, or a motion itself; None: what the law is
            usually given.
        duration: [s]; None: 60 s, the whole log that is replayed, or to the end of a table that
            states reference or torque.
        seed: of all random numbers.
        initial: of a simulated or emulated plant.
        gains: of the law, by name.
        effects: what a simulated machine has beyond what its platform states.
        held: arm a machine on its bench, and whether it floats; None: nothing leaves.
        lockstep: of an emulation; see `twin.bench.open_bench`.
        tell: takes a sentence where something is waited for.

    Raises:
        UnknownName: a name that is not known.
        UsageError: parts that do not fit together.
        PlatformError, ControllerError, LogError: a file that is wrong.
        EffectError: an effect that the platform cannot have.
    """
    stated = platform if isinstance(platform, Platform) else load_platform(platform)
    machine = with_effects(stated, effects)
    start = initial or InitialState()
    kind, _, rest = plant.partition(":")
    length = 60.0 if duration is None else duration
    if held is not None and kind in ("sim", "replay"):
        raise UsageError(
            f"--arm is for a machine on its bench; plant {plant} takes commands at once"
        )
    if lockstep and kind != "pty":
        raise UsageError(f"--lockstep is for plant pty; {plant} has no emulation to wait for")
    if effects and kind in ("replay", "serial"):
        what = "a log that is replayed" if kind == "replay" else "a real machine"
        raise UsageError(f"effects are simulated; {what} has its own: drop --effects")
    driver = None if torque is None else _open_loop(torque, controller, gains)
    bench: Bench | None = None
    if plant == "sim":
        body: Plant = SimulatedPlant(machine, seed=seed, initial=start)
    elif kind == "replay" and rest:
        replayed = ReplayedPlant(machine, open_log(Path(rest)))
        body = replayed
        length = replayed.duration if duration is None else min(duration, replayed.duration)
    elif kind in ("pty", "serial"):
        from twin.bench import open_bench  # its drivers take a while to import

        bench = open_bench(machine, plant, held=held, seed=seed, initial=start, lockstep=lockstep)
        body, machine = bench, bench.platform
    else:
        raise UnknownName("plant", plant, PLANTS)
    check_duration(length)
    observer = load_estimator(estimator or usual_estimator(machine))
    law = driver or _law(controller, gains, machine, simulated=bench is None or lockstep, tell=tell)
    if kind != "replay":  # whose log may show more than the machine
        _check_observable(law, estimator or usual_estimator(machine), observer, machine)
    asked = reference or law.reference
    followed = asked if isinstance(asked, Reference) else parse_reference(asked)
    if duration is None and kind != "replay":
        length = _table_end(followed, law) or length
    if kind != "replay":  # what a log did is done, wherever the law would have gone
        _check_within_stop(machine, asked, followed, length)
        if reference is not None and followed.at(0.0).position is not None:
            _check_travels(machine, asked)
    return Flight(
        plant=body,
        estimator=observer,
        controller=law,
        reference=followed,
        duration=length,
        initial=start,
        bench=bench,
    )


def _table_end(followed: Reference, law: AnyController) -> float | None:
    """When the table of the reference, or that of a torque, ends [s]; None: there is none."""
    ends = [law.profile.end if isinstance(law, OpenLoop) else None]
    ends += [float(followed.table.time[-1]) if isinstance(followed, Tabulated) else None]
    return max((end for end in ends if end is not None and end > 0.0), default=None)


def _check_within_stop(
    machine: Platform, reference: str | Reference, followed: Reference, length: float
) -> None:
    if machine.base.kind != "ball" or not np.isfinite(machine.stop_angle):
        return
    lean = float(np.max(machine.lean(followed.at(np.linspace(0.0, length, 1000)).attitude)))
    if lean > machine.stop_angle:
        raise UsageError(
            f"reference {reference!r} leans {machine.name} by {np.degrees(lean):.3g} deg, beyond "
            f"the stop at {np.degrees(machine.stop_angle):.3g} deg; give smaller angles"
        )


def _check_travels(machine: Platform, reference: str | Reference) -> None:
    if not machine.base.travels:
        raise UsageError(
            f"reference {reference!r} asks for a place, and {machine.name} stays where it is; give "
            "an attitude alone, or a machine that travels (astros:mode_c)"
        )


_SHOWN_BY = {
    "attitude": ("attitude", "inclinometer", "accelerometer beside gyro"),
    "rate": ("gyro", "attitude beside gyro"),
}
"""What a law may need, and the streams of a body on a ball that tell it."""


def _check_observable(
    law: AnyController, name: str, estimator: Estimator, machine: Platform
) -> None:
    """That the law needs nothing which no sensor tells the estimator.

    Raises:
        UsageError: it does; with the streams and estimators that would do.
    """
    lacking = {"attitude", "rate"} - estimator.shows(machine)
    if not lacking:
        return
    for need in sorted(lacking & _answers_to(law, machine)):
        better = usual_estimator(machine)
        if need in load_estimator(better).shows(machine):
            remedy = f"use the estimator {better!r}"
        elif machine.base.kind == "hinge":
            remedy = f"give it [sensors.joint_{'angle' if need == 'attitude' else 'rate'}]"
        else:
            remedy = "give it " + " or ".join(
                " and ".join(f"[sensors.{s}]" for s in words.split(" beside "))
                for words in _SHOWN_BY[need]
            )
        what = "how the body stands" if need == "attitude" else "how fast it turns"
        raise UsageError(
            f"{type(law).__name__} answers to {what}, and no sensor of {machine.name} shows it to "
            f"the estimator {name!r}: {remedy}"
        )


def _answers_to(law: AnyController, machine: Platform) -> set[str]:
    """Which of "attitude" (how it leans), "heading", "rate" and "place" change what the law
    commands first; of a law in another program, which is not asked, the heading alone is supposed.
    """
    if type(law).first_command is not Controller.first_command:
        return {"heading"}
    yaw = from_rotation_vector(np.array([[0.0, 0.0, 0.05]]))
    turned = {
        "attitude": {"attitude": from_rotation_vector(np.array([[0.03, -0.05, 0.02]]))},
        "rate": {"rate_body": np.array([[0.02, -0.01, 0.03]])},
    }
    if machine.base.kind == "hinge":
        turned = {
            "attitude": {"joint_angle": np.array([[0.05]])},
            "rate": {"joint_rate": np.array([[0.05]])},
        }
    target, still = Target(IDENTITY), np.zeros((1, 3))
    base = replace(Passthrough().init(machine, 1), valid=np.ones(1, dtype=np.bool_), awaited={})
    tipped = replace(base, **turned["rate"])  # what damps a rate may ask for the attitude, too
    try:
        level, moving = (law.first_command(machine, e, target) for e in (base, tipped))
        found = set() if _same(level, moving) else {"rate"}
        for start, before in ((base, level), (tipped, moving)):
            other = law.first_command(machine, replace(start, **turned["attitude"]), target)
            found |= set() if _same(before, other) else {"attitude"}
            turn = {"attitude": multiply(yaw, start.attitude)}
            other = law.first_command(machine, replace(start, **turn), target)
            found |= set() if _same(before, other) else {"heading"}
        if machine.base.travels:
            here, there = (
                law.first_command(
                    machine,
                    replace(base, position=still, velocity=still),
                    replace(target, position=where, velocity=still[0], acceleration=still[0]),
                )
                for where in (np.zeros(3), np.array([1.0, 0.5, 0.0]))
            )
            found |= set() if _same(here, there) else {"place"}
    except Exception:  # noqa: BLE001 - `Flight.fly` asks again, and tells what is wrong with it
        return set()
    return found


def _by_gyros(platform: Platform, wanted: Command) -> bool:
    """Whether a law turns the body by gyros of constant momentum alone."""
    turned = wanted.keys() & (_TURNING | {"command_stage_position"}) == {"command_gimbal_rate"}
    return turned and constant_gyros(platform)


def _same(first: object, other: object) -> bool:
    if not isinstance(first, dict) or not isinstance(other, dict) or first.keys() != other.keys():
        return False
    return all(np.array_equal(first[key], other[key], equal_nan=True) for key in first)


def _open_loop(
    torque: str | TorqueProfile, controller: str | AnyController, gains: Mapping[str, float] | None
) -> AnyController:
    if controller != "free_float" or gains:
        raise UsageError(
            "a torque is flown in open loop, in place of a law: drop --torque, or --controller and "
            "--gains"
        )
    return OpenLoop(*parse_torque(torque)) if isinstance(torque, str) else OpenLoop(torque)


def _law(
    name: str | AnyController,
    gains: Mapping[str, float] | None,
    machine: Platform,
    *,
    simulated: bool,
    tell: Callable[[str], None],
) -> AnyController:
    if isinstance(name, Controller):
        if gains:
            raise UsageError("gains are those of a law by its name; set the fields of this one")
        return name
    if "://" not in name:
        return load_controller(name, gains)
    if gains:
        raise UsageError(f"the gains of {name} are its own; drop --gains")
    from twin.controller.remote import RemoteLaw  # brings our link with it

    return RemoteLaw(machine, name, lockstep=simulated, tell=tell)


def _triple(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"
