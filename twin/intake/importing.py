"""`twin import`: files of a lab -> a folder with a log.toml, each line of it with its reason."""

import json
import re
import shutil
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin.conventions import ConventionAdvice, convention_advice
from twin.errors import LogError, TwinError
from twin.files import write_whole
from twin.intake.streams import UNIT_BY_SIZE, Proposal, hinged_among, streams_among
from twin.intake.tables import DataTable, tables_in
from twin.platform import Platform
from twin.recording import Recording, read_log
from twin.recording.column_names import is_clock, is_counter, names_a_clock, stated_time_unit
from twin.recording.formats import ENDINGS
from twin.stop import check
from twin.units import known_unit

_TURNED = {
    "down": (("", 0), ("-", 1), ("-", 2)),
    "y up": (("", 0), ("-", 2), ("", 1)),
}
"""Which column, and with which sign, each of our axes is."""


_PX4 = re.compile(r"_(vehicle_(attitude|imu|angular_velocity|acceleration)|sensor_\w+)(_\d+)?$")
"""How ulog2csv names the files of the topics that have axes."""
_CORE_MOTION = re.compile(r"^accelerometerAcceleration[XYZ]\(G\)$")
"""How SensorLog for iOS names what Apple's Core Motion gives."""


def known_frame(proposal: Proposal) -> None:
    """Turn a stream whose program has axes of its own, and say so."""
    table = proposal.table
    path = table.file.path
    autopilot = "north, east, down and forward, right, down"
    of_px4 = path.suffix.lower() == ".ulg" or table.type.startswith("px4_msgs/")
    if of_px4 or _PX4.search(path.stem) or "timestamp_sample" in table.names:
        _turn(proposal, "down", f"PX4 has {autopilot}")
    elif table.type == "DataFlash" or "TimeUS" in table.names:  # its messages as CSV
        _turn(proposal, "down", f"ArduPilot has {autopilot}")
    elif proposal.stream == "accelerometer" and _CORE_MOTION.search(proposal.columns[0]):
        proposal.columns = tuple(f"-{name}" for name in proposal.columns)
        proposal.reasons.append("Core Motion shows -1 g along an axis that points up")
    elif any("MIP Monitor" in line for line in table.preamble):
        _turn(proposal, "down", f"MicroStrain has {autopilot}")
    elif any(line.startswith("Format Version") for line in table.preamble):
        _turn(proposal, "y up", "Motive has y up, unless it was told otherwise")
        proposal.unsure.append("whether Motive exported with y up")


def _turn(proposal: Proposal, frame: str, reason: str) -> None:
    columns, order = proposal.columns, _TURNED[frame]
    if proposal.stream == "attitude" and len(columns) == 4:
        turned = (columns[0], *(sign + columns[1 + place] for sign, place in order))
    elif proposal.keys.get("format") == '"euler_zyx"' and frame == "down":
        turned = tuple(sign + column for sign, column in zip(("-", "-", ""), columns, strict=True))
    elif proposal.stream in ("gyro", "accelerometer", "magnetometer", "position", "velocity"):
        turned = tuple(sign + columns[place] for sign, place in order)
    else:
        return
    proposal.columns = turned
    proposal.reasons.append(reason)


_NUMBER = r"\W*(\d+(?:\.\d+)?)"
_PERIOD = re.compile(r"^delta[_ ]?x\W+(\d+(?:[.,]\d+)?(?:E[+-]?\d+)?)", re.IGNORECASE)
"""How LabVIEW states the time from one row to the next [s]."""
_RATES = (
    rf"(?:update|sampl\w*|output|capture|export|frame|actual)[ _]*(?:frame[ _]*)?rate{_NUMBER}",
    rf"^(?:sampl\w*[ _]*)?freq\w*{_NUMBER}",
    rf"^fs{_NUMBER}",
    r"^(\d+(?:\.\d+)?)$",
)
"""How preambles state a rate, the surest first; Vicon's is a number alone on its line."""
COMMON = (0.5, 5e3)
"""Rates of logs [Hz]."""
FASTEST = 1e5
"""A larger number in a preamble is no rate [Hz]."""
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True)
class RowClock:
    """Keys of log.toml, each a TOML value, and why."""

    keys: dict[str, str]
    reason: str
    column: str | None
    sure: bool = True


def clock_of(table: DataTable, rate: float | None) -> RowClock | None:
    """The clock of a table; None where nothing tells when its rows were.

    Args:
        table: whose rows.
        rate: of tables without times, as the lab says [Hz].
    """
    if table.file.clocks:
        clock = _running(table)
        keys = {} if clock == table.file.time else {"time": quoted(clock)}
        return RowClock(keys, f"{clock} is a time by its type", clock)
    for test in (is_clock, names_a_clock):
        for name in table.names:
            if test(name.rpartition(".")[2]) and (result := _timed(table, name)) is not None:
                return result
    reason = "stated"
    if rate is None:
        rate, reason = _rate_in(table.preamble), "by the lines beside the table"
    counter = next((name for name in table.names if is_counter(name.rpartition(".")[2])), None)
    if rate is not None:
        keys = {"rate": f"{rate:g}"}
        reason = f"{rate:g} Hz, {reason}"
        if counter is not None and _counts(table, counter):
            return RowClock(
                {"time": quoted(counter), **keys}, f"{reason}, counted by {counter}", counter
            )
        return RowClock(keys, reason, None)
    for name in table.names[:1]:
        if (result := _timed(table, name)) is not None:
            return result
    return None


def _running(table: DataTable) -> str:
    """The first of the columns that are times by their type, and goes on: a date without a time
    does not, beside a time of day."""
    first = table.file.time
    clocks = sorted(table.file.clocks, key=lambda name: name != first)
    for name in clocks:
        column = table.column(name)
        steps = np.zeros(0) if column is None else np.diff(column[np.isfinite(column)])
        if len(steps) and (steps > 0.0).mean() > 0.5:
            return name
    return clocks[0]


def _timed(table: DataTable, name: str) -> RowClock | None:
    """A column as times, in the unit that it states or that its steps have."""
    column = table.column(name)
    if column is None:
        return None
    times = column[np.isfinite(column)]
    steps = np.diff(times)
    if len(steps) < 2 or (steps < 0.0).mean() > 0.01 or not (steps > 0.0).mean() > 0.5:
        return None
    step = float(np.median(steps[steps > 0.0]))
    if step == 1.0 and (times == np.round(times)).all() and not is_clock(name.rpartition(".")[2]):
        return None
    keys = {} if name == table.file.header[0] else {"time": quoted(name)}
    text = table.unit(name) or stated_time_unit(name)
    if text:
        unit = known_unit(text.strip("[]() "))
        if unit is not None and unit.si == "s":
            rate = 1.0 / (step * unit.factor)
            if COMMON[0] / 10.0 <= rate <= 10.0 * COMMON[1]:
                stated = {} if unit.factor == 1.0 else {"time_unit": quoted(text.strip("[]() "))}
                return RowClock(keys | stated, f"{name}, in {text}: {rate:.4g} Hz", name)
    if "sampletimefine" in name.lower().replace("_", ""):
        tick = _tick_of_xsens(step, _rate_in(table.preamble))
        return RowClock(
            keys | {"time_scale": f"{tick:g}"}, f"{name} counts {1e3 * tick:g} ms", name
        )
    fitting = [u for u, s in UNITS.items() if COMMON[0] <= 1.0 / (step * s) <= COMMON[1]]
    if not fitting:
        rate = _rate_in(table.preamble)
        if rate is None:
            return None
        return RowClock(
            keys | {"time_scale": f"{1.0 / (rate * step):.6g}"},
            f"{name} in steps of {step:g}, {rate:g} Hz by the lines above the table",
            name,
        )
    unit_text = fitting[0]
    rate = 1.0 / (step * UNITS[unit_text])
    stated = {} if unit_text == "s" else {"time_unit": quoted(unit_text)}
    sure = len(fitting) == 1
    return RowClock(keys | stated, f"{name} in {unit_text}: {rate:.4g} Hz", name, sure)


def _tick_of_xsens(step: float, rate: float | None) -> float:
    """Seconds of a count of SampleTimeFine: 0.1 ms of an MTi, 1 us of a DOT.

    Args:
        step: between two rows, in counts.
        rate: that the file states [Hz]; without it, an MTi gives 1 Hz or more.
    """
    slowest = 1.0 if rate is None else 0.1 * rate
    return 1e-4 if 1e-4 * step * slowest <= 1.0 else 1e-6


def _counts(table: DataTable, name: str) -> bool:
    column = table.column(name)
    if column is None or not np.isfinite(column).all():
        return False
    return bool((column == np.round(column)).all() and (np.diff(column) > 0.0).mean() > 0.9)


def _rate_in(preamble: Sequence[str]) -> float | None:
    for pattern in _RATES:
        for line in preamble:
            result = re.search(pattern, line.strip(" ,;\t"), re.IGNORECASE)
            if result and 0.0 < float(result[1]) < FASTEST:
                return float(result[1])
    periods = (_PERIOD.match(line.strip()) for line in preamble)
    period = next((float(item[1].replace(",", ".")) for item in periods if item), 0.0)
    return 1.0 / period if period > 1.0 / FASTEST else None


def quoted(text: str) -> str:
    """A text as TOML writes it."""
    return json.dumps(text, ensure_ascii=False)


MOVES = 0.05
"""Rate from which on a unit that is wrong shows against an attitude [rad/s]."""
ROUNDS = 2
"""Times that a log is mended and read again."""
LISTED = 8
"""Columns that a sentence names; of more it says how many."""


@dataclass(frozen=True)
class Imported:
    """What became of the files."""

    folder: Path
    recording: Recording
    proposals: tuple[Proposal, ...]
    unread: tuple[str, ...]
    """A sentence for each table of which nothing is a stream that we know, and for the columns of
    the others that are in none."""
    advice: ConventionAdvice
    """What still looks misread, or is open."""


@dataclass(frozen=True)
class _Entry:
    proposal: Proposal
    clock: RowClock


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
                unread.append(_sentence(path, table, clock, platform, result=bool(proposals)))
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
            unread += _unused(path, table, clock, proposals)
    if not entries:
        raise LogError(
            paths[0].parent if len(paths) > 1 else paths[0],
            "holds no stream that we recognise" + "".join(f"; {item}" for item in unread[:3]),
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
    result = sorted(item for item in path.iterdir() if item.suffix.lower() in ENDINGS)
    if not result:
        raise LogError(path, "holds no file that can be read", f"of {', '.join(ENDINGS)}")
    return result


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


def _sentence(
    path: Path,
    table: DataTable,
    clock: RowClock | None,
    platform: Platform | None,
    *,
    result: bool,
) -> str:
    listed = ", ".join(table.names[:LISTED]) + (", ..." if len(table.names) > LISTED else "")
    if result and clock is None:
        return f"{_where(path, table)}: no column of times, and no rate: state it by --rate"
    if table.file.numbered:
        return (
            f"{_where(path, table)}: no names above its {len(table.names)} columns: write a first "
            "line of names with units (t,gyro_x [deg/s],...)"
        )
    said = f"{_where(path, table)}: no stream among {listed}"
    if platform is None and hinged_among(table):
        said += "; of a machine on a hinge --platform tells which are its angle, rate and torque"
    return said


def _unused(
    path: Path, table: DataTable, clock: RowClock, proposals: Sequence[Proposal]
) -> Iterator[str]:
    """A sentence that names the columns with numbers that are in no stream, if there are any."""
    used = {clock.column, *table.file.clocks}
    used |= {column.removeprefix("-") for item in proposals for column in item.columns}
    left = [
        name
        for name in table.names
        if {name, f"-{name}"}.isdisjoint(used) and table.column(name) is not None
    ]
    if left:
        more = f" and {len(left) - LISTED} more" if len(left) > LISTED else ""
        yield f"{_where(path, table)}: in no stream: {', '.join(left[:LISTED])}{more}"
