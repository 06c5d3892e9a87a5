"""How a machine stands on its bench before it is armed: devices, clocks, streams, fitness."""

from dataclasses import dataclass

import numpy as np

from twin.bench import Bench
from twin.plant.guard.guarded import Held
from twin.rotation import to_euler_zyx
from twin.signals import stream_named
from twin.units import SPIN, unit_of

_PRINTED = {
    SPIN: (60.0 / (2.0 * np.pi), "rpm"),
    "rad": (np.degrees(1.0), "deg"),
    "rad/s": (np.degrees(1.0), "deg/s"),
    "m": (1e3, "mm"),
    "T": (1e6, "uT"),
}
"""SI unit -> factor and the unit that a laboratory reads."""


@dataclass(frozen=True)
class DeviceStatus:
    """One device."""

    name: str
    port: str
    identity: str
    """As it named itself."""
    line: str
    """What went over it, in words."""
    clock: str
    """Against the host's, in words; empty where it is not compared."""
    unfit: str
    """Why it would not be armed; empty: it would."""


@dataclass(frozen=True)
class StreamStatus:
    """The newest valid sample of one stream."""

    name: str
    columns: tuple[str, ...]
    value: tuple[float, ...]
    """SI; empty where none has come."""
    age: float
    """[s]; inf where none has come."""

    def words(self) -> str:
        """In the units that a laboratory reads."""
        if not self.value:
            return f"{self.name}: nothing valid has come"
        unit = unit_of(self.name, stream_named(self.name).unit)
        values, names, old = np.array(self.value), self.columns, f"{self.age:.2f} s old"
        if self.name == "attitude":
            yaw, pitch, roll = to_euler_zyx(values)
            values, names, unit = np.array([roll, pitch, yaw]), ("roll", "pitch", "yaw"), "rad"
        factor, unit = _PRINTED.get(unit, (1.0, unit))
        said = ", ".join(f"{n} {factor * v:.4g}" for n, v in zip(names, values, strict=True))
        return f"{self.name}: {said}{'' if unit == '1' else f' {unit}'}, {old}"


@dataclass(frozen=True)
class Status:
    """All of it."""

    devices: tuple[DeviceStatus, ...]
    streams: tuple[StreamStatus, ...]
    floating: bool | None
    """As a signal says; None: no signal does, and the operator's word decides."""
    refusals: tuple[str, ...]
    """Why it would not be armed, a sentence each; empty: it would."""
    notes: tuple[str, ...]
    """What devices have told meanwhile."""

    def words(self) -> list[str]:
        """What is printed."""
        lines: list[str] = []
        for device in self.devices:
            who = f" ({device.identity})" if device.identity else ""
            lines.append(f"{device.name}{who} at {device.port}: {device.line}")
            lines += [f"  {line}" for line in (device.clock, device.unfit) if line]
        lines += [stream.words() for stream in self.streams]
        says = {True: "it floats, a signal says", False: "it does not float, a signal says"}
        word = "no signal says whether it floats: the word of somebody who has looked decides"
        lines.append(word if self.floating is None else says[self.floating])
        lines += self.notes
        fit = "it would be armed"
        return [*lines, *self.refusals] if self.refusals else [*lines, fit]


def status(bench: Bench) -> Status:
    """Watch it for a second; nothing is armed, and nothing leaves.

    Args:
        bench: entered.
    """
    bench.watch()
    hardware, guard = bench.hardware, bench.guard
    devices = tuple(
        DeviceStatus(
            name,
            str(hardware.setup.devices[name].port),
            device.identity,
            device.counters.words(),
            _clock(bench, name),
            device.unfit(),
        )
        for name, device in hardware.devices.items()
    )
    floating = guard.seen.floating(guard.settings.air_pressure)
    # where no signal says it, the stricter of the two words
    word = Held.floating if floating is None else None
    refusals = [str(refusal) for refusal in guard.refusals(word)]
    refusals += [f"not armed: {device.unfit}" for device in devices if device.unfit]
    measured = sorted({route.stream for route in hardware.setup.measured})
    return Status(
        devices,
        tuple(_stream(bench, name) for name in measured),
        floating,
        tuple(refusals),
        tuple(hardware.notes()),
    )


def _stream(bench: Bench, name: str) -> StreamStatus:
    seen = bench.guard.seen
    value = seen.newest[name][1].tolist() if name in seen.newest else ()
    return StreamStatus(name, bench.platform.columns(name), tuple(value), seen.age(name))


def _clock(bench: Bench, name: str) -> str:
    estimate = bench.hardware.devices[name].clock
    if estimate is None:
        return ""
    drift, bound = 1e6 * estimate.drift, 1e6 * estimate.drift_half_width
    known = 1e3 * estimate.half_width
    return (
        f"its clock is known to {known:.2g} ms and gains {-drift:.0f} +- {bound:.0f} parts per "
        "million on ours"
    )
