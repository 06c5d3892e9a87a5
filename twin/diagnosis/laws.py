"""Unnamed laws: torques and sensor errors proportional to products of measured quantities.

Each law is a column of the whitened prediction, and a sparse sum of laws is selected by evidence as
causes are. It is a regression on the measurements themselves: no acceleration is differenced, and
the noise is that of the sensors (weak-form SINDy, Messenger and Bortz 2021, uses test functions for
the same purpose).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.diagnosis.screen import Trace
from twin.effects.on_sensor import levels_of, product_of, rates_of, shown_by, units_of
from twin.predict.body import Body
from twin.predict.forces import Perturbation, as_measured, middles, on_grid
from twin.predict.sensors import Output
from twin.signals import STREAMS

TORQUE = "torque"
"""`Law.what` of a torque."""
Array = NDArray[np.float64]
_XYZ = ("x", "y", "z")
ALL = "xyz"
"""`Law.column` of a torque along a vector."""
VECTORS = {"rate": "rad/s", "up": ""}
"""Vectors along which a torque is asked for, with their units: what brakes alike about every axis,
and what turns about the vertical."""
RARE = 6.0
"""-2 log of the prior probability of unnamed laws relative to the catalogue."""


@dataclass(frozen=True)
class Law:
    """A torque about one axis of the base, or an error of one column of a sensor, in proportion to
    a product; or a torque along a vector. On a floor the first two axes are those of forces along
    the room's x and y, the third is the vertical."""

    what: str
    """`torque`, or the sensor's stream."""
    column: str
    """Axis of the torque, or column of the stream; `xyz` of a torque along a vector."""
    factors: tuple[str, ...]
    unit: str
    """Of its coefficient."""
    perturbation: Perturbation

    @property
    def label(self) -> str:
        """`torque_x ~ rate_x rate_z`, `gyro_x ~ gyro_y`."""
        return self.perturbation.name

    def trace(self, unlikely: float) -> Trace:
        """Description for the linear screen; of any size and sign."""
        free = np.full(1, np.inf)
        return Trace(self.label, -free, free, unlikely=unlikely)


@dataclass(frozen=True)
class Quantities:
    """Quantities (m,) that a law may depend on, at the middle of each step of a log, by name."""

    values: dict[str, Array]
    units: dict[str, str]


def torque_laws(bodies: Sequence[Body]) -> Iterator[Law]:
    """Torque laws of these logs' quantities."""
    machine = bodies[0].machine
    hinge = machine.platform.base.kind == "hinge"
    planar = machine.platform.base.kind == "planar"
    axes = ("joint",) if hinge else _XYZ
    shown = _quantities(bodies[0])
    rates = [name for name in shown.units if name.startswith("rate")]
    places = [name for name in shown.units if name.startswith(("up", "angle"))]
    wheels = [name for name in shown.units if name.startswith("speed")]
    products: list[tuple[str, ...]] = [(), ("time",)]
    products += [(name,) for name in (*rates, *places, *wheels)]
    products += combinations_with_replacement(rates, 2)
    products += combinations_with_replacement(places, 2)
    products += [(rate, place) for rate in rates for place in places]
    products += [(wheel, wheel) for wheel in wheels]
    if hinge:
        products += [("rate", "rate", "rate"), ("angle", "angle", "angle")]
    # the squares of the vertical's components add up to 1
    products = [item for item in products if item != ("up_z", "up_z")]
    for index, axis in enumerate(axes):
        unit = "N" if planar and axis != "z" else "N m"
        yield from (_torque_law((axis, unit), index, item, shown.units) for item in products)
    if not (hinge or planar):
        yield from (_along(vector, unit) for vector, unit in VECTORS.items())


def _along(vector: str, unit: str) -> Law:
    """A torque along a vector: one number, where three axes of their own would be three."""
    whole = f"N m ({unit})^-1" if unit else "N m"

    def force(body: Body) -> Array:
        shown = _quantities(body).values
        torque = np.stack([shown[f"{vector}_{axis}"] for axis in _XYZ], axis=1)
        full = np.zeros((len(torque), body.machine.model.nv))
        full[:, body.machine.base_dof] = torque
        return on_grid(full, body)

    name = f"{TORQUE}_{ALL} ~ {vector}"
    return Law(TORQUE, ALL, (vector,), whole, Perturbation(name, whole, force=force))


def _torque_law(
    what: tuple[str, str], index: int, factors: tuple[str, ...], units: dict[str, str]
) -> Law:
    """Of an axis and its unit: on a floor the torques about x and y are forces along them."""
    axis, unit = what
    below = [units[name] for name in factors if units[name]]
    unit = " ".join([unit, *(f"({item})^-1" for item in below)])

    def force(body: Body) -> Array:
        shown = _quantities(body).values
        torque = np.ones(body.grid.segments * body.grid.steps)
        for name in factors:
            torque = torque * shown[name]
        full = np.zeros((len(torque), body.machine.model.nv))
        full[:, body.machine.base_dof.start + index] = torque
        return on_grid(full, body)

    label = " ".join(factors) or "1"
    name = f"{TORQUE}_{axis} ~ {label}"
    return Law(TORQUE, axis, factors, unit, Perturbation(name, unit, force=force))


@lru_cache(maxsize=2)
def _quantities(body: Body) -> Quantities:
    """Quantities along the log's motion."""
    machine = body.machine
    along = as_measured(body, body.inputs)
    position, rate = along.position[:, machine.base_qpos], along.velocity[:, machine.base_dof]
    times = middles(body)
    result = {"time": (times - times[0], "s")}
    if position.shape[1] == 1:
        result["angle"] = (position[:, 0], "rad")
        result["rate"] = (rate[:, 0], "rad/s")
    elif position.shape[1] == 3:
        units = ("m/s", "m/s", "rad/s")
        result |= {f"rate_{_XYZ[i]}": (rate[:, i], unit) for i, unit in enumerate(units)}
    else:
        up = rotation.vertical_body(position)
        result |= {f"rate_{name}": (rate[:, i], "rad/s") for i, name in enumerate(_XYZ)}
        result |= {f"up_{name}": (up[:, i], "") for i, name in enumerate(_XYZ)}
    for wheel, dof in zip(machine.platform.wheels, machine.wheel_dof, strict=True):
        result[f"speed_{wheel.name}"] = (along.velocity[:, dof], "rad/s")
    return Quantities(
        {k: v for k, (v, _) in result.items()}, {k: u for k, (_, u) in result.items()}
    )


def sensor_laws(bodies: Sequence[Body]) -> Iterator[Law]:
    """Error laws of every predicted sensor, except of readings that follow from commands."""
    outputs = {output.stream: output for body in reversed(bodies) for output in body.outputs}
    for output in outputs.values():
        if output.told is not None or output.course is not None:
            continue
        units = units_of(output.stream, output.columns)
        for index, factors in _products(output):
            yield _sensor_law(output, index, factors, units)


def _products(output: Output) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Columns, and the factors of their errors."""
    stream, columns = output.stream, output.columns
    # one column for each part: an error of one wheel's reading depends on no other wheel
    shared = bool(STREAMS[stream].columns)
    levels, rates = levels_of(stream, columns), rates_of(stream, columns)
    for index, (level, rate) in enumerate(zip(levels, rates, strict=True)):
        yield from ((index, factors) for factors in ((), ("time",), (rate,), (level, level)))
        yield from ((index, (other,)) for other in (levels if shared else (level,)))


def _sensor_law(output: Output, index: int, factors: tuple[str, ...], units: dict[str, str]) -> Law:
    stream, columns = output.stream, output.columns
    below = [f"({units[name]})^-1" for name in factors if units[name]]
    unit = " ".join(["rad" if stream == "attitude" else STREAMS[stream].unit, *below])

    def error(measured: Output, truth: Array) -> Array:
        time = np.broadcast_to(measured.time - measured.time[0], truth.shape[:2])
        result = np.zeros((len(truth), *measured.slot.shape))
        result[..., index] = product_of(shown_by(stream, columns, time, truth), factors)
        return result

    name = f"{stream}_{columns[index]} ~ {' '.join(factors) or '1'}"
    return Law(
        stream, columns[index], factors, unit, Perturbation(name, unit, stream=stream, shown=error)
    )


def laws_of(bodies: Sequence[Body]) -> tuple[Law, ...]:
    """All laws of these logs' quantities."""
    return (*torque_laws(bodies), *sensor_laws(bodies))


def unlikely(laws: Sequence[Law]) -> float:
    """-2 log of the prior probability of each law."""
    return RARE + 2.0 * float(np.log(len(laws)))
