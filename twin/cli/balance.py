"""`twin balance`: bring a machine's CM into its CR, and say what is left."""

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from twin.bench import Bench
    from twin.loop import Outcome
    from twin.platform import Platform
    from twin.procedures.notes import Notes

Triple = tuple[float, float, float]

_DAMPING = ("command_dipole", "command_gimbal_rate", "command_wheel_torque")

CAP = 7200.0
"""In which a balancing must be over unless told otherwise [s]."""


def _arg(metavar: str) -> object:
    return tyro.conf.arg(metavar=metavar)


@dataclass(frozen=True)
class Balance:
    """Balance a machine by its sliding masses, to a stated residual torque.

    The vertical mass goes down first, so that the body hangs. Then it is made to swing, J and m r
    are identified from the swing, and the masses move: in the plane at once or under a control law,
    in height by at most half of what is left, never above the CR. In the end it floats free for two
    minutes, and what is left is stated with 95 % intervals. The machine needs `attitude`: from gyro
    and inclinometer alone the fit of a swing does not settle.

    Procedures: direct moves the masses by what was identified (000 eq. 12-15, iterated as in 004);
    masses and masses-and-coils leave the plane to a law (001; 003); adaptive begins with adaptive
    balancing under persistent excitation (000 eq. 35-37).
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    procedure: Annotated[str, _arg("NAME")] = "direct"
    """direct, masses, masses-and-coils or adaptive. What damps meanwhile is what the machine has:
    coils in a field, gyros, or wheels."""
    target: Annotated[float | None, _arg("N_M")] = None
    """Gravity torque that may be left at the worst attitude; by default that of the machine's
    paper, else that of 5 um."""
    plant: Annotated[str, _arg("sim|pty[:FILE.toml]|serial[:URL]")] = "sim"
    """Simulated; its devices emulated on a pseudo-terminal; or the real ones, as of `twin run`."""
    arm: Annotated[Literal["floating"] | None, _arg("floating")] = None
    """Let commands leave, within the rules of docs/safety.md, on the bench and on its emulation:
    the operator's word, who has looked, that the table floats."""
    lockstep: bool = False
    """With plant pty: loop and emulation wait for each other instead of keeping to the wall's
    clock. As fast as both can, and no computer is too slow for it."""
    effects: Annotated[str | None, _arg("NAME[:TARGET]=VALUE[/VALUE ...],...")] = None
    """What the simulated machine has beyond its platform; see `twin effects`."""
    offset: Annotated[Triple | None, _arg("X Y Z")] = None
    """Of the simulated machine's CM from its CR, in um; by default as its platform states."""
    random_offset: bool = False
    """Draw it instead, within the masses' reach, by the seed."""
    stages: Annotated[Triple, _arg("MM MM MM")] = (0.0, 0.0, 0.0)
    """Where the masses stand at the start, in mm; the offset is meant there."""
    runs: int = 1
    """So many machines at once, each with its own random offset and noise."""
    duration: Annotated[float, _arg("SECONDS")] = CAP
    """After which it is given up."""
    seed: int = 0
    """Of all random numbers."""
    rrd: Annotated[Path | None, _arg("OUT.rrd")] = None
    """Record into this file; of several runs the first. One that exists is written anew, but never
    on pty or serial: a session cannot be flown again."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Balance; the exit code."""
        from twin.bench import Bench, open_bench
        from twin.cli.output import check_writable, print_json, tell
        from twin.clock import SimulatedClock
        from twin.effects import parse_effects, with_effects
        from twin.estimators import load_estimator, usual_estimator
        from twin.loop import Observer, fly
        from twin.plant.guard.guarded import Held
        from twin.plant.initial import InitialState
        from twin.plant.plant import Plant
        from twin.plant.simulated import SimulatedPlant
        from twin.platform import load_platform
        from twin.procedures import Remark, balancing, usual_target
        from twin.reference import Hold
        from twin.service.first_use import armed
        from twin.stop import Stopped
        from twin.stream.provenance import provenance
        from twin.stream.recorder import FileRecorder

        self._check()
        effects = () if self.effects is None else parse_effects(self.effects)
        machine = with_effects(load_platform(self.platform), effects)
        way = self.procedure
        target = usual_target(machine) if self.target is None else self.target
        if self.rrd is not None:
            check_writable(self.rrd, ".rrd", anew=self.plant == "sim")
        with ExitStack() as stack:
            simulated = self.plant == "sim"
            offsets, positions = self._start(machine, way, target)
            tell(
                f"{machine.name}: {way}, to {target:.3g} N m, at most {self.duration:g} s, "
                f"plant {self.plant}, seed {self.seed}"
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
            recorder = None if self.rrd is None else stack.enter_context(FileRecorder(self.rrd))

            def heard(remark: Remark) -> None:
                which = f"run {remark.run}, " if self.runs > 1 else ""
                tell(f"{which}{remark.time:8.1f} s  {remark.words}")
                if recorder is not None and remark.run == 0:
                    recorder.say(remark.time, remark.words)

            procedure = balancing(machine, self.runs, way=way, target=target, tell=heard, wait=wait)
            stack.enter_context(procedure.lab.fits)
            observers: list[Observer] = [procedure.lab.logbook]
            if recorder is not None:
                facts = provenance(machine, seed=self.seed, command=sys.argv)
                recorder.start(machine, facts, remarks=True)
                observers.append(recorder)
            estimator = load_estimator(usual_estimator(machine))
            # last, for a machine on its bench moves from now on
            stack.enter_context(plant)
            if isinstance(plant, Bench):
                from twin.cli.live import LiveView

                observers.append(stack.enter_context(LiveView(plant, self.duration)))
            commands = {"command_stage_position", *_DAMPING}
            clock = armed(plant, commands, tell) if isinstance(plant, Bench) else SimulatedClock()
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
                tell("\n".join(plant.told()))
        notes = procedure.lab.notes
        documents = [self._document(outcome, notes, run, target, way) for run in range(self.runs)]
        if self.json:
            print_json(documents[0] if self.runs == 1 else {"runs": documents})
        else:
            print("\n".join(self._report(machine, documents, notes, target)))
        done = all(document["ended"] == "done" for document in documents)
        if outcome.asked and not done:
            raise Stopped(outcome.asked)
        return 0 if done else 1

    def kept(self) -> str:
        """What is there of a balancing that was stopped."""
        again = "balancing begins anew from where the masses stand"
        if self.rrd is None or not self.rrd.exists():
            return again
        return f"{self.rrd} holds what was recorded, if it had begun; {again}"

    def _check(self) -> None:
        from twin.clock import check_duration
        from twin.errors import UnknownName, UsageError
        from twin.procedures.setup import WAYS

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

    def _start(
        self, machine: "Platform", way: str, target: float
    ) -> "tuple[NDArray[np.float64], NDArray[np.float64]]":
        """m r of each run at stage position 0 [kg m], and where its masses stand [m]."""
        import numpy as np

        from twin.errors import UsageError
        from twin.procedures import random_offsets, refuse
        from twin.procedures.means import Reach

        positions = 1e-3 * np.array(self.stages)
        reach = Reach.of(machine)
        if len(machine.stages) != len(positions):
            raise UsageError(f"--stages gives three positions; {machine.name} has other stages")
        beyond = reach.beyond(positions)
        if beyond:
            raise UsageError(f"--stages: {beyond}")
        if self.random_offset or self.runs > 1:
            return random_offsets(machine, self.seed, self.runs), positions
        stated = machine.center_of_mass_offset
        offset = stated if self.offset is None else 1e-6 * machine.mass * np.array(self.offset)
        base = offset - reach.moment(positions[None])[0]
        refuse(machine, way, target, base)
        return base[None], positions

    def _document(
        self, outcome: "Outcome", notes: "Notes", run: int, target: float, way: str
    ) -> dict[str, Any]:
        from twin.procedures import Phase

        told = notes.runs[run]
        if told.phase is Phase.done:
            ended, reason = "done", None
        elif run in outcome.stopped and outcome.stopped[run] != outcome.reason:
            ended, reason = "failed", outcome.stopped[run]
        elif told.phase is Phase.stopped or outcome.ended.value == "safe_stop":
            ended, reason = "safe_stop", told.reason or outcome.reason
        elif run in outcome.stopped:
            ended, reason = "failed", outcome.stopped[run]
        else:
            ended = "failed"
            reason = f"not balanced within {self.duration:g} s; it was in phase {told.phase.name}"
        stated = {} if told.statement is None else told.statement.document()
        unknown = dict.fromkeys(
            ("residual_torque", "residual_torque_in_plane", "residual_torque_observed",
             "center_of_mass_offset", "stage_position", "chi2_per_sample")
        )  # fmt: skip
        over = told.phase in (Phase.done, Phase.stopped)
        return {
            "ended": ended,
            "reason": reason,
            "duration": told.since if over else outcome.duration,
            "overruns": outcome.timing.overruns,
            "procedure": way,
            "target": target,
            "identified": told.identified,
            **unknown,
            **stated,
            "recording": self.rrd,
        }

    def _report(
        self,
        machine: "Platform",
        documents: Sequence[dict[str, Any]],
        notes: "Notes",
        target: float,
    ) -> list[str]:
        from twin.report.balanced import balanced

        lines: list[str] = []
        for run, document in enumerate(documents):
            which = f"run {run}: " if len(documents) > 1 else ""
            end = f"{which}{document['ended']} after {document['duration']:.0f} s"
            end += f", offset identified {document['identified']} times"
            lines.append(f"{end}: {document['reason']}" if document["reason"] else end)
            statement = notes.runs[run].statement
            if statement is not None:
                lines += balanced(statement, machine, target)
        if self.rrd is not None:
            lines.append(f"recorded in {self.rrd}: look at it with `twin view {self.rrd}`")
        return lines


def _check_damped(bench: "Bench") -> None:
    """A table whose swinging nothing takes away would never settle."""
    from twin.errors import UsageError

    taken = {route.stream for route in bench.setup.commanded}
    if not taken & set(_DAMPING):
        raise UsageError(
            f"no device of {bench.platform.name} takes anything that damps its swinging; "
            f"[hardware.commands] needs one of {', '.join(_DAMPING)}"
        )
