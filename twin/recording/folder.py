"""A recording as the folder of tables that any lab reads: log.toml and one file a stream (4.3)."""

import csv
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, cast, get_args

from twin.errors import RecordingError, UnknownName
from twin.files import whole_folder
from twin.recording.recording import Recording, Series
from twin.signals import stream_named
from twin.stop import check

Format = Literal["csv", "parquet", "mat", "mcap"]

FORMATS: tuple[str, ...] = get_args(Format)


def write_folder(
    recording: Recording, folder: str | Path, *, format: Format = "csv", truth: bool = False
) -> dict[str, Path]:
    """Write a recording as a folder; in SI, every float64 to its last bit.

    Args:
        recording: what to write.
        folder: made if it does not exist.
        format: of the streams' files. A `.mat` holds one matrix, named as the stream: the times,
            then its columns; an `.mcap` one topic of JSON messages, each with its time and columns.
        truth: write a simulation's true states too.

    Returns:
        The file of each stream. A stream without rows has none; log.toml says so.

    Raises:
        RecordingError: the folder holds files already, or cannot be written.
        Stopped: a stop was requested; nothing was written.
        UnknownName: no such format.
    """
    if format not in FORMATS:
        raise UnknownName("format", format, FORMATS)
    folder = Path(folder)
    if not truth:
        recording = recording.without_truth()
    files = {name: folder / f"{_plain(name)}.{format}" for name, s in recording.items() if len(s)}
    if len(set(files.values())) < len(files):
        raise RecordingError(
            folder, "would hold two streams in one file", "rename those that differ in signs only"
        )
    try:
        if folder.exists():
            folder.mkdir(exist_ok=True)  # refuses a file of that name
            if any(folder.iterdir()):
                raise RecordingError(folder, "is not empty", "name a new folder, or empty it")
        with whole_folder(folder) as part:
            for name, path in files.items():
                check()
                _WRITERS[format](part / path.name, name, recording[name])
            contents = _log_toml(recording, files, format)
            (part / "log.toml").write_text(contents, encoding="utf-8")
    except OSError as problem:
        raise RecordingError(
            folder, f"cannot be written: {problem.strerror}", "choose another place"
        ) from None
    return files


def _write_csv(path: Path, name: str, series: Series) -> None:
    del name
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([_clock(series), *series.columns])
        # Python writes the shortest text that reads back as the same float64
        rows = zip(series.time.tolist(), series.value.tolist(), strict=True)
        writer.writerows([time, *value] for time, value in rows)


def _write_parquet(path: Path, name: str, series: Series) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    del name
    columns = {_clock(series): series.time} | dict(zip(series.columns, series.value.T, strict=True))
    parquet.write_table(pa.table(columns), path)


def _clock(series: Series) -> str:
    """A name for the column of times that no column of values has."""
    name = "time"
    while name in series.columns:
        name = f"log_{name}"
    return name


def _write_mat(path: Path, name: str, series: Series) -> None:
    import numpy as np
    from scipy.io import savemat

    savemat(path, {_plain(name): np.column_stack([series.time, series.value])})


def _write_mcap(path: Path, name: str, series: Series) -> None:
    from mcap.writer import Writer

    clock = _clock(series)
    properties = {key: {"type": "number"} for key in (clock, *series.columns)}
    schema = {"type": "object", "properties": properties, "description": f"in {series.unit}"}
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        kind = writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
        channel = writer.register_channel(name, "json", kind)
        # Python writes the shortest text that reads back as the same float64
        rows = zip(series.time.tolist(), series.value.tolist(), strict=True)
        for index, (time, value) in enumerate(rows):
            message = {clock: time} | dict(zip(series.columns, value, strict=True))
            stamp = max(round(1e9 * time), 0)
            writer.add_message(
                channel,
                log_time=stamp,
                publish_time=stamp,
                sequence=index,
                data=json.dumps(message).encode(),
            )
        writer.finish()


_WRITERS = {"mcap": _write_mcap, "csv": _write_csv, "parquet": _write_parquet, "mat": _write_mat}


def _log_toml(recording: Recording, files: Mapping[str, Path], format: str) -> str:
    facts = recording.provenance
    lines = ["# Written by `twin export`; all values in SI."]
    if facts.get("platform") is not None:
        lines.append(f"platform = {_toml(str(facts['platform']))}")
    if facts.get("time_origin"):
        lines.append(f"time_origin = {_toml(facts['time_origin'])}")
    environment = dict(facts.get("environment") or {})
    if "gravity" in facts:
        environment.setdefault("gravity", facts["gravity"])
    lines += _table("environment", environment)
    stated = cast(Mapping[str, Mapping[str, Any]], facts.get("streams") or {})
    for name, series in recording.items():
        if name not in files:
            lines += ["", f"# {name} has no rows"]
            continue
        entry: dict[str, Any] = {"file": files[name].name}
        if format == "mat":
            entry["variable"] = _plain(name)
        elif format == "mcap":
            entry["time"] = _clock(series)
        elif (clock := _clock(series)) != "time":
            entry["time"] = clock
        entry["unit"] = series.unit
        if stated.get(name, {}).get("listed") and not _fixed(name):
            if format != "mat":  # or they would be taken by name
                entry["columns"] = list(series.columns)
        elif format == "mat" or _axes_differ(name, series):  # a matrix has no column names
            entry["axes"] = list(series.columns)
        if stated.get(name, {}).get("noise") is not None:
            entry["noise"] = stated[name]["noise"]
        if stated.get(name, {}).get("fit_scale"):
            entry["scale"] = "fit"
        lines += _table(f"streams.{_key(name)}", entry)
    notes = dict(facts.get("notes") or {})
    about = {key: facts[key] for key in ("started", "seed", "command", "versions") if key in facts}
    about |= {"repairs": list(recording.repairs)} if recording.repairs else {}
    lines += _table("notes", about | notes)
    return "\n".join(lines) + "\n"


def _axes_differ(name: str, series: Series) -> bool:
    """Whether the series has other columns than a stream of that name always has."""
    return _fixed(name) not in ((), series.columns)


def _fixed(name: str) -> tuple[str, ...]:
    """The columns that a stream of that name always has; empty where they are the machine's."""
    try:
        return stream_named(name).columns
    except UnknownName:
        return ()


def _table(name: str, entries: Mapping[str, Any]) -> list[str]:
    lines = [f"{_key(key)} = {_toml(value)}" for key, value in entries.items() if value is not None]
    return ["", f"[{name}]", *lines] if lines else []


def _toml(value: Any) -> str:
    """A JSON-able value as TOML; a table becomes its JSON text."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list | tuple):
        entries = cast(list[Any], value)
        return "[" + ", ".join(_toml(entry) for entry in entries) + "]"
    return _quoted(value if isinstance(value, str) else json.dumps(value, ensure_ascii=False))


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _plain(name: str) -> str:
    """A name that file systems and MATLAB take."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"s{plain}" if plain.startswith("_") else plain
