"""A passive pendulum keeps its energy and swings with the period that theory gives."""

import numpy as np
import pytest
from scipy.special import ellipk

from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform

SECONDS = 300.0


@pytest.fixture(scope="module")
def swing():
    """Time, angle and rate of the pendulum let go at 2 rad, at the platform's own step."""
    platform = load_platform("dfki_pendulum")
    plant = SimulatedPlant(platform, initial=InitialState(joint_angle=2.0))
    rows = []
    for k in range(round(SECONDS / platform.tick) + 1):
        plant.read(k * platform.tick)
        truth = plant.truth()
        angle, rate = (truth[f"truth_joint_{name}"].value[0, 0, 0] for name in ("angle", "rate"))
        rows.append((k * platform.tick, angle, rate))
    return platform, *np.array(rows).T


def test_energy_of_a_passive_pendulum_is_constant_at_the_stated_step(swing, agrees):
    platform, _, angle, rate = swing
    inertia = platform.inertia[1, 1]
    weight = platform.gravity * np.linalg.norm(platform.center_of_mass_offset)
    energy = 0.5 * inertia * rate**2 - weight * np.cos(angle)
    drift = np.abs(energy - energy[0]).max() / (2.0 * weight)
    agrees("dfki_pendulum: energy over 300 s", drift, 1e-8, "of the greatest potential")


def test_period_of_a_wide_swing_is_that_of_the_elliptic_integral(swing, agrees):
    platform, time, angle, rate = swing
    inertia = platform.inertia[1, 1]
    weight = platform.gravity * np.linalg.norm(platform.center_of_mass_offset)
    period = 4.0 * np.sqrt(inertia / weight) * ellipk(np.sin(1.0) ** 2)
    rising = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0))
    # cubic Hermite through the crossing: angle and rate are both known on either side
    step = time[1] - time[0]
    crossings = []
    for i in rising:
        rise = angle[i + 1] - angle[i]
        part = -angle[i] / rise
        for _ in range(20):
            bend, twist = rate[i] * step - rise, rise - rate[i + 1] * step
            value = angle[i] + part * rise + part * (1 - part) * (bend * (1 - part) + twist * part)
            part -= value / rise
        crossings.append(time[i] + part * step)
    found = np.polyfit(np.arange(len(crossings)), crossings, 1)[0]
    error = abs(found / period - 1.0)
    agrees("dfki_pendulum: period at 2 rad, by the elliptic integral", error, 3e-9)
