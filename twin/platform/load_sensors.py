"""Read a sensor's table out of platform.toml."""

import math

import numpy as np

from twin.config import Table
from twin.platform.load_parts import Parts
from twin.platform.mjcf import Layout
from twin.platform.parts import Base, Sensor
from twin.signals import stream_named

MEASURED = (
    "gyro",
    "attitude",
    "inclinometer",
    "accelerometer",
    "magnetometer",
    "position",
    "velocity",
    "wheel_speed",
    "gimbal_angle",
    "gimbal_rate",
    "stage_position",
    "joint_angle",
    "joint_rate",
    "gas_pressure",
)
"""Streams that the simulated plant can measure."""

_AT_SITE = ("inclinometer", "accelerometer")


def read_sensor(
    sensors: Table,
    stream: str,
    parts: Parts,
    base: Base,
    layout: Layout,
    timing: tuple[float, float],
) -> Sensor:
    """The table [sensors.STREAM]; `timing` is the physics step [s] and the control rate [Hz]."""
    if stream not in MEASURED:
        raise sensors.fail(
            stream,
            "is no stream that the simulation measures",
            "use " + ", ".join(MEASURED),
        )
    table = sensors.table(stream)
    width = _width(stream, parts, base)
    if width == 0:
        raise sensors.fail(stream, "measures a part the machine does not have", "remove it")
    unit = "rad" if stream == "attitude" else stream_named(stream).unit
    none = np.zeros(width)
    step, control_rate = timing
    sensor = Sensor(
        stream=stream,
        rate=_rate(table, step, control_rate),
        noise=table.numbers("noise", width, low=0.0, unit=unit),
        bias=table.numbers("bias", width, none, low=0.0, unit=unit),
        resolution=table.number("resolution", 0.0, low=0.0, unit=unit),
        range=table.number("range", np.inf, low=1e-12, unit=unit, infinite=True),
        latency=table.number("latency", 0.0, low=0.0, high=1.0, unit="s"),
        dropout=table.number("dropout", 0.0, low=0.0, high=1.0),
        cutoff=table.number("cutoff", np.inf, low=1e-3, unit="Hz", infinite=True),
        order=_order(table),
        site=_site(table, stream, layout),
        window=_window(table, stream),
    )
    if np.isfinite(sensor.cutoff) and sensor.cutoff >= 0.5 / step:
        raise table.fail(
            "cutoff",
            f"is {sensor.cutoff:g} Hz, which steps of {step:g} s cannot show",
            f"keep it below {0.5 / step:g} Hz, or choose a smaller simulation.step",
        )
    if stream == "attitude":
        _check_attitude(table, sensor)
    table.close()
    return sensor


def _rate(table: Table, step: float, control_rate: float) -> float:
    rate = table.number("rate", low=1e-3, unit="Hz")
    if rate * step > 1.0 + 1e-9:
        steps = math.ceil(rate / control_rate * (1.0 - 1e-9))
        raise table.fail(
            "rate",
            f"is {rate:g} Hz, but there is at most one sample a step of {step:g} s",
            f"give at most {1.0 / step:g} Hz, or a simulation.step of "
            f"{1.0 / (control_rate * steps):.6g} s",
        )
    return rate


def _order(table: Table) -> int:
    order = table.number("order", 4, low=1, high=8)
    if order != int(order):
        raise table.fail("order", f"is {order:g}", "give a whole number of poles, 1 to 8")
    return int(order)


def _check_attitude(table: Table, sensor: Sensor) -> None:
    """What is no matter of a quaternion's four numbers, each by itself."""
    if np.isfinite(sensor.cutoff):
        raise table.fail("cutoff", "filters a quaternion", "filter the gyro instead")
    if sensor.resolution > 0.0:
        raise table.fail("resolution", "rounds a quaternion", "add what it is worth to `noise`")
    if np.isfinite(sensor.range):
        raise table.fail("range", "clips a quaternion", "remove it: an attitude has no end")


def _width(stream: str, parts: Parts, base: Base) -> int:
    """Numbers of a sensor's noise; 0 where the machine has nothing to measure."""
    turns, moves = base.kind != "hinge", bool(base.planar) or base.kind == "free"
    return {
        "gyro": 3 * turns,
        "attitude": 3 * turns,
        "inclinometer": 2 * turns,
        "accelerometer": 3 * turns,
        "magnetometer": 3 * turns,
        "position": 3 * moves,
        "velocity": 3 * moves,
        "wheel_speed": len(parts.wheels),
        "gimbal_angle": len(parts.gimbals),
        "gimbal_rate": len(parts.gimbals),
        "stage_position": len(parts.stages),
        "joint_angle": int(not turns),
        "joint_rate": int(not turns),
        "gas_pressure": int(parts.gas is not None),
    }[stream]


def _window(table: Table, stream: str) -> float:
    return table.number("window", 0.0, low=0.0, high=1.0, unit="s") if stream in _AT_SITE else 0.0


def _site(table: Table, stream: str, layout: Layout) -> str:
    if stream not in _AT_SITE:
        return ""
    site = table.text("site")
    if site not in layout.sites:
        raise table.fail("site", f"is {site!r}, which is no site of the MJCF", "name it there")
    return site
