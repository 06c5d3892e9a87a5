"""Kinds of devices that `[hardware.devices.NAME]` may name, and how their settings are read."""

from collections.abc import Callable, Mapping
from typing import Literal

from twin.config import Table
from twin.plant.devices.device import DeviceSettings
from twin.plant.devices.link import Channel
from twin.plant.devices.mdrive.mdrive import MDriveSettings
from twin.plant.devices.mdrive.settings import DriveSettings
from twin.plant.devices.microcontroller import BOOTLOADER_BAUD, MicrocontrollerSettings
from twin.plant.devices.settings_table import read_settings
from twin.plant.devices.solar2.solar2 import Solar2Settings
from twin.plant.devices.xbus.mti import MtiSettings
from twin.signals import STREAMS

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


def _mti(table: Table, name: str, port: str) -> DeviceSettings:
    return read_settings(MtiSettings, table, name=name, port=port)


def _solar2(table: Table, name: str, port: str) -> DeviceSettings:
    return read_settings(Solar2Settings, table, name=name, port=port)


KINDS: Mapping[str, Callable[[Table, str, str], DeviceSettings]] = {
    "microcontroller": _microcontroller,
    "mdrive": _mdrive,
    "mti": _mti,
    "solar2": _solar2,
}
"""Kind -> what reads the settings from their table, given the device's name and port."""
