"""The machine of a log, and the log's streams in that machine's columns."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError, UnknownName, UsageError
from twin.library import find_model
from twin.platform.load import load_platform
from twin.platform.parts import Platform, Sensor
from twin.recording import Recording, Series
from twin.recording.column_names import in_order
from twin.signals import STREAMS

Array = NDArray[np.float64]


FLOOR = {
    "attitude": ("heading", (2,)),
    "gyro": ("heading_rate", (2,)),
    "position": ("position", (0, 1)),
    "velocity": ("velocity", (0, 1)),
}
"""Of a machine on a floor: what a sensor's stream is for a prediction, and which of its numbers."""
TURNING = ("attitude", "gyro", "magnetometer", "wheel_speed", "gimbal_angle", "gimbal_rate")
"""Sensors that read the same wherever the body falls."""


def platform_of(recording: Recording) -> Platform:
    """The platform that a recording names.

    Raises:
        UsageError: it names none, or one that is not there.
        UnknownName: it names a variant that is not there.
        PlatformError: its platform.toml is wrong.
    """
    name = recording.provenance.get("platform")
    source = recording.source
    if not isinstance(name, str):
        raise UsageError(
            f"{source} names no platform; add `platform` to its log.toml, or name the machine with "
            "--platform"
        )
    try:
        find_model(name)
    except UsageError as ambiguous:
        raise UsageError(f"{source}: {ambiguous}, in `platform` or --platform") from None
    except UnknownName as unknown:
        looked = f"in {Path.cwd()} and among the shipped ones"
        if recording.provenance.get("kind") == "log":
            looked = f"in {source}, beside it, {looked}"
        raise UsageError(
            f"{unknown}; looked {looked}: correct `platform` in log.toml, or name the machine with "
            "--platform"
        ) from None
    return load_platform(name)


def platform_or_reason(recording: Recording) -> tuple[Platform | None, str]:
    """The platform that a recording names, or why it cannot be had; None and nothing where it names
    none."""
    if recording.provenance.get("platform") is None:
        return None, ""
    try:
        return platform_of(recording), ""
    except TwinError as problem:
        return None, str(problem)


def in_gravity_of(recordings: Sequence[Recording], platform: Platform) -> Platform:
    """The machine where logs of it were measured: under the gravity that they state; one that falls
    freely, about its centre of mass.

    Raises:
        UsageError: they state several; or it falls, and its centre of mass moves in it.
    """
    stated: dict[float, str] = {}
    for recording in recordings:
        gravity = (recording.provenance.get("environment") or {}).get("gravity")
        if gravity is not None:
            stated.setdefault(float(gravity), str(recording.provenance.get("source", "a log")))
    if len(stated) > 1:
        said = ", ".join(f"{source} has {gravity:g}" for gravity, source in stated.items())
        raise UsageError(
            f"logs are taken together under one gravity, and {said} m/s^2: correct `gravity` under "
            "[environment] in their log.toml"
        )
    platform = replace(platform, gravity=next(iter(stated))) if stated else platform
    if platform.base.on_floor:
        return on_floor(platform)
    return about_center_of_mass(platform) if platform.base.kind == "free" else platform


def on_floor(platform: Platform) -> Platform:
    """A locked ball on a planar stage, as it is predicted: in x, y and heading.

    Its sensors of attitude and rate show heading and rate of turn about the vertical, its cameras
    x and y.
    """
    if platform.base.kind == "planar":
        return platform
    sensors: dict[str, Sensor] = {}
    for name, sensor in platform.sensors.items():
        if name in FLOOR:
            stream, columns = FLOOR[name]
            noise, bias = sensor.noise[list(columns)], sensor.bias[list(columns)]
            sensors[stream] = replace(sensor, stream=stream, noise=noise, bias=bias)
        elif name not in ("inclinometer", "accelerometer", "magnetometer"):
            sensors[name] = sensor
    return replace(platform, base=replace(platform.base, kind="planar", locked=()), sensors=sensors)


def floor_log(recording: Recording) -> Recording:
    """A log with the streams that a machine shows in x, y and heading; others stay as they are."""
    streams: dict[str, Series] = {}
    facts: dict[str, Any] = dict(recording.provenance.get("streams") or {})
    for name, series in recording.items():
        if name not in FLOOR or not len(series):
            streams[name] = series
            continue
        stream, columns = FLOOR[name]
        value = series.value
        if name == "attitude":
            w, x, y, z = series.value.T
            heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
            shown = Series(series.time, np.unwrap(heading)[:, None], ("heading",), "rad")
        elif value.shape[1] <= len(columns):
            shown = series
        else:
            names = tuple(series.columns[i] for i in columns)
            shown = Series(series.time, value[:, list(columns)], names, series.unit)
        streams[stream] = shown
        known = dict(facts.get(name) or {})
        if isinstance(noise := known.get("noise"), list) and len(noise) > len(columns):
            known["noise"] = [noise[i] for i in columns]
        facts[stream] = known
    return replace(
        recording, streams=streams, provenance={**recording.provenance, "streams": facts}
    )


def about_center_of_mass(platform: Platform) -> Platform:
    """A body that falls freely, as it turns: on a ball in its centre of mass, without weight.

    J is about the centre of mass then, and m r is zero.

    Raises:
        UsageError: its stages move the centre of mass, or thrusters push it.
    """
    for parts, why in ((platform.stages, "stages move"), (platform.thrusters, "thrusters push")):
        if parts:
            raise UsageError(
                f"{platform.name} falls freely while its {why} its centre of mass, which cannot be "
                "predicted from a log yet; use a log of a body that turns in its bearing"
            )
    moment, mass = platform.center_of_mass_offset, platform.mass
    carried = (moment @ moment * np.eye(3) - np.outer(moment, moment)) / mass
    return replace(
        platform,
        base=replace(platform.base, kind="ball", falls=True),
        inertia=platform.inertia - carried,
        center_of_mass_offset=np.zeros(3),
        gravity=0.0,
        sensors={name: item for name, item in platform.sensors.items() if name in TURNING},
    )


def field_world(recording: Recording, platform: Platform | None) -> Array:
    """(3,) the field that a log states, or else the platform [T]; 0 where neither does."""
    unknown = np.zeros(3) if platform is None else platform.magnetic_field
    surroundings = recording.provenance.get("environment") or {}
    return np.asarray(surroundings.get("magnetic_field", unknown), dtype=np.float64)


def other_machine(recording: Recording, platform: Platform) -> str:
    """The machine that a recording names, where it is not this one; else empty."""
    name = recording.provenance.get("platform")
    if not isinstance(name, str) or name == platform.name:
        return ""
    try:
        folder, variant = find_model(name)
    except UnknownName:
        return name
    except UsageError:  # of two machines of that name this is one, or it is neither
        return "" if name.partition(":")[0] == platform.folder.name else name
    same = folder.resolve() == platform.folder.resolve()
    return "" if same and variant == platform.name.partition(":")[2] else name


def common_platform(recordings: Sequence[Recording]) -> Platform:
    """The one platform that all of some recordings name.

    Raises:
        UsageError: one names none, or another than the first.
    """
    first = recordings[0]
    for other in recordings[1:]:
        item, two = first.provenance.get("platform"), other.provenance.get("platform")
        if item != two:
            raise UsageError(
                f"{first.provenance.get('source', 'the first log')} is of {item or 'no platform'}, "
                f"{other.provenance.get('source', 'another')} of {two or 'no platform'}: logs are "
                "taken together of one machine only; if it is one, name it with --platform"
            )
    return platform_of(first)


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
        if name in ("position", "velocity") and platform.base.on_floor and has == ("x", "y"):
            continue
        if len(has) != len(expected):
            raise UsageError(
                f"the log's {name} has {len(has)} columns ({', '.join(has)}), that of "
                f"{platform.name} {len(expected)} ({', '.join(expected) or 'no such part'}): name "
                "the log's own machine, or leave this stream out of log.toml"
            )
