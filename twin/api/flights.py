"""Runs of one machine: under a control law, and through a procedure of balancing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.inputs import Say, Triple, effects_of, load, silent

if TYPE_CHECKING:
    from twin.api.inputs import Effects, Machine, Watch
    from twin.controller import AnyController
    from twin.errors import TwinError
    from twin.flight import Run
    from twin.loop import Observer
    from twin.manoeuvre import TorqueProfile
    from twin.plant.guard.guarded import Held
    from twin.procedures.session import Balanced
    from twin.reference import Reference
    from twin.stop import Stopped

BALANCING_DURATION = 7200.0
"""After which a balancing is given up unless told otherwise [s]."""


def fly(
    platform: Machine,
    controller: str | Path | AnyController = "free_float",
    *,
    gains: Mapping[str, float] | None = None,
    reference: str | Reference | None = None,
    torque: str | TorqueProfile | None = None,
    duration: float | None = None,
    effects: Effects = (),
    attitude: Triple = (0.0, 0.0, 0.0),
    rate: Triple = (0.0, 0.0, 0.0),
    velocity: Triple = (0.0, 0.0, 0.0),
    estimator: str | None = None,
    plant: str = "sim",
    arm: str | None = None,
    identified: str | Path | None = None,
    lockstep: bool = False,
    realtime: bool = False,
    seed: int = 0,
    rrd: str | Path | None = None,
    viewer: bool = False,
    keep: bool = True,
    observers: Sequence[Observer] = (),
    watch: Watch | None = None,
    say: Say = silent,
) -> Run:
    """Fly a machine under a control law: simulated, emulated, real, or as a log has it.

    Args:
        platform: the machine.
        controller: a shipped law by its name, a file, or a law itself (`twin.controller`).
        gains: of a law by its name, that differ from its own.
        reference: `hold[:ROLL,PITCH,YAW]`, `slew:ROLL,PITCH,YAW[@RATE]`,
            `multisine[:AMPLITUDE[@FREQUENCY]]`, waves or the path of a table of attitudes
            (`twin.manoeuvre`), in degrees and hertz; `place:X,Y` or
            `move:X,Y[@ACCELERATION[,SPEED]]`, in metres and seconds; both with a + between; or a
            motion itself; None: what the law is usually given.
        torque: in place of a law, on the body in open loop: `[wheels:|gyros:|thrusters:]` and the
            path of a table or waves in N m (`twin.manoeuvre`), or a profile itself.
        duration: [s]; None: 60, the whole log that is replayed, or to the end of a table that
            states reference or torque.
        effects: what the simulated machine has beyond its platform; see `load`.
        attitude: roll, pitch, yaw at the start [rad]; a hinge takes the first.
        rate: body rates at the start [rad/s]; a hinge takes the first.
        velocity: of a body that is thrown or slides on its stage [m/s].
        estimator: a name; None: the machine's usual one.
        plant: `sim`, `pty[:FILE.toml]`, `serial[:URL]` or `replay:LOG`.
        arm: `floating` or `captured`: let commands of a machine on its bench leave.
        identified: file of an identification (`Identification.save("FILE.json")`): a machine on its
            bench flies only if its simulation, at all corners of the 95 % set, keeps off the guard.
        lockstep: of plant pty, wait for the emulation in place of keeping to the wall's clock.
        realtime: keep to the wall's clock; on a bench, run `twin.clock.ahead_of_others`.
        seed: of all random numbers.
        rrd: record into this file, too, while it flies; one that exists is written anew, but never
            on pty or serial.
        viewer: show it live in the Rerun viewer.
        keep: hold all streams in memory for `Run.recording`; else it is read from `rrd`.
        observers: see every tick.
        watch: makes one more observer, of a machine on its bench, given the time that it flies [s].
        say: takes what is flown, warnings, and sentences of a machine on its bench.

    Raises:
        TwinError: a name that is not known, parts that do not fit together, a file that is wrong
            or may not be written, a law that fails. Its `run` is what there is of a flight that it
            broke off.
    """
    from dataclasses import replace

    import numpy as np

    from twin.clock import SimulatedClock, WallClock, ahead_of_others
    from twin.errors import TwinError
    from twin.files import check_writable
    from twin.flight import BENCHES, Run, broken_off, check_start, plant_words, prepare
    from twin.loop import Ended
    from twin.metrics import Metrics, settled
    from twin.plant.initial import InitialState
    from twin.rehearsal import check_lean, identified_box
    from twin.rotation import from_euler_zyx
    from twin.stop import Stopped
    from twin.stream.provenance import provenance
    from twin.stream.recorder import FlightRecorder, MemoryRecorder, Recorded

    extra = effects_of(effects)
    kind, _, log = plant.partition(":")
    check_start(plant, identified, (*attitude, *rate, *velocity))
    path = None if rrd is None else Path(rrd)
    if path is not None:
        replayed = (Path(log),) if kind == "replay" else ()
        check_writable(path, ".rrd", anew=kind not in BENCHES, read=replayed)
    roll, pitch, yaw = attitude
    initial = InitialState(
        attitude=from_euler_zyx(np.array(yaw), np.array(pitch), np.array(roll)),
        rate_body=np.array(rate),
        velocity=np.array(velocity),
        joint_angle=float(roll),
        joint_rate=float(rate[0]),
    )
    ended_by: TwinError | Stopped | None = None
    with ExitStack() as stack:
        recording = None
        if path is not None or viewer:
            # early, so that its process comes up while the machine is compiled
            recording = stack.enter_context(Recorded(path, viewer=viewer))
        flight = prepare(
            load(platform),
            controller=str(controller) if isinstance(controller, Path) else controller,
            torque=torque,
            estimator=estimator,
            plant=plant,
            reference=reference,
            duration=duration,
            seed=seed,
            initial=initial,
            gains=gains,
            effects=extra,
            held=_table_state(arm),
            lockstep=lockstep,
            tell=say,
        )
        warnings = tuple(flight.warnings())
        what = flight.words(torque or controller, estimator, reference)
        how = plant_words(plant, seed, arm)
        say("\n".join([f"{what}, {how}", *flight.remarks(warnings)]))
        if identified is not None:
            say(check_lean(flight, identified_box(Path(identified))))
        metrics = Metrics(flight.platform, settle=settled(flight.duration), say=say)
        last = FlightRecorder(flight.plant)
        every: list[Observer] = [metrics, last, *observers]
        facts = provenance(flight.platform, seed=seed)
        memory = MemoryRecorder(flight.platform, facts) if keep else None
        if memory is not None:
            every.append(memory)
        if recording is not None:
            recording.recorder.start(flight.platform, facts)
            every.append(recording.recorder)
        # last, for a machine on its bench moves from here on
        stack.enter_context(flight.plant)
        if flight.bench is not None and watch is not None:
            every.append(stack.enter_context(watch(flight.bench, flight.duration)))
        if realtime and flight.bench is not None and not lockstep:
            for sentence in stack.enter_context(ahead_of_others()):
                say(f"--realtime: {sentence}")
        try:
            outcome = flight.fly(WallClock() if realtime else SimulatedClock(), every, say)
        except (TwinError, Stopped) as problem:
            ended_by, outcome = problem, broken_off(problem)
    if recording is not None and recording.problem is not None and ended_by is None:
        ended_by = recording.problem
        outcome = replace(outcome, ended=Ended.failed, reason=str(ended_by))
    if ended_by is not None and (path is not None or flight.bench is not None):
        last.keep(outcome.reason)
    bench = flight.bench
    row = {name: value[0] for name, value in metrics.rows().items() if np.ndim(value)}
    run = Run(
        flight.platform,
        path if memory is None else memory.recording(),
        outcome,
        row,
        metrics.settle,
        warnings,
        () if bench is None else tuple(bench.messages()),
        last.records,
        None if bench is None else bench.first_use(),
        {} if bench is None else bench.document(),
        flight.forecast(),
    )
    if ended_by is not None:
        ended_by.run = run
        raise ended_by
    return run


def balance(
    platform: Machine,
    *,
    procedure: str = "direct",
    target: float | None = None,
    effects: Effects = (),
    offset: Triple | None = None,
    random_offset: bool = False,
    stages: Triple = (0.0, 0.0, 0.0),
    runs: int = 1,
    duration: float = BALANCING_DURATION,
    plant: str = "sim",
    arm: str | None = None,
    lockstep: bool = False,
    seed: int = 0,
    rrd: str | Path | None = None,
    watch: Watch | None = None,
    say: Say = silent,
) -> Balanced:
    """Balance a machine by its sliding masses, to a stated residual torque.

    Args:
        platform: the machine.
        procedure: direct, masses, masses-and-filter, masses-and-coils, adaptive, or a package's.
        target: gravity torque that may be left at the worst attitude [N m]; None: that of the
            machine's paper, else that of 5 um.
        effects: what the simulated machine has beyond its platform; see `load`.
        offset: of the simulated machine's CM from its CR [m]; None: as its platform states.
        random_offset: draw it instead, within the masses' reach.
        stages: where the masses stand at the start [m].
        runs: so many machines at once, each with its own random offset and noise.
        duration: after which it is given up [s].
        plant: as of `fly`, but for logs.
        arm: `floating`: let commands of a machine on its bench leave.
        lockstep: as of `fly`.
        seed: of all random numbers.
        rrd: record into this file; of several runs the first. One that exists is written anew, but
            never on pty or serial.
        watch: as of `fly`.
        say: takes each remark.

    Raises:
        TwinError: options that do not go together, a machine that lacks a part, or an offset
            beyond the masses' reach.
    """
    from twin.files import check_writable
    from twin.procedures.session import BalancingSession

    session = BalancingSession(
        procedure=procedure,
        target=target,
        plant=plant,
        arm=arm,
        lockstep=lockstep,
        effects=effects_of(effects),
        offset=offset,
        random_offset=random_offset,
        stages=stages,
        runs=runs,
        duration=duration,
        seed=seed,
    )
    session.check()
    machine = load(platform)
    path = None if rrd is None else Path(rrd)
    if path is not None:
        check_writable(path, ".rrd", anew=plant == "sim")
    return session.run(machine, rrd=path, tell=say, watch=watch)


def _table_state(arm: str | None) -> Held | None:
    from twin.errors import UnknownName
    from twin.plant.guard.guarded import Held

    known = {item.value: item for item in Held}
    if arm is not None and arm not in known:
        raise UnknownName("state of a table", arm, known)
    return None if arm is None else known[arm]
