"""Torque laws that the catalogue has no name for: products of what a log shows of the motion.

Each is a column of the whitened prediction, so a sparse sum of them is found as causes are, by
their evidence: a regression in the measurements themselves, where no acceleration is differenced
and noise is what the sensors have (weak-form SINDy, Messenger and Bortz 2021, tests its terms
against smooth functions for the same reason; a prediction needs no test functions).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.diagnose.law import TORQUE, Law
from twin.predict.body import Body
from twin.predict.effects.forces import as_measured, middles, on_grid
from twin.predict.effects.perturbation import Perturbation

Array = NDArray[np.float64]
_XYZ = ("x", "y", "z")


@dataclass(frozen=True)
class Quantities:
    """What a law may depend on, at the middle of each step of a log, by name: (m,)."""

    values: dict[str, Array]
    units: dict[str, str]


def torque_laws(bodies: Sequence[Body]) -> Iterator[Law]:
    """Those that these logs can be asked for."""
    machine = bodies[0].machine
    hinge = machine.platform.base.kind == "hinge"
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
    products = [one for one in products if one != ("up_z", "up_z")]
    for index, axis in enumerate(axes):
        yield from (_law(axis, index, product, shown.units) for product in products)


def _law(axis: str, index: int, factors: tuple[str, ...], units: dict[str, str]) -> Law:
    below = [units[name] for name in factors if units[name]]
    unit = " ".join(["N m", *(f"({one})^-1" for one in below)])

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
    """Along the motion that the log follows; asked once a law."""
    machine = body.machine
    along = as_measured(body, body.inputs)
    position, rate = along.position[:, machine.base_qpos], along.velocity[:, machine.base_dof]
    times = middles(body)
    found = {"time": (times - times[0], "s")}
    if position.shape[1] == 1:
        found["angle"] = (position[:, 0], "rad")
        found["rate"] = (rate[:, 0], "rad/s")
    else:
        up = rotation.vertical_body(position)
        found |= {f"rate_{name}": (rate[:, i], "rad/s") for i, name in enumerate(_XYZ)}
        found |= {f"up_{name}": (up[:, i], "") for i, name in enumerate(_XYZ)}
    for wheel, dof in zip(machine.platform.wheels, machine.wheel_dof, strict=True):
        found[f"speed_{wheel.name}"] = (along.velocity[:, dof], "rad/s")
    return Quantities({k: v for k, (v, _) in found.items()}, {k: u for k, (_, u) in found.items()})
