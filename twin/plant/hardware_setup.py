"""`[hardware]` of a platform.toml, or of a file of its own: which device carries which channel.

    [hardware]
    calibration = "bench_2.toml"          # without it nothing is armed

    [hardware.guard]
    max_balance_step = 0.002              # N m; the other numbers of `twin.plant.guard.rules`

    [hardware.checks.attitude]            # docs/safety.md; what is left out follows from the sensor
    frozen_after = 20                     # equal values in a row; 0: never

    [hardware.devices.feather]
    kind = "microcontroller"              # the rest are the settings of that kind
    port = "/dev/serial/by-id/usb-Adafruit_Feather_M0-if00"
    [[hardware.devices.feather.channels]]
    stream = "gyro"                       # unit, columns, number, scale, safe: docs/link.md
    columns = 3

    [hardware.streams.gyro]
    device = "feather"
    body_from_device = [0.0, 1.0, 0.0, 0.0]
    [hardware.streams.stage_position]
    device = "feather"
    scale = -1.0
    [hardware.commands.command_stage_position]
    device = "feather"
    scale = -1.0

The calibration file belongs to one machine: `platform = "..."`, and `[streams.NAME]` with `bias`
and `scale`, one number or one a column, which apply before the alignment; those of a position to
its command too.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from twin.config import Table, read_toml
from twin.errors import PlatformError, UnknownName
from twin.plant.devices.device import DeviceSettings, StreamLimits
from twin.plant.devices.kinds import KINDS
from twin.plant.guard.rules import GuardSettings, bench_settings
from twin.plant.plausibility import COMPARED, sensor_limits
from twin.platform import Platform
from twin.rotation import conjugate, matrix, multiply
from twin.signals import stream_named

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Route:
    """How one stream of a device becomes one of the machine's, or some of its columns."""

    stream: str
    """Of the machine, measured or commanded."""
    device: str
    """By the laboratory's name."""
    source: str
    """The device's own name of it."""
    columns: tuple[int, ...]
    """Which of the machine's columns, in the device's order."""
    body_from_device: Array | None = None
    """Unit quaternion that turns the device's axes into the body's; of vectors and attitudes."""
    scale: float | Array = 1.0
    """Of the device's values, one or one a column, device's order: what they should be over what
    they are."""
    bias: float | Array = 0.0
    """What the device shows at zero, SI, its own order and axes; it is taken off first."""

    def taken(self, value: Array) -> Array:
        """The machine's values of the device's, (columns,)."""
        value = (value - self.bias) * self.scale
        if self.body_from_device is None:
            return value
        if self.stream == "attitude":
            return multiply(value, conjugate(self.body_from_device))
        return matrix(self.body_from_device) @ value

    def taken_of(self, column: int, value: Array) -> Array:
        """One of the machine's columns, (1,), of a device that tells them one by one."""
        place = self.columns.index(column)
        scale = np.broadcast_to(self.scale, len(self.columns))[place]
        return (value - np.broadcast_to(self.bias, len(self.columns))[place]) * scale

    def given(self, value: Array) -> Array:
        """The device's values of the machine's: `taken` undone."""
        if self.body_from_device is not None:
            value = matrix(self.body_from_device).T @ value
        return value / self.scale + self.bias

    def shown(self, value: Array) -> Array:
        """What the device shows where the machine has `value`: `taken` undone, attitudes too."""
        if self.stream == "attitude" and self.body_from_device is not None:
            return multiply(value, self.body_from_device) / self.scale + self.bias
        return self.given(value)


_UNLIMITED = ("max_balance_step", "tilt_cutout", "rate_cutout", "watchdog")
"""Numbers of [hardware.guard] that may be infinite: the operator watches instead."""


@dataclass(frozen=True)
class HardwareSetup:
    """What is wired to a machine."""

    devices: Mapping[str, DeviceSettings]
    """By the laboratory's name."""
    measured: tuple[Route, ...]
    commanded: tuple[Route, ...]
    guard: GuardSettings
    calibration: Path | None
    """The file that was read; None: nothing may be armed."""
    checks: Mapping[str, Mapping[str, float]] = field(default_factory=dict[str, Any])
    """Stream of the machine -> what [hardware.checks] states of it, by its names."""

    @property
    def agreement(self) -> dict[str, float]:
        """Stream -> turn by which it may differ from what the rates show [rad], as stated."""
        return {name: own["agreement"] for name, own in self.checks.items() if "agreement" in own}

    def limits(self, platform: Platform, device: str) -> dict[str, StreamLimits]:
        """What the values of a device's streams can be, in its own axes and scale.

        What [hardware.checks] states counts before what the device knows of itself, and that
        before what follows from the machine's sensor.
        """
        known = self.devices[device].limits() if device in self.devices else {}
        result = dict(known)
        for route in self.measured:
            if route.device != device:
                continue
            own = known.get(route.source, StreamLimits())
            if route.stream in platform.sensors:
                smallest = float(np.min(np.abs(route.scale)))
                sensor = sensor_limits(platform, route.stream, own.resolution * smallest)
                own = replace(
                    own,
                    range=min(own.range, sensor.range / smallest),
                    largest_step=min(own.largest_step, sensor.largest_step / smallest),
                    frozen_after=sensor.frozen_after
                    if own.frozen_after is None
                    else own.frozen_after,
                    oldest=sensor.oldest,
                )
            stated = {
                k: v for k, v in self.checks.get(route.stream, {}).items() if k != "agreement"
            }
            result[route.source] = replace(own, **cast(Any, stated))
        return result


def read_hardware(platform: Platform, path: Path | None = None) -> HardwareSetup:
    """The hardware of a platform.

    Args:
        platform: whose channels are carried.
        path: a file with [hardware]; the platform's own platform.toml unless given.

    Raises:
        PlatformError: no such table, or something wrong in it, with file and line.
    """
    path = path or platform.folder / "platform.toml"
    file = read_toml(path, PlatformError)
    if "hardware" not in file:
        raise PlatformError(
            path, "no [hardware]", "say which device carries which channel (docs/hardware.md)"
        )
    table = file.table("hardware")
    calibration = None
    corrections: Mapping[str, tuple[float | Array, float | Array]] = {}
    if "calibration" in table:
        calibration = path.parent / table.text("calibration")
        corrections = _calibration(calibration, platform)
    guard = _guard(table.table("guard", required=False), platform)
    devices = _devices(table.table("devices"))
    measured = _routes(table.table("streams"), platform, devices, corrections)
    commanded = _routes(table.table("commands", required=False), platform, devices, corrections)
    _every_column(table, "streams", measured, platform)
    _every_column(table, "commands", commanded, platform)
    checks = _checks(table.table("checks", required=False), platform)
    table.close()
    return HardwareSetup(devices, measured, commanded, guard, calibration, checks)


def _devices(table: Table) -> dict[str, DeviceSettings]:
    devices: dict[str, DeviceSettings] = {}
    for name in table.keys:
        item = table.table(name)
        read = KINDS[item.text("kind", among=sorted(KINDS))]
        devices[name] = read(item, name, item.text("port"))
        item.close()
    return devices


def _guard(table: Table, platform: Platform) -> GuardSettings:
    usual = bench_settings(platform)
    cycles = round(table.number("stale_cycles", usual.stale_cycles, low=1.0))
    numbers = {
        field.name: table.number(
            field.name, getattr(usual, field.name), low=0.0, infinite=field.name in _UNLIMITED
        )
        for field in fields(GuardSettings)
        if field.name != "stale_cycles"
    }
    table.close()
    return GuardSettings(stale_cycles=cycles, **numbers)


def _checks(table: Table, platform: Platform) -> dict[str, dict[str, float]]:
    """Stream -> what is stated of its values."""
    result: dict[str, dict[str, float]] = {}
    for stream in table.keys:
        if stream not in platform.sensors:
            raise table.fail(
                stream,
                "is no sensor of this machine",
                f"name one of {', '.join(platform.sensors)}",
            )
        item, unit = table.table(stream), stream_named(stream).unit
        stated: dict[str, float] = {}
        turns = ("agreement",) if stream in COMPARED else ()
        for name in ("range", "largest_step", "oldest", *turns):
            if name in item:
                of = {"oldest": "s", "agreement": "rad"}.get(name, unit)
                stated[name] = item.number(name, low=0.0, unit=of, infinite=True)
        if "frozen_after" in item:
            stated["frozen_after"] = item.whole("frozen_after", low=0)
        item.close()
        result[stream] = stated
    table.close()
    return result


def _calibration(path: Path, platform: Platform) -> dict[str, tuple[float | Array, float | Array]]:
    """Stream -> bias and scale."""
    file = read_toml(path, PlatformError)
    machine = file.text("platform")
    if machine != platform.name.split(":")[0]:
        raise file.fail(
            "platform", f"is {machine!r}, this is {platform.name}", "name this machine's own file"
        )
    file.raw("notes")
    streams, result = file.table("streams", required=False), {}
    for stream in streams.keys:
        item = streams.table(stream)
        width = len(platform.columns(stream))
        result[stream] = item.numbers("bias", width, 0.0), _scale(item, width, 1.0)
        item.close()
    file.close()
    return result


def _routes(
    table: Table,
    platform: Platform,
    devices: Mapping[str, DeviceSettings],
    corrections: Mapping[str, tuple[float | Array, float | Array]],
) -> tuple[Route, ...]:
    routes: list[Route] = []
    for stream in table.keys:
        if stream.startswith("command_") and stream not in platform.commands:
            raise table.fail(stream, "is no command of this machine", "remove it")
        try:
            columns = platform.columns(stream)
        except UnknownName as problem:
            raise table.fail(stream, f"is not known: {problem}", "correct the name") from None
        # a commanded position is one of those that are measured
        measured = stream.removeprefix("command_")
        # a stream in parts, from several devices, is an array of tables
        many = isinstance(table.raw(stream), list)
        for item in table.tables(stream) if many else [table.table(stream)]:
            routes.append(_route(item, stream, columns, devices, corrections.get(measured)))
    return tuple(routes)


def _route(
    item: Table,
    stream: str,
    columns: tuple[str, ...],
    devices: Mapping[str, DeviceSettings],
    correction: tuple[float | Array, float | Array] | None,
) -> Route:
    device = item.text("device", among=sorted(devices))
    parts = item.texts("parts", columns)
    unknown = [part for part in parts if part not in columns]
    if unknown or len(set(parts)) < len(parts):
        raise item.fail("parts", f"are {list(parts)}", f"use each of {', '.join(columns)} once")
    numbers = tuple(columns.index(part) for part in parts)
    turn = item.numbers("body_from_device", 4) if "body_from_device" in item else None
    if turn is not None and abs(np.linalg.norm(turn) - 1.0) > 1e-6:
        raise item.fail("body_from_device", "is no unit quaternion", "scale it to length 1")
    if turn is not None and stream != "attitude" and len(columns) != 3:
        raise item.fail("body_from_device", f"cannot turn {stream}", "give `scale` or `parts`")
    scale = _scale(item, len(parts), np.ones(len(parts)))
    bias = item.numbers("bias", len(parts), np.zeros(len(parts)))
    if correction is not None:
        for_these = [np.broadcast_to(c, len(columns))[list(numbers)] for c in correction]
        bias, scale = bias + for_these[0], scale * for_these[1]
    source = item.text("source", stream)
    item.close()
    return Route(stream, device, source, numbers, turn, scale, bias)


def _scale(item: Table, width: int, usual: float | Array) -> float | Array:
    scale = item.numbers("scale", width, usual)
    if np.any(scale == 0.0):
        raise item.fail("scale", "is zero", "give what the value should be over what it is")
    return scale


def _every_column(table: Table, key: str, routes: tuple[Route, ...], platform: Platform) -> None:
    """No column twice, and a stream that is carried at all is carried whole."""
    for stream in {route.stream for route in routes}:
        names = platform.columns(stream)
        carried = [names[c] for route in routes if route.stream == stream for c in route.columns]
        if sorted(carried) != sorted(names):
            raise table.fail(
                key,
                f"carry {', '.join(carried)} of {stream}",
                f"carry each of {', '.join(names)} once",
            )
