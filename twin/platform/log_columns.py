"""A log's streams with the columns of a machine: in its order, and as many."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from twin.errors import UsageError
from twin.platform.parts import Platform
from twin.recording import Recording, Series
from twin.recording.column_names import in_order
from twin.signals import STREAMS


def in_order_of(platform: Platform, recording: Recording) -> Recording:
    """The log with every stream's columns as the machine has its parts, where they have the same
    names in another order; `repairs` says so.

    A unit in brackets, and what all names have before or behind, do not count. Columns that
    log.toml lists are in order as they stand there, whatever they are called.
    """
    streams: dict[str, Series] = dict(recording.streams)
    stated: dict[str, Any] = dict(recording.provenance.get("streams") or {})
    said: list[str] = []
    for name, series in recording.items():
        wanted = platform.columns(name) if name in STREAMS else ()
        facts: Mapping[str, Any] = stated.get(name) or {}
        named = None if facts.get("listed") else in_order(series.columns, wanted)
        if series.columns == wanted or named is None:
            continue
        order = [series.columns.index(column) for column in named]
        streams[name] = replace(series, value=series.value[:, order], columns=wanted)
        moved = {
            key: [entries[place] for place in order]
            for key in ("columns", "noise")
            if isinstance(entries := facts.get(key), list) and len(entries) == len(order)
        }
        stated |= {name: {**facts, **moved}} if facts else {}
        if named == series.columns:
            continue
        given = ", ".join(series.columns)
        said.append(f"{name}: columns {given} taken by name, as {', '.join(wanted)}")
    if all(streams[name] is series for name, series in recording.items()):
        return recording
    provenance = {**recording.provenance, "streams": stated}
    return replace(
        recording, streams=streams, provenance=provenance, repairs=(*recording.repairs, *said)
    )


def check_columns(recording: Recording, platform: Platform, streams: Iterable[str]) -> None:
    """Refuse streams of another number of columns: one axis of a gyro, wheels of another machine.

    Args:
        recording: a log.
        platform: the machine that it should be of.
        streams: those that are to be used; what the log lacks is not looked at.

    Raises:
        UsageError: naming the stream, its columns and the machine's.
    """
    for name in streams:
        if name not in recording:
            continue
        has, expected = recording[name].columns, platform.columns(name)
        if len(has) != len(expected):
            raise UsageError(
                f"the log's {name} has {len(has)} columns ({', '.join(has)}), that of "
                f"{platform.name} {len(expected)} ({', '.join(expected) or 'no such part'}): name "
                "the log's own machine, or leave this stream out of log.toml"
            )
