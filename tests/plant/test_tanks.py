"""Gas: thrusters push as long as there is some."""

from dataclasses import replace

import numpy as np
import pytest

from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform


@pytest.mark.parametrize("again", [False, True], ids=["told once", "told at every tick"])
def test_a_thruster_that_stays_open_pushes_until_the_tank_is_empty_and_no_longer(
    *, again: bool
) -> None:
    platform = load_platform("astros")
    assert platform.gas is not None
    seconds, force = 2.0, 0.5
    gas = force * seconds / (platform.gas.specific_impulse * 9.80665)
    platform = replace(platform, gas=replace(platform.gas, mass=gas))
    wish = np.zeros((2, len(platform.thrusters)))
    wish[0, 0] = force
    opened: list[float] = []
    with SimulatedPlant(platform, runs=(0, 1), threads=1) as plant:
        for tick in range(round(2.0 * seconds / platform.tick)):
            plant.read(tick * platform.tick)
            told = {"command_thruster": wish} if again or tick == 0 else {}
            applied = plant.write(told)["command_thruster"]
            assert not applied[1].any()
            opened.append(float(applied[0, 0]))
            last = plant.truth()
        assert last["truth_gas_mass"].value[0, 0, 0] == 0.0
        assert last["truth_gas_mass"].value[1, 0, 0] == gas
    assert set(opened) == {0.0, force}
    assert np.sum(opened) / force * platform.tick == pytest.approx(seconds, abs=platform.tick)
