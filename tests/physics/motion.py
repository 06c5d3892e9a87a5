"""Runs of a machine, as what is true at each tick of them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.signals import Command

Array = np.ndarray


def rigid(inertia: Array, moment: float = 0.0) -> Platform:
    """A body on a ball joint that nothing stops: the CubeSat table, its masses at rest.

    Args:
        inertia: (3, 3) about the CR [kg m^2].
        moment: of mass, along z: negative for a body that hangs [kg m].
    """
    return replace(
        load_platform("cubesat"),
        inertia=inertia,
        center_of_mass_offset=np.array([0.0, 0.0, moment]),
        tilt_limit=np.inf,
        sensors={},
        effects=(),
    )


def run(
    platform: Platform,
    start: InitialState,
    seconds: float,
    command: Callable[[float], Command] | None = None,
) -> tuple[Array, dict[str, Array]]:
    """Times (m,) and the true streams (m, k), tick by tick, `truth_` left off their names."""
    plant = SimulatedPlant(platform, initial=start)
    time = np.arange(round(seconds / platform.tick) + 1) * platform.tick
    rows = []
    for now in time:
        plant.read(now)
        rows.append({name: samples.value[0, 0] for name, samples in plant.truth().items()})
        if command is not None:
            plant.write(command(now))
    assert not plant.stopped
    names = [(name, name.removeprefix("truth_")) for name in rows[0]]
    return time, {short: np.array([row[name] for row in rows]) for name, short in names}
