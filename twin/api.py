"""The Python interface, flat in `twin`: what the verbs of the command line do, as functions.

    import twin

    run = twin.fly("sads", "quaternion_pd", duration=60.0)
    print(run)
    found = twin.diagnose(run.recording)
    found.save("why.html")

Numbers are SI throughout; angles are in radians. A machine, a log or a law is given by its name or
path, or as the object. What comes back is printed by `print`, drawn by `.plot()`, written by
`.save(path)` (`twin.shown.Shown`), and holds NumPy arrays. Every mistake of a user is a `TwinError`
with a sentence. `say` takes the name of each step of what takes long.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from twin.campaigns.answers import Answers, answers
from twin.campaigns.execute import execute
from twin.campaigns.folder import Folder
from twin.campaigns.read import read_spec
from twin.campaigns.replay import Replayed, record_kept
from twin.campaigns.replay import replay as replay_run
from twin.campaigns.results import read_results
from twin.clock import SimulatedClock, WallClock
from twin.comparison import Comparison
from twin.comparison import compare as compare_log
from twin.controller import AnyController
from twin.diagnosis import Diagnosis, Validation
from twin.diagnosis import diagnose as diagnose_logs
from twin.diagnosis import extend as extend_platform
from twin.diagnosis import validate as validate_diagnosis
from twin.effects import Effect, effect_named, parse_effects, with_effects
from twin.errors import UnknownName, UsageError
from twin.flight import Run, prepare
from twin.identification import Identification, calibrated
from twin.identification import Settings as IdentificationSettings
from twin.identification import identify as identify_logs
from twin.intake import import_files
from twin.loop import Observer
from twin.metrics import Metrics, settled
from twin.plant.guard.guarded import Held
from twin.plant.initial import InitialState
from twin.platform import Platform, common_platform, in_gravity_of, load_platform, platform_of
from twin.procedures.session import CAP, Balanced, BalancingSession
from twin.recording import Recording, open_log, restricted
from twin.reference import Reference
from twin.report.contents import Contents
from twin.report.results import contents
from twin.rotation import from_euler_zyx
from twin.scaffold import new_platform
from twin.strapdown import GyroComparison, compare_gyro
from twin.stream.provenance import provenance
from twin.stream.recorder import FileRecorder, MemoryRecorder

Triple = tuple[float, float, float]
Machine = str | Path | Platform
Log = str | Path | Recording
Effects = str | Sequence[Effect]
Say = Callable[[str], None]


def _silent(_: str) -> None:
    """Say nothing."""


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
    recording = log if isinstance(log, Recording) else open_log(log, say)
    return restricted(recording, start=start, stop=stop, rate=rate)


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
    paths = [files] if isinstance(files, str | Path) else list(files)
    machine = None if platform is None else load(platform)
    name = None
    if machine is not None:
        name = platform if isinstance(platform, str) else str(machine.folder)
        name = str(Path(name).resolve()) if Path(name).exists() else name
    import_files([Path(path) for path in paths], Path(folder), machine, name, rate)
    return read(folder)


def show(log: Log) -> Contents:
    """What is in a log: streams with rates, gaps, ranges and noise, what looks misread, repairs."""
    return contents(read(log))


def fly(
    platform: Machine,
    controller: str | Path | AnyController = "free_float",
    *,
    gains: Mapping[str, float] | None = None,
    reference: str | Reference | None = None,
    duration: float | None = None,
    effects: Effects = (),
    attitude: Triple = (0.0, 0.0, 0.0),
    rate: Triple = (0.0, 0.0, 0.0),
    velocity: Triple = (0.0, 0.0, 0.0),
    estimator: str | None = None,
    plant: str = "sim",
    arm: str | None = None,
    lockstep: bool = False,
    realtime: bool = False,
    seed: int = 0,
    rrd: str | Path | None = None,
    observers: Sequence[Observer] = (),
    say: Say = _silent,
) -> Run:
    """Fly a machine under a control law: simulated, emulated, real, or as a log has it.

    Args:
        platform: the machine.
        controller: a shipped law by its name, a file, or a law itself (`twin.controller`).
        gains: of a law by its name, that differ from its own.
        reference: `hold[:ROLL,PITCH,YAW]`, `slew:ROLL,PITCH,YAW[@RATE]` or
            `multisine[:AMPLITUDE[@FREQUENCY]]`, in degrees and hertz, or a motion itself; None:
            what the law is usually given.
        duration: [s]; None: 60, or the whole log that is replayed.
        effects: what the simulated machine has beyond its platform; see `load`.
        attitude: roll, pitch, yaw at the start [rad]; a hinge takes the first.
        rate: body rates at the start [rad/s]; a hinge takes the first.
        velocity: of a body that is thrown or slides on its stage [m/s].
        estimator: a name; None: the machine's usual one.
        plant: `sim`, `pty[:FILE.toml]`, `serial[:URL]` or `replay:LOG`.
        arm: `floating` or `captured`: let commands of a machine on its bench leave.
        lockstep: of plant pty, wait for the emulation in place of keeping to the wall's clock.
        realtime: keep to the wall's clock.
        seed: of all random numbers.
        rrd: record into this file, too, while it flies.
        observers: see every tick.
        say: takes sentences of a machine on its bench.

    Raises:
        TwinError: a name that is not known, parts that do not fit together, a file that is wrong,
            a law that fails.
    """
    roll, pitch, yaw = attitude
    initial = InitialState(
        attitude=from_euler_zyx(np.array(yaw), np.array(pitch), np.array(roll)),
        rate_body=np.array(rate),
        velocity=np.array(velocity),
        joint_angle=roll,
        joint_rate=rate[0],
    )
    flight = prepare(
        load(platform),
        controller=str(controller) if isinstance(controller, str | Path) else controller,
        estimator=estimator,
        plant=plant,
        reference=reference,
        duration=duration,
        seed=seed,
        initial=initial,
        gains=gains,
        effects=_effects(effects),
        held=_held(arm),
        lockstep=lockstep,
        tell=say,
    )
    warnings = tuple(flight.warnings())
    metrics = Metrics(flight.platform, settle=settled(flight.duration))
    facts = provenance(flight.platform, seed=seed)
    memory = MemoryRecorder(flight.platform, facts)
    clock = WallClock() if realtime else SimulatedClock()
    every: list[Observer] = [metrics, memory, *observers]
    with flight.plant:
        if rrd is None:
            outcome = flight.fly(clock, every, say)
        else:
            Path(rrd).parent.mkdir(parents=True, exist_ok=True)
            with FileRecorder(rrd) as recorder:
                recorder.start(flight.platform, facts)
                outcome = flight.fly(clock, [*every, recorder], say)
    row = {name: value[0] for name, value in metrics.rows().items()}
    return Run(flight.platform, memory.recording(), outcome, row, metrics.settle, warnings)


def identify(
    logs: Log | Sequence[Log],
    platform: Machine | None = None,
    *,
    method: str = "prediction-error",
    settings: IdentificationSettings | None = None,
    physical: bool = False,
) -> Identification:
    """Inertia and mass moment from logs of one machine, all together, with 95 % intervals.

    Args:
        logs: at least one.
        platform: the machine; None: the one that the first log names.
        method: `prediction-error`, or one of the papers' (`twin identify --help`).
        settings: of the papers' methods.
        physical: give the nearest rigid body; prediction-error always does.

    Raises:
        UsageError: a log without the streams that are needed.
        UnknownName: no such method.
    """
    recordings = _logs(logs)
    machine = _machine(platform, recordings)
    return identify_logs(recordings, machine, method, settings, physical=physical)


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
    recording = read(log)
    machine = platform_of(recording) if platform is None else load(platform)
    return compare_log(calibrated(recording, machine), machine, as_built=as_built, say=say)


def compare_sensors(log: Log) -> GyroComparison:
    """A log's gyro against its attitude, without a machine: bias, scale, misalignment and lag.

    Raises:
        UsageError: the log lacks one of them, or they share no motion.
    """
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
    recordings = _logs(logs)
    own = [effect if isinstance(effect, type) else effect_named(str(effect)) for effect in effects]
    return diagnose_logs(recordings, _machine(platform, recordings), own=own, say=say)


def extend(diagnosis: Diagnosis, folder: str | Path) -> Platform:
    """The machine with what a diagnosis names, written into a new folder.

    Raises:
        UsageError: the folder exists and is not empty.
        PlatformError: the fitted base is no rigid body.
    """
    return extend_platform(diagnosis, Path(folder))


def validate(diagnosis: Diagnosis, log: Log) -> Validation:
    """How much better the extended model predicts a log that took no part.

    Raises:
        UsageError: the log lacks the streams that the prediction needs.
    """
    return validate_diagnosis(diagnosis, read(log))


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
    duration: float = CAP,
    plant: str = "sim",
    arm: str | None = None,
    lockstep: bool = False,
    seed: int = 0,
    rrd: str | Path | None = None,
    say: Say = _silent,
) -> Balanced:
    """Balance a machine by its sliding masses, to a stated residual torque.

    Args:
        platform: the machine.
        procedure: direct, masses, masses-and-coils or adaptive.
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
        rrd: record into this file; of several runs the first.
        say: takes each remark.

    Raises:
        TwinError: options that do not go together, a machine that lacks a part, or an offset
            beyond the masses' reach.
    """
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
    return session.run(load(platform), rrd=None if rrd is None else Path(rrd), tell=say)


def campaign(
    spec: str | Path,
    folder: str | Path,
    *,
    workers: int = 1,
    resume: bool = False,
    say: Say = _silent,
) -> Answers:
    """Fly thousands of closed-loop runs that differ as a file says, and say what came of them.

    Called from a script, several workers need its `if __name__ == "__main__":`.

    Args:
        spec: the file (docs/campaigns.md).
        folder: where the results go.
        workers: processes; the results do not depend on it.
        resume: go on with what the folder holds.
        say: takes the progress.

    Returns:
        Distributions, sensitivities and comparisons; `.results` has the runs as columns.

    Raises:
        CampaignError: a specification or a folder that cannot be used.
    """
    what, where = read_spec(Path(spec)), Folder(Path(folder))
    if workers < 1:
        raise UsageError(f"workers is {workers}; give 1 or more")
    execute(what, where, workers=workers, tell=say, resume=resume)
    record_kept(what, where, say)
    return answers(read_results(Path(folder)))


def results(folder: str | Path, against: str | Path | None = None) -> Answers:
    """What came of a campaign so far, beside another one.

    Raises:
        CampaignError: no campaign, or nothing of it yet.
    """
    other = None if against is None else read_results(Path(against))
    return answers(read_results(Path(folder)), other)


def replay(folder: str | Path, run: int, *, rrd: str | Path | None = None) -> Replayed:
    """One run of a campaign again, to the same bits.

    Raises:
        UsageError: the campaign has no such run.
    """
    where = Folder(Path(folder))
    spec = read_spec(where.spec)
    where.check_spec()
    return replay_run(spec, where, run, None if rrd is None else Path(rrd))


def _held(arm: str | None) -> Held | None:
    known = {item.value: item for item in Held}
    if arm is not None and arm not in known:
        raise UnknownName("state of a table", arm, known)
    return None if arm is None else known[arm]


def _effects(effects: Effects) -> Sequence[Effect]:
    if isinstance(effects, str):
        return parse_effects(effects) if effects else ()
    return effects


def _logs(logs: Log | Sequence[Log]) -> list[Recording]:
    # a recording is a mapping and no sequence
    several = [logs] if isinstance(logs, str | Path | Recording) else list(logs)
    if not several:
        raise UsageError("no log is given")
    return [read(log) for log in several]


def _machine(platform: Machine | None, logs: Sequence[Recording]) -> Platform:
    machine = common_platform(logs) if platform is None else load(platform)
    return in_gravity_of(logs, machine)
