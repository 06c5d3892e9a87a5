"""`twin import`: files of a lab -> a folder with a log.toml, each line of it with its reason."""

import shutil
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.conventions import ConventionAdvice, convention_advice
from twin.errors import LogError, TwinError
from twin.intake.clocks import Clock, clock_of, quoted
from twin.intake.frames import known_frame
from twin.intake.streams import UNIT_BY_SIZE, Proposal, streams_among
from twin.intake.tables import DataTable, tables_in
from twin.platform import Platform
from twin.recording import Recording, read_log
from twin.recording.formats import ENDINGS
from twin.stop import check
from twin.whole_file import write_whole

MOVES = 0.05
"""Rate from which on a unit that is wrong shows against an attitude [rad/s]."""
ROUNDS = 2
"""Times that a log is mended and read again."""


@dataclass(frozen=True)
class Imported:
    """What became of the files."""

    folder: Path
    recording: Recording
    proposals: tuple[Proposal, ...]
    unread: tuple[str, ...]
    """A sentence for each table of which nothing is a stream that we know."""
    advice: ConventionAdvice
    """What still looks misread, or is open."""


@dataclass(frozen=True)
class _Entry:
    proposal: Proposal
    clock: Clock


def import_files(
    paths: Sequence[Path],
    folder: Path,
    platform: Platform | None,
    name: str | None,
    rate: float | None = None,
) -> Imported:
    """Look at files, write a log.toml beside copies of them, and read it.

    Args:
        paths: of the files, or of folders of such (a ROS 2 bag, say); those in `folder` already
            stay where they are.
        folder: of the log; made, and without a log.toml.
        platform: the machine, against whose wheels and rates the log is held.
        name: of the machine, as log.toml names it.
        rate: of tables without times [Hz].

    Raises:
        LogError: a file cannot be read, or nothing in any is a stream that we know.
    """
    if (folder / "log.toml").exists():
        raise LogError(folder / "log.toml", "is there already", "name a new folder")
    paths = [file for path in paths for file in _files(path)]
    for path in paths:
        if not path.is_file():
            raise LogError(path, "is no file", "name the files that the lab recorded")
        if path.suffix.lower() not in ENDINGS:
            listed = ", ".join(ENDINGS)
            raise LogError(path, "is no format that can be read", f"export it as one of {listed}")
    entries: dict[str, _Entry] = {}
    unread: list[str] = []
    for path in paths:
        for table in tables_in(path):
            check()
            clock = clock_of(table, rate)
            column = None if clock is None else clock.column
            proposals = streams_among(table, column, platform)
            if clock is None or not proposals:
                unread.append(_sentence(path, table, clock, bool(proposals)))
                continue
            for proposal in proposals:
                known_frame(proposal)
                if proposal.left_out:
                    listed = ", ".join(proposal.columns)
                    unread.append(f"{_where(path, table)}: {listed}: {proposal.left_out}")
                    continue
                if proposal.stream in entries:
                    unread.append(f"{_where(path, table)}: another {proposal.stream}, left out")
                    continue
                entries[proposal.stream] = _Entry(proposal, clock)
    if not entries:
        raise LogError(
            paths[0].parent if len(paths) > 1 else paths[0],
            "holds no stream that we recognise" + "".join(f"; {one}" for one in unread[:3]),
            "write a log.toml by hand (docs/logs.md)",
        )
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    copied: list[Path] = []
    try:
        for path in paths:
            target = folder / path.name
            if path.resolve() != target.resolve():
                if target.exists():
                    raise LogError(target, "is there already", "name a new folder")
                shutil.copy2(path, target)
                copied.append(target)
        return _mended(folder, entries, tuple(unread), platform, name)
    except BaseException:
        (folder / "log.toml").unlink(missing_ok=True)
        for target in copied:
            target.unlink(missing_ok=True)
        if made:
            folder.rmdir()
        raise


def _files(path: Path) -> list[Path]:
    """The files of a folder that can be read; a file itself."""
    if not path.is_dir():
        return [path]
    found = sorted(one for one in path.iterdir() if one.suffix.lower() in ENDINGS)
    if not found:
        raise LogError(path, "holds no file that can be read", f"of {', '.join(ENDINGS)}")
    return found


def _mended(
    folder: Path,
    entries: dict[str, _Entry],
    unread: tuple[str, ...],
    platform: Platform | None,
    name: str | None,
) -> Imported:
    """Written, read, and what physics is sure of mended."""
    recording, advice = _held_against_physics(folder, entries, unread, platform, name)
    for _ in range(ROUNDS):
        if not advice.log_toml:
            break
        _take(entries, advice)
        recording, advice = _held_against_physics(folder, entries, unread, platform, name)
    both = {"gyro", "attitude"} <= entries.keys()
    if both and not advice.findings and np.abs(recording["gyro"].value).max() > MOVES:
        gyro = entries["gyro"].proposal  # the attitude's rate has the same size
        gyro.unsure = [question for question in gyro.unsure if question != UNIT_BY_SIZE]
        write_whole(folder / "log.toml", _log_toml(entries, unread, name))
    proposals = tuple(entry.proposal for entry in entries.values())
    return Imported(folder, recording, proposals, unread, advice)


def _held_against_physics(
    folder: Path,
    entries: dict[str, _Entry],
    unread: tuple[str, ...],
    platform: Platform | None,
    name: str | None,
) -> tuple[Recording, ConventionAdvice]:
    """The log as the entries have it, and what looks misread in it."""
    write_whole(folder / "log.toml", _log_toml(entries, unread, name))
    recording = _read(folder, entries, unread, name)
    try:
        return recording, convention_advice(recording, platform)
    except TwinError:  # a log that does not fit the machine: `twin show` says how
        return recording, ConventionAdvice((), (), "", False)


def _read(
    folder: Path, entries: dict[str, _Entry], unread: tuple[str, ...], name: str | None
) -> Recording:
    """The log; without streams whose rows cannot be read, each said."""
    while True:
        try:
            return read_log(folder)
        except LogError as problem:
            culprit = next(
                (
                    stream
                    for stream in entries
                    if f"streams.{stream}" in str(problem) or f"{stream} " in str(problem)
                ),
                None,
            )
            if culprit is None or len(entries) == 1:
                raise
            entries.pop(culprit)
            sentence = str(problem).replace(f"{folder}/", "")
            unread = (*unread, f"{culprit} is left out: {sentence}")
            write_whole(folder / "log.toml", _log_toml(entries, unread, name))


def _take(entries: dict[str, _Entry], advice: ConventionAdvice) -> None:
    """Write what the conventions' search is sure of into the entries."""
    for stream, keys in tomllib.loads(advice.log_toml).get("streams", {}).items():
        if stream not in entries:
            continue
        proposal = entries[stream].proposal
        for key, value in keys.items():
            if key == "columns":
                proposal.columns = tuple(value)
            else:
                proposal.keys[key] = quoted(value) if isinstance(value, str) else f"{value!r}"
    for finding in advice.findings:
        for correction in () if finding.ambiguous else finding.corrections:
            if correction.stream in entries:
                reasons = entries[correction.stream].proposal.reasons
                reasons.append(f"against the others: {finding.sentence}")


def _log_toml(entries: dict[str, _Entry], unread: tuple[str, ...], name: str | None) -> str:
    return "\n".join(_lines(entries, unread, name)) + "\n"


def _lines(entries: dict[str, _Entry], unread: tuple[str, ...], name: str | None) -> Iterator[str]:
    yield "# Written by `twin import`: what each stream was taken for, and why."
    if name is not None:
        yield f"platform = {quoted(name)}"
    else:
        yield '# platform = "..."  # a machine of models/, or the path of yours'
    for stream, entry in entries.items():
        proposal, table = entry.proposal, entry.proposal.table
        yield ""
        for reason in (*proposal.reasons, entry.clock.reason):
            yield f"# {reason}"
        unsure = [*proposal.unsure, *([] if entry.clock.sure else ["the unit of its times"])]
        for open_question in unsure:
            yield f"# unsure: {open_question}"
        yield f"[streams.{stream}]"
        yield f"file = {quoted(table.file.path.name)}"
        for key, value in table.keys.items():
            yield f"{key} = {quoted(value)}"
        keys = entry.clock.keys | proposal.keys
        if "time_scale" in proposal.keys:
            keys.pop("time_unit", None)
        yield f"columns = [{', '.join(map(quoted, proposal.columns))}]"
        for key, value in keys.items():
            yield f"{key} = {value}"
    if unread:
        yield ""
        yield "# Not taken:"
        yield from (f"#   {sentence}" for sentence in unread)


def _where(path: Path, table: DataTable) -> str:
    part = " ".join(table.keys.values())
    return f"{path.name}{f' ({part})' if part else ''}"


def _sentence(path: Path, table: DataTable, clock: Clock | None, found: bool) -> str:
    listed = ", ".join(list(table.names)[:8]) + (", ..." if len(table.names) > 8 else "")
    if found and clock is None:
        return f"{_where(path, table)}: no column of times, and no rate: state it by --rate"
    if table.file.numbered:
        return (
            f"{_where(path, table)}: no names above its {len(table.names)} columns: write a first "
            "line of names with units (t,gyro_x [deg/s],...)"
        )
    return f"{_where(path, table)}: no stream among {listed}"
