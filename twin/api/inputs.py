"""Machines and logs, which every other function of the interface takes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from twin.bench import Bench
    from twin.effects import Effect
    from twin.intake.importing import Imported
    from twin.loop import Observer
    from twin.platform import Platform
    from twin.recording import Recording
    from twin.report.contents import Contents

    Machine = str | Path | Platform
    Log = str | Path | Recording
    Effects = str | Sequence[Effect]
    Watch = Callable[[Bench, float], AbstractContextManager[Observer]]

Triple = tuple[float, float, float]
Say = Callable[[str], None]


def silent(_: str) -> None:
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
    return with_effects(stated, effects_of(effects))


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
    say: Say = silent,
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


def machine_of(logs: Log | Sequence[Log], platform: Machine | None = None) -> Platform:
    """The machine that logs are of, under the gravity that they state.

    Args:
        logs: at least one.
        platform: the machine; None: the one that they name.

    Raises:
        UsageError: they name none, or several, or state several gravities.
    """
    from twin.platform import in_gravity_of

    recordings = read_all(logs)
    return in_gravity_of(recordings, machine_for(recordings, platform))


def effects_of(effects: Effects) -> Sequence[Effect]:
    """Effects from the text of `--effects`, or as they are.

    Raises:
        UnknownName: no effect of that name.
        EffectError: a size that the effect cannot have.
    """
    from twin.effects import parse_effects

    if isinstance(effects, str):
        return parse_effects(effects) if effects else ()
    return effects


def read_all(logs: Log | Sequence[Log]) -> list[Recording]:
    """Each log by `read`.

    Raises:
        UsageError: no log is given.
    """
    from twin.errors import UsageError
    from twin.recording import Recording

    # a recording is a mapping and no sequence
    several = [logs] if isinstance(logs, str | Path | Recording) else list(logs)
    if not several:
        raise UsageError("no log is given")
    return [read(log) for log in several]


def machine_for(logs: Sequence[Recording], platform: Machine | None) -> Platform:
    """The machine `platform`, or where that is None the one that the logs name.

    Raises:
        UsageError: the logs name none, or several.
    """
    from twin.platform import common_platform

    return common_platform(logs) if platform is None else load(platform)
