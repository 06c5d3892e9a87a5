"""One balancing from beginning to end: checked, flown, and judged run by run."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench, open_bench
from twin.clock import SimulatedClock, check_duration
from twin.effects import Effect, with_effects
from twin.errors import UnknownName, UsageError
from twin.estimators import load_estimator, usual_estimator
from twin.loop import FlightProgress, Observer, Outcome, fly
from twin.plant.guard.guarded import Held
from twin.plant.initial import InitialState
from twin.plant.plant import Plant
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform
from twin.procedures.means import Reach
from twin.procedures.plan import Notes, Phase, Remark, Statement
from twin.procedures.setup import WAYS, balancing, random_offsets, refuse, usual_target
from twin.reference import Hold
from twin.service.answer import BodyAnswer
from twin.service.first_use import armed
from twin.shown import Shown
from twin.stream.provenance import provenance
from twin.stream.recorder import FileRecorder

Array = NDArray[np.float64]
Triple = tuple[float, float, float]
Watch = Callable[[Bench, float], AbstractContextManager[Observer]]

_DAMPING = ("command_dipole", "command_gimbal_rate", "command_wheel_torque")


@dataclass(frozen=True)
class BalancingSession:
    """Options of a balancing; errors name them as `twin balance` does."""

    procedure: str = "direct"
    """Of `WAYS`."""
    target: float | None = None
    """Gravity torque that may be left at the worst attitude [N m]; None: the usual one."""
    plant: str = "sim"
    """`sim`, or one that `twin.bench.open_bench` knows."""
    arm: str | None = None
    """`floating`: let commands of a machine on its bench leave."""
    lockstep: bool = False
    """Of an emulation; see `twin.bench.open_bench`."""
    effects: Sequence[Effect] = ()
    """Of the simulated machine, beyond its platform."""
    offset: Triple | None = None
    """Of the simulated machine's CM from its CR [m]; None: as its platform states."""
    random_offset: bool = False
    """Draw it instead, within the masses' reach, by the seed."""
    stages: Triple = (0.0, 0.0, 0.0)
    """Where the masses stand at the start [m]; the offset is meant there."""
    runs: int = 1
    """Number of machines flown at once, each with a random offset and noise."""
    duration: float = 7200.0
    """Time limit [s]."""
    seed: int = 0
    """Of all random numbers."""

    def check(self) -> None:
        """Hold the options against each other.

        Raises:
            UnknownName: of a procedure or a plant.
            UsageError: options that do not go together, or no number that will do.
        """
        if self.procedure not in WAYS:
            raise UnknownName("procedure", self.procedure, WAYS)
        if self.target is not None and not 0.0 < self.target < float("inf"):
            raise UsageError(f"target is {self.target:g} N m; give a torque above zero")
        if self.plant.startswith("replay"):
            raise UsageError("a log that is replayed does not move: balance the simulated machine")
        kind = self.plant.partition(":")[0]
        if self.plant != "sim" and kind not in ("pty", "serial"):
            raise UnknownName("plant", self.plant, ("sim", "pty", "pty:FILE.toml", "serial:URL"))
        if self.plant == "sim" and self.arm:
            raise UsageError("--arm is for a machine on its bench; the simulated one moves at once")
        if self.lockstep and kind != "pty":
            raise UsageError(
                f"--lockstep is for plant pty; {self.plant} has no emulation to wait for"
            )
        if self.plant != "sim" and not self.arm:
            raise UsageError(
                "balancing moves masses, and nobody has armed it: look whether the table floats "
                "free, then say --arm floating"
            )
        if self.plant != "sim" and self.runs > 1:
            raise UsageError(f"runs is {self.runs}; there is one machine on a bench")
        if kind == "serial" and (
            self.effects or self.offset or self.random_offset or any(self.stages)
        ):
            raise UsageError(
                "--effects, --offset, --random-offset and --stages are of a simulated machine; a "
                "real one has its own: leave them out"
            )
        if self.runs < 1:
            raise UsageError(f"runs is {self.runs}; give 1 or more")
        check_duration(self.duration)
        if self.offset is not None and (self.random_offset or self.runs > 1):
            raise UsageError("--offset is that of one run; leave out --random-offset and --runs")

    def run(
        self,
        platform: Platform,
        *,
        rrd: Path | None = None,
        tell: Callable[[str], None] = lambda line: None,
        watch: Watch | None = None,
    ) -> "Balanced":
        """Balance a machine.

        Args:
            platform: the machine, without the effects.
            rrd: file to record into; of several runs the first is recorded.
            tell: takes a line of progress.
            watch: makes an observer of a machine on its bench, beside the recorder.

        Raises:
            Refused: it cannot come out.
            TwinError: as `check`, or a machine that lacks a part.
        """
        self.check()
        machine = with_effects(platform, self.effects)
        target = usual_target(machine) if self.target is None else self.target
        with ExitStack() as stack:
            simulated = self.plant == "sim"
            offsets, positions = self._start(machine, target)
            tell(
                f"{machine.name}: {self.procedure}, to {target:.3g} N m, at most "
                f"{self.duration:g} s, plant {self.plant}, seed {self.seed}"
            )
            initial = InitialState(stage_position=positions, center_of_mass_offset=offsets)
            if simulated:
                plant: Plant = SimulatedPlant(
                    machine, runs=range(self.runs), seed=self.seed, initial=initial
                )
            else:
                plant = open_bench(
                    machine,
                    self.plant,
                    held=Held.floating,
                    seed=self.seed,
                    initial=initial,
                    lockstep=self.lockstep,
                )
                _check_damped(plant)
            # of a machine on its bench, with the sensors that its devices carry
            machine = plant.platform
            # a fit takes no time where the wall's clock does not count
            wait = simulated or self.lockstep
            recorder = None if rrd is None else stack.enter_context(FileRecorder(rrd))

            def heard(remark: Remark) -> None:
                which = f"run {remark.run}, " if self.runs > 1 else ""
                tell(f"{which}{remark.time:8.1f} s  {remark.words}")
                if recorder is not None and remark.run == 0:
                    recorder.say(remark.time, remark.words)

            procedure = balancing(
                machine, self.runs, way=self.procedure, target=target, tell=heard, wait=wait
            )
            stack.enter_context(procedure.lab.fits)
            observers: list[Observer] = [procedure.lab.logbook]
            if recorder is not None:
                recorder.start(machine, provenance(machine, seed=self.seed), remarks=True)
                observers.append(recorder)
            estimator = load_estimator(_estimator(machine))
            # last, for a machine on its bench moves from now on
            stack.enter_context(plant)
            if simulated:
                observers.append(FlightProgress(self.duration, may_end_early=True))
            if isinstance(plant, Bench) and watch is not None:
                observers.append(stack.enter_context(watch(plant, self.duration)))
            commands = {"command_stage_position", *_DAMPING}
            clock = armed(plant, commands, tell) if isinstance(plant, Bench) else SimulatedClock()
            if isinstance(plant, Bench):
                observers.append(stack.enter_context(BodyAnswer(plant)))
            outcome = fly(
                plant,
                estimator,
                procedure,
                Hold(),
                clock,
                duration=self.duration,
                observers=observers,
            )
            idle = {name: 0.0 * value for name, value in plant.write({}).items()}
            idle.pop("command_stage_position", None)
            plant.write(idle)
            if isinstance(plant, Bench):
                tell("\n".join(plant.messages()))
        return Balanced(machine, self, target, outcome, procedure.lab.notes, rrd)

    def _start(self, machine: Platform, target: float) -> tuple[Array, Array]:
        """m r of each run at stage position 0 [kg m], and where its masses stand [m]."""
        positions = np.array(self.stages)
        reach = Reach.of(machine)
        if len(machine.stages) != len(positions):
            raise UsageError(f"--stages gives three positions; {machine.name} has other stages")
        beyond = reach.beyond(positions)
        if beyond:
            raise UsageError(f"--stages: {beyond}")
        if self.random_offset or self.runs > 1:
            return random_offsets(machine, self.seed, self.runs), positions
        stated = machine.center_of_mass_offset
        offset = stated if self.offset is None else machine.mass * np.array(self.offset)
        base = offset - reach.moment(positions[None])[0]
        refuse(machine, self.procedure, target, base)
        return base[None], positions


@dataclass(frozen=True)
class Balanced(Shown):
    """How a balancing ended, and what it leaves."""

    platform: Platform
    session: BalancingSession
    target: float
    """[N m]."""
    outcome: Outcome
    notes: Notes = field(repr=False)
    rrd: Path | None = None
    """What it was recorded into."""

    @property
    def statements(self) -> tuple[Statement | None, ...]:
        """Of each run; None where nothing was stated."""
        return tuple(run.statement for run in self.notes.runs)

    @property
    def done(self) -> bool:
        """Whether every run came to its target."""
        return all(self.run(run)["ended"] == "done" for run in range(self.session.runs))

    def run(self, run: int) -> dict[str, Any]:
        """What is said of a run: how and why it ended, and its statement's numbers (SI)."""
        outcome, note = self.outcome, self.notes.runs[run]
        if note.phase is Phase.done:
            ended, reason = "done", None
        elif run in outcome.stopped and outcome.stopped[run] != outcome.reason:
            ended, reason = "failed", outcome.stopped[run]
        elif note.phase is Phase.stopped or outcome.ended.value == "safe_stop":
            ended, reason = "safe_stop", note.reason or outcome.reason
        elif run in outcome.stopped:
            ended, reason = "failed", outcome.stopped[run]
        else:
            ended = "failed"
            reason = (
                f"not balanced within {self.session.duration:g} s; it was in phase "
                f"{note.phase.name}"
            )
        stated = {} if note.statement is None else note.statement.document()
        unknown = dict.fromkeys(
            ("residual_torque", "residual_torque_in_plane", "residual_torque_observed",
             "center_of_mass_offset", "stage_position", "chi2_per_sample")
        )  # fmt: skip
        over = note.phase in (Phase.done, Phase.stopped)
        return {
            "ended": ended,
            "reason": reason,
            "duration": note.since if over else outcome.duration,
            "overruns": outcome.timing.overruns,
            "procedure": self.session.procedure,
            "target": self.target,
            "identified": note.identified,
            **unknown,
            **stated,
            "recording": self.rrd,
        }


def _estimator(machine: Platform) -> str:
    """What damps needs the whole rate, and an inclinometer's differences lack the yaw."""
    usual = usual_estimator(machine)
    return "mekf" if usual == "inclinometer" else usual


def _check_damped(bench: Bench) -> None:
    """A table whose swinging nothing takes away would never settle."""
    taken = {route.stream for route in bench.setup.commanded}
    if not taken & set(_DAMPING):
        raise UsageError(
            f"no device of {bench.platform.name} takes anything that damps its swinging; "
            f"[hardware.commands] needs one of {', '.join(_DAMPING)}"
        )
