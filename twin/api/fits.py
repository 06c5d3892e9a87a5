"""What logs say of a machine: identification, comparison, diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.inputs import Say, load, machine_for, machine_of, read, read_all, silent

if TYPE_CHECKING:
    from twin.api.inputs import Log, Machine
    from twin.comparison import Comparison, Transfer
    from twin.diagnosis import Diagnosis, Validation
    from twin.effects import Effect
    from twin.errors import TwinError
    from twin.identification import Identification
    from twin.identification import Settings as IdentificationSettings
    from twin.platform import Platform
    from twin.recording import Recording
    from twin.strapdown import GyroComparison


def identify(
    logs: Log | Sequence[Log],
    platform: Machine | None = None,
    *,
    method: str = "prediction-error",
    settings: IdentificationSettings | None = None,
    physical: bool = False,
    say: Say = silent,
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

    recordings = read_all(logs)
    machine = machine_for(recordings, platform)
    _say_misread(recordings, machine, say)
    return identify_logs(recordings, machine, method, settings, physical=physical)


def identify_by_all(
    logs: Log | Sequence[Log],
    platform: Machine | None = None,
    *,
    settings: IdentificationSettings | None = None,
    physical: bool = False,
    say: Say = silent,
) -> Mapping[str, Identification | TwinError]:
    """As `identify`, by each method in each of its forms; for one that fails, why.

    Raises:
        TwinError: `prediction-error` fails.
    """
    from twin.identification import identify_by_all as identify_logs

    recordings = read_all(logs)
    machine = machine_for(recordings, platform)
    _say_misread(recordings, machine, say)
    return identify_logs(recordings, machine, settings, physical=physical)


def compare(
    log: Log, platform: Machine | None = None, *, as_built: bool = False, say: Say = silent
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
    say: Say = silent,
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

    recordings = read_all(logs)
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


def _say_misread(logs: Sequence[Recording], machine: Platform, say: Say) -> None:
    """A sentence of each log that looks as if it had been read in a wrong convention."""
    from twin.conventions import convention_advice
    from twin.platform import in_order_of

    for log in logs:
        warning = convention_advice(in_order_of(machine, log), machine).warning
        if warning:
            say(f"{log.source}: {warning}")
