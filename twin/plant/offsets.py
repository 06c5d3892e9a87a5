"""Runs of one machine that differ in where their centre of mass is."""

import copy

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.model import Machine, MassProperties, set_mass_properties

Array = NDArray[np.float64]

_FIELDS = ("body_mass", "body_ipos", "body_iquat", "body_inertia", "body_sameframe")
"""Of MuJoCo's model: what `set_mass_properties` writes."""


def set_offsets(batch: Batch, machine: Machine, offsets: Array) -> None:
    """Give each run of a batch its own m r; mass and J about the CR stay.

    Args:
        batch: of the machine's model.
        machine: as its platform states it.
        offsets: (n, 3) m r at stage position 0 [kg m, body].

    Raises:
        UsageError: no rigid body has such an offset and the stated inertia.
    """
    views = {name: batch.expand(name) for name in _FIELDS}
    platform = machine.platform
    frames = np.empty_like(views["body_sameframe"])
    for run, offset in enumerate(offsets):
        model = copy.copy(machine.model)
        try:
            set_mass_properties(
                model, machine.base_body, MassProperties(platform.mass, platform.inertia, offset)
            )
        except ValueError as problem:
            raise UsageError(
                f"no rigid body has m r = {offset} kg m and the inertia of {platform.name}: "
                f"{problem}"
            ) from None
        for name, view in views.items():
            view[run] = getattr(model, name)
        frames[run] = model.body_sameframe
    batch.set_const()
    # which takes a centre of mass within 1e-6 m of its body's origin to lie there
    views["body_sameframe"][:] = frames
