"""The Python interface, flat in `twin`: what the verbs of the command line call.

    import twin

    run = twin.fly("sads", "quaternion_pd", duration=60.0)
    print(run)
    diagnosis = twin.diagnose(run.recording)
    diagnosis.save("why.html")

Quantities are in SI units, angles in radians. A machine, a log or a law is given by its name or
path, or as the object. A result is printed by `print`, drawn by `.plot()` and written by
`.save(path)` (`twin.shown.Shown`), and holds NumPy arrays. Every user's mistake raises a
`TwinError` whose text is one sentence. `say` takes a line of progress at each step of what takes
long.

Each function imports what it needs when it is called, so that a verb loads no more than its job.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin.bench import Bench
    from twin.campaigns.answers import Answers
    from twin.campaigns.execute import CampaignRuns, Forecast
    from twin.campaigns.replay import Replayed
    from twin.comparison import Comparison, Transfer
    from twin.controller import AnyController
    from twin.diagnosis import Diagnosis, Validation
    from twin.effects import Effect
    from twin.errors import TwinError
    from twin.flight import Run
    from twin.identification import Identification
    from twin.identification import Settings as IdentificationSettings
    from twin.intake.importing import Imported
    from twin.loop import Observer
    from twin.manoeuvre import TorqueProfile
    from twin.plant.guard.guarded import Held
    from twin.platform import Platform
    from twin.procedures.session import Balanced
    from twin.recording import Recording
    from twin.reference import Reference
    from twin.report.contents import Contents
    from twin.stop import Stopped
    from twin.strapdown import GyroComparison

    Machine = str | Path | Platform
    Log = str | Path | Recording
    Effects = str | Sequence[Effect]
    Watch = Callable[[Bench, float], AbstractContextManager[Observer]]

Triple = tuple[float, float, float]
Say = Callable[[str], None]
BALANCING_DURATION = 7200.0
"""After which a balancing is given up unless told otherwise [s]."""


def _silent(_: str) -> None:
    """Print nothing."""


def load(platform: Machine, effects: Effects = ()) -> Platform:
    """A machine, with further effects.

    Args:
        platform: a shipped name (`sads`, `sads:table1`), a folder, or a machine.
        effects: what it has beyond its platform, as in `"bearing_viscous_friction=0.01"`, or
            effects themselves.

    Raises:
        UnknownName: no such machine or effect.
        PlatformError: a file that contradicts itself or physics.
        EffectError: an effect that the machine cannot have.
    """
    from twin.effects import with_effects
    from twin.platform import Platform, load_platform

    stated = platform if isinstance(platform, Platform) else load_platform(str(platform))
    return with_effects(stated, _effects(effects))


def new(folder: str | Path, kind: str = "table", log: Log | None = None) -> Platform:
    """A folder to begin a lab's own machine with: it passes `twin check` and flies as it is.

    Args:
        folder: where; its name is the machine's.
        kind: `table` on a ball bearing, `pendulum` on a hinge, or `free`, a body that is thrown.
        log: begin with the sensors of this log, their rates and their noise.

    Raises:
        UsageError: the folder exists, or a name that is none.
    """
    from twin.platform import load_platform
    from twin.scaffold import new_platform

    begun = new_platform(Path(folder), kind, None if log is None else read(log))
    return load_platform(str(begun))


def read(
    log: Log,
    *,
    start: float | None = None,
    stop: float | None = None,
    rate: float | None = None,
    say: Say = _silent,
) -> Recording:
    """A recording or a measured log: streams by name, each with `time` (m,) and `value` (m, k).

    Args:
        log: an `.rrd`, or a folder with a log.toml.
        start: leave out what was before [s].
        stop: leave out what was after [s].
        rate: of measured streams that are faster take every second, third ... row only [Hz].
        say: takes the share that is read.

    Raises:
        RecordingError: no such thing, or an `.rrd` that cannot be read.
        LogError: a folder that cannot be read, or nothing between `start` and `stop`.
    """
    from twin.recording import Recording, open_log, restricted

    if isinstance(log, Recording):
        return restricted(log, start=start, stop=stop, rate=rate)
    recording = open_log(log, say, start=start, stop=stop)
    return restricted(recording, start=None, stop=None, rate=rate)


def import_log(
    files: str | Path | Sequence[str | Path],
    folder: str | Path,
    *,
    platform: Machine | None = None,
    rate: float | None = None,
) -> Recording:
    """Make a log of recorded files of any program: `folder` gets them and a log.toml with the
    reason for each line.

    Args:
        files: text, .mcap, .bag, .db3, .ulg, .mat, .h5, .tdms, .xlsx, .parquet, or folders of such.
        folder: of the log, new or that of the files.
        platform: the machine that it is of.
        rate: of tables without times [Hz].

    Raises:
        LogError: a file that cannot be read.
    """
    imported(files, folder, platform=platform, rate=rate)
    return read(folder)


def imported(
    files: str | Path | Sequence[str | Path],
    folder: str | Path,
    *,
    platform: Machine | None = None,
    rate: float | None = None,
) -> Imported:
    """As `import_log`; returns what was proposed for each stream, and what is unsure of it."""
    from twin.intake import import_files
    from twin.library import findable

    paths = [files] if isinstance(files, str | Path) else list(files)
    machine = None if platform is None else load(platform)
    name = None if machine is None else findable(machine.folder, machine.name)
    return import_files([Path(path) for path in paths], Path(folder), machine, name, rate)


def show(log: Log, platform: Machine | None = None) -> Contents:
    """What is in a log: streams with rates, gaps, ranges and noise, what looks misread, repairs.
    It is held against a machine, by default the one that it names."""
    from twin.report.results import contents

    return contents(read(log), None if platform is None else load(platform))


def check_log(log: Log, platform: Machine | None = None) -> None:
    """Check that `identify` and `diagnose` can use a log.

    Args:
        log: measured, or a run.
        platform: the machine; None: the one that the log names.

    Raises:
        TwinError: as these would raise it.
    """
    from twin.conventions.time_base import check_times
    from twin.diagnosis import check_logs
    from twin.platform import platform_of

    recording = read(log)
    machine = platform_of(recording) if platform is None else load(platform)
    check_times(recording, machine)
    check_logs([recording], machine)


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
    say: Say = _silent,
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

    own = _effects(effects)
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
            effects=own,
            held=_held(arm),
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
        () if bench is None else tuple(bench.told()),
        last.records,
        None if bench is None else bench.first_use(),
        {} if bench is None else bench.document(),
        flight.forecast(),
    )
    if ended_by is not None:
        ended_by.run = run
        raise ended_by
    return run


def identify(
    logs: Log | Sequence[Log],
    platform: Machine | None = None,
    *,
    method: str = "prediction-error",
    settings: IdentificationSettings | None = None,
    physical: bool = False,
    say: Say = _silent,
) -> Identification:
    """Inertia and mass moment from logs of one machine, all together, with 95 % intervals.

    Args:
        logs: at least one.
        platform: the machine; None: the one that the first log names.
        method: `prediction-error`, or one of the papers' (`twin identify --help`).
        settings: of the papers' methods.
        physical: give the nearest rigid body; prediction-error always does.
        say: takes a sentence of each log that looks misread.

    Raises:
        UsageError: a log without the streams that are needed.
        UnknownName: no such method.
    """
    from twin.identification import identify as identify_logs

    recordings = _logs(logs)
    machine = _machine(recordings, platform)
    _say_misread(recordings, machine, say)
    return identify_logs(recordings, machine, method, settings, physical=physical)


def identify_by_all(
    logs: Log | Sequence[Log],
    platform: Machine | None = None,
    *,
    settings: IdentificationSettings | None = None,
    physical: bool = False,
    say: Say = _silent,
) -> Mapping[str, Identification | TwinError]:
    """As `identify`, by each method in each of its forms; for one that fails, why.

    Raises:
        TwinError: `prediction-error` fails.
    """
    from twin.identification import identify_by_all as identify_logs

    recordings = _logs(logs)
    machine = _machine(recordings, platform)
    _say_misread(recordings, machine, say)
    return identify_logs(recordings, machine, settings, physical=physical)


def compare(
    log: Log, platform: Machine | None = None, *, as_built: bool = False, say: Say = _silent
) -> Comparison:
    """What a model gets wrong about a log: misfits, free runs, and simple laws that explain them.

    Args:
        log: measured, or a run.
        platform: the machine; None: the one that the log names.
        as_built: leave the base as platform.toml states it.
        say: takes the name of each step.

    Raises:
        UsageError: the log lacks the streams that the prediction needs, or leans beyond the stop.
    """
    from twin.comparison import compare as compare_log
    from twin.identification import calibrated
    from twin.platform import platform_of

    recording = read(log)
    machine = platform_of(recording) if platform is None else load(platform)
    return compare_log(calibrated(recording, machine), machine, as_built=as_built, say=say)


def transfer(comparison: Comparison, other: Comparison) -> Transfer:
    """How well another log is predicted with the base and the laws that were fitted to the first.

    Args:
        comparison: of the log that was fitted.
        other: of the other log, on the same machine.
    """
    from twin.comparison import transfer as transfer_fit

    return transfer_fit(comparison, other)


def compare_sensors(log: Log) -> GyroComparison:
    """A log's gyro against its attitude, without a machine: bias, scale, misalignment and lag.

    Raises:
        UsageError: the log lacks one of them, or they share no motion.
    """
    from twin.strapdown import compare_gyro

    return compare_gyro(read(log))


def diagnose(
    logs: Log | Sequence[Log],
    platform: Machine | None = None,
    *,
    effects: Sequence[str | Path | type[Effect]] = (),
    say: Say = _silent,
) -> Diagnosis:
    """The causes of what a model gets wrong about logs, with their sizes and evidence.

    Args:
        logs: at least one, of one machine.
        platform: the machine; None: the one that the first log names.
        effects: of your own, files or classes, that may be causes beside those of the catalogue.
        say: takes the name of each step.

    Raises:
        UsageError: a log without the streams that the prediction needs, or too little in it.
    """
    from twin.diagnosis import diagnose as diagnose_logs
    from twin.effects import effect_named

    recordings = _logs(logs)
    custom = [
        effect if isinstance(effect, type) else effect_named(str(effect)) for effect in effects
    ]
    return diagnose_logs(recordings, machine_of(recordings, platform), own=custom, say=say)


def extend(diagnosis: Diagnosis, folder: str | Path) -> Platform:
    """The machine with what a diagnosis names, written into a new folder.

    Raises:
        UsageError: the folder exists and is not empty.
        PlatformError: the fitted base is no rigid body.
    """
    from twin.diagnosis import extend as extend_platform

    return extend_platform(diagnosis, Path(folder))


def validate(diagnosis: Diagnosis, log: Log) -> Validation:
    """How much better the extended model predicts a log that took no part.

    Raises:
        UsageError: the log lacks the streams that the prediction needs.
    """
    from twin.diagnosis import validate as validate_diagnosis

    return validate_diagnosis(diagnosis, read(log))


def machine_of(logs: Log | Sequence[Log], platform: Machine | None = None) -> Platform:
    """The machine that logs are of, under the gravity that they state.

    Args:
        logs: at least one.
        platform: the machine; None: the one that they name.

    Raises:
        UsageError: they name none, or several, or state several gravities.
    """
    from twin.platform import in_gravity_of

    recordings = _logs(logs)
    return in_gravity_of(recordings, _machine(recordings, platform))


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
    say: Say = _silent,
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
        effects=_effects(effects),
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


def campaign(
    spec: str | Path,
    folder: str | Path,
    *,
    workers: int = 1,
    cluster: str = "",
    resume: bool = False,
    trust: Sequence[str | Path] = (),
    say: Say = _silent,
) -> Answers:
    """Fly thousands of closed-loop runs that differ as a file says, and say what came of them.

    Called from a script, several workers need its `if __name__ == "__main__":`.

    Args:
        spec: the file (docs/campaigns.md).
        folder: where the results go.
        workers: processes; the results do not depend on it.
        cluster: address of a Dask scheduler, `tcp://HOST:PORT`, whose workers fly instead.
        resume: go on with what the folder holds.
        trust: folders whose laws and effects, which are programs, the file may name.
        say: takes the progress.

    Returns:
        Distributions, sensitivities and comparisons; `.results` has the runs as columns.

    Raises:
        CampaignError: a specification or a folder that cannot be used.
    """
    fly_campaign(
        spec, folder, workers=workers, cluster=cluster, resume=resume, trust=trust, say=say
    )
    return results(folder)


def fly_campaign(
    spec: str | Path,
    folder: str | Path,
    *,
    workers: int = 1,
    cluster: str = "",
    resume: bool = False,
    trust: Sequence[str | Path] = (),
    say: Say = _silent,
) -> CampaignRuns:
    """As `campaign`, without its answers: how many runs were flown, and how they ended."""
    from twin.campaigns.execute import fly_spec
    from twin.campaigns.folder import Folder
    from twin.campaigns.read import read_spec
    from twin.files import trust_folders

    _check_workers(workers)
    trust_folders(*map(Path, trust))
    stated = read_spec(Path(spec))
    return fly_spec(
        stated, Folder(Path(folder)), workers=workers, cluster=cluster, resume=resume, tell=say
    )


def forecast(spec: str | Path, *, workers: int = 1, trust: Sequence[str | Path] = ()) -> Forecast:
    """What a campaign will take: runs, time and disk, measured on a short probe in this process.

    Args:
        spec: the file (docs/campaigns.md).
        workers: processes that will fly it.
        trust: folders whose laws and effects, which are programs, the file may name.

    Raises:
        CampaignError: a specification that cannot be used.
    """
    from twin.campaigns.execute import forecast as forecast_spec
    from twin.campaigns.read import read_spec
    from twin.files import trust_folders

    _check_workers(workers)
    trust_folders(*map(Path, trust))
    return forecast_spec(read_spec(Path(spec)), workers)


def results(
    folder: str | Path,
    against: str | Path | None = None,
    *,
    trust: Sequence[str | Path] = (),
    say: Say = _silent,
) -> Answers:
    """What came of a campaign so far, beside another one.

    Args:
        folder: of the campaign.
        against: of the other one.
        trust: folders whose laws and effects, which are programs, the file may name.
        say: takes the progress.

    Raises:
        CampaignError: no campaign, or nothing of it yet.
    """
    from twin.campaigns.answers import answers
    from twin.campaigns.results import read_results
    from twin.files import trust_folders

    trust_folders(*map(Path, trust))
    flown = read_results(Path(folder))
    other = None if against is None else read_results(Path(against))
    say("computing")
    return answers(flown, other)


def replay(
    folder: str | Path,
    run: int,
    *,
    rrd: str | Path | None = None,
    trust: Sequence[str | Path] = (),
) -> Replayed:
    """One run of a campaign again, to the same bits.

    Args:
        folder: of the campaign.
        run: its number, from 0.
        rrd: record into this file.
        trust: folders whose laws and effects, which are programs, the file may name.

    Raises:
        UsageError: the campaign has no such run, or `rrd` cannot be written.
    """
    from twin.campaigns.folder import Folder
    from twin.campaigns.read import read_spec
    from twin.campaigns.replay import replay as replay_run
    from twin.files import check_writable, trust_folders

    where, path = Folder(Path(folder)), None if rrd is None else Path(rrd)
    if path is not None:
        check_writable(path, ".rrd")
    trust_folders(*map(Path, trust))
    spec = read_spec(where.spec)
    where.check_spec()
    return replay_run(spec, where, run, path)


def _held(arm: str | None) -> Held | None:
    from twin.errors import UnknownName
    from twin.plant.guard.guarded import Held

    known = {item.value: item for item in Held}
    if arm is not None and arm not in known:
        raise UnknownName("state of a table", arm, known)
    return None if arm is None else known[arm]


def _effects(effects: Effects) -> Sequence[Effect]:
    from twin.effects import parse_effects

    if isinstance(effects, str):
        return parse_effects(effects) if effects else ()
    return effects


def _logs(logs: Log | Sequence[Log]) -> list[Recording]:
    from twin.errors import UsageError
    from twin.recording import Recording

    # a recording is a mapping and no sequence
    several = [logs] if isinstance(logs, str | Path | Recording) else list(logs)
    if not several:
        raise UsageError("no log is given")
    return [read(log) for log in several]


def _machine(logs: Sequence[Recording], platform: Machine | None) -> Platform:
    from twin.platform import common_platform

    return common_platform(logs) if platform is None else load(platform)


def _say_misread(logs: Sequence[Recording], machine: Platform, say: Say) -> None:
    """A sentence of each log that looks as if it had been read in a wrong convention."""
    from twin.conventions import convention_advice
    from twin.platform import in_order_of

    for log in logs:
        warning = convention_advice(in_order_of(machine, log), machine).warning
        if warning:
            say(f"{log.source}: {warning}")


def _check_workers(workers: int) -> None:
    from twin.errors import UsageError

    if workers < 1:
        raise UsageError(f"workers is {workers}; give 1 or more")
