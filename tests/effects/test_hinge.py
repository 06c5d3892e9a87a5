"""Effects on a hinge and its motor against closed forms."""

import numpy as np

from twin.effects import parse_effects, with_effects
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform

SECONDS = 10.0


def test_energy_of_a_pendulum_grows_by_the_part_of_the_work_that_arrives(agrees):
    platform = load_platform("dfki_pendulum")
    machine = with_effects(platform, parse_effects("joint_torque_gain=-0.2"))
    plant = SimulatedPlant(machine, initial=InitialState(joint_angle=0.5))
    torque = 0.4
    rows = []
    for k in range(round(SECONDS / platform.tick) + 1):
        plant.read(k * platform.tick)
        plant.write({"command_joint_torque": np.array([[torque]])})
        truth = plant.truth()
        rows.append([truth[f"truth_joint_{name}"].value[0, 0, 0] for name in ("angle", "rate")])
    angle, rate = np.array(rows).T
    weight = platform.gravity * np.linalg.norm(platform.center_of_mass_offset)
    energy = 0.5 * platform.inertia[1, 1] * rate**2 - weight * np.cos(angle)
    gained = energy - energy[0]
    work = 0.8 * torque * (angle - angle[0])
    error = np.abs(gained - work).max() / np.abs(work).max()
    agrees("joint_torque_gain: energy of a pendulum beside the motor's work", error, 7e-10)
