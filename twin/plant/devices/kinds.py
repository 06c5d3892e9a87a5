"""Kinds of devices that `[hardware.devices.NAME]` may name, and how their settings are read.

An installed package adds a kind by an entry point of the group `twin.devices`, which names a class
derived from `DeviceSettings`; its fields are read from the table.
"""

import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from twin.config import Table
from twin.errors import UnknownName, UsageError
from twin.library import Registry
from twin.plant.devices.bno08x import Bno08xSettings
from twin.plant.devices.cameras import NatNetSettings, ViconSettings
from twin.plant.devices.device import DeviceSettings
from twin.plant.devices.link import Channel
from twin.plant.devices.mdrive import MDriveSettings
from twin.plant.devices.mdrive_line import DriveSettings
from twin.plant.devices.microcontroller import BOOTLOADER_BAUD, MicrocontrollerSettings
from twin.plant.devices.mti import MtiSettings
from twin.plant.devices.solar2 import Solar2Settings
from twin.plant.devices.vn100 import Vn100Settings
from twin.signals import STREAMS

Settings = TypeVar("Settings")


def read_settings(kind: type[Settings], table: Table, **given: Any) -> Settings:
    """Settings of a kind; what the table does not have keeps its usual value.

    Args:
        kind: a dataclass of numbers, flags, texts, pairs, and mappings of numbers.
        table: of the device; the caller closes it.
        given: fields that do not come from the table.

    Raises:
        FileError: a value of another type, one that is missing, or one that the device has not,
            with file and line.
    """
    hints = get_type_hints(kind)
    read = {
        entry.name: _value(table, entry, hints[entry.name])
        for entry in fields(cast(Any, kind))
        if entry.name not in given and (entry.name in table or _required(entry))
    }
    try:
        return kind(**given, **read)
    except (UsageError, UnknownName) as problem:
        first = next(iter(read), "kind")
        raise table.fail(first, f"and the keys beside it: {problem}", "correct it") from None


def _required(entry: Field[Any]) -> bool:
    return entry.default is MISSING and entry.default_factory is MISSING


def _value(table: Table, entry: Field[Any], hint: Any) -> Any:
    name, origin = entry.name, get_origin(hint)
    if origin in (Union, types.UnionType):
        hint = next(arg for arg in get_args(hint) if arg is not type(None))
        origin = get_origin(hint)
    if origin is Literal:
        return table.text(name, among=get_args(hint))
    if origin is tuple:
        return tuple(table.numbers(name, len(get_args(hint))).tolist())
    if origin is not None and issubclass(origin, Mapping):
        return _mapping(table.table(name), *get_args(hint))
    if hint is bool:
        return _flag(table, name)
    if hint is int:
        return table.whole(name)
    return table.number(name) if hint is float else table.text(name)


def _mapping(table: Table, key_type: type, value_type: Any) -> dict[Any, Any]:
    """`1 = [2, 0]` where the values are pairs, `gyro = 100` where they are numbers."""
    result: dict[Any, Any] = {}
    for key in table.keys:
        try:
            name = key_type(key)
        except ValueError:
            raise table.fail(key, "is no number", "number its keys") from None
        if get_origin(value_type) is tuple:
            pair = table.numbers(key, len(get_args(value_type)))
            result[name] = tuple(round(item) for item in pair.tolist())
        else:
            result[name] = table.whole(key) if value_type is int else table.number(key)
    return result


def _flag(table: Table, key: str) -> bool:
    value = table.raw(key)
    if not isinstance(value, bool):
        raise table.fail(key, f"is {value!r}", "say true or false")
    return value


_NUMBERS: Mapping[str, Literal["float32", "int32"]] = {"float32": "float32", "int32": "int32"}
_SAFE: Mapping[str, Literal["", "zero", "hold"]] = {"": "", "zero": "zero", "hold": "hold"}


def _microcontroller(table: Table, name: str, port: str) -> DeviceSettings:
    channels = tuple(_channel(row) for row in table.tables("channels"))
    if not channels:
        raise table.fail("channels", "are missing", "state them in the order of the firmware")
    usual = MicrocontrollerSettings(name=name, port=port, channels=channels)
    baud = round(table.number("baud", usual.baud, low=300.0))
    if baud == BOOTLOADER_BAUD:
        raise table.fail("baud", "is 1200, which resets a SAMD21", "set another rate")
    return MicrocontrollerSettings(
        name=name,
        port=port,
        channels=channels,
        baud=baud,
        valid_for=table.number("valid_for", usual.valid_for, low=0.001, high=65.0, unit="s"),
        silence=table.number("silence", usual.silence, low=0.01, unit="s"),
        clock_period=table.number("clock_period", usual.clock_period, low=0.01, unit="s"),
    )


def _channel(row: Table) -> Channel:
    stream = row.text("stream")
    unit = row.text("unit", STREAMS[stream].unit) if stream in STREAMS else row.text("unit")
    try:
        channel = Channel(
            stream,
            unit,
            round(row.number("columns", low=1.0)),
            _NUMBERS[row.text("number", "float32", among=tuple(_NUMBERS))],
            row.number("scale", 1.0),
            _SAFE[row.text("safe", "", among=tuple(_SAFE))],
        )
    except ValueError as problem:
        raise row.fail("stream", f"cannot travel: {problem}", "correct the channel") from None
    row.close()
    return channel


def _mdrive(table: Table, name: str, port: str) -> DeviceSettings:
    rows = table.tables("drives")
    if not rows:
        raise table.fail("drives", "are missing", "state each drive of the line: [[...drives]]")
    drives = tuple(read_settings(DriveSettings, row) for row in rows)
    for row in rows:
        row.close()
    return read_settings(MDriveSettings, table, name=name, port=port, drives=drives)


Read = Callable[[Table, str, str], DeviceSettings]


def _of(kind: type[DeviceSettings]) -> Read:
    """What reads settings whose fields are the keys of their table."""
    return lambda table, name, port: read_settings(kind, table, name=name, port=port)


def _installed(brought: Any) -> Read | None:
    """What reads the settings of a class that an installed package brings."""
    if not (isinstance(brought, type) and issubclass(brought, DeviceSettings)):
        return None
    return _of(brought)


KINDS: Mapping[str, Read] = Registry(
    "twin.devices",
    {
        "microcontroller": _microcontroller,
        "mdrive": _mdrive,
        "bno08x": _of(Bno08xSettings),
        "mti": _of(MtiSettings),
        "natnet": _of(NatNetSettings),
        "solar2": _of(Solar2Settings),
        "vicon": _of(ViconSettings),
        "vn100": _of(Vn100Settings),
    },
    _installed,
)
"""Kind -> what reads the settings from their table, given the device's name and port."""
