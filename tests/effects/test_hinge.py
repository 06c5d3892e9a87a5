"""Effects on a hinge and its motor against closed forms."""

from dataclasses import replace

import numpy as np

from twin.contrast import undisturbed
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


def test_a_late_torque_turns_a_weightless_pendulum_as_much_later(agrees):
    stated = undisturbed(load_platform("dfki_pendulum"))
    platform = replace(stated, gravity=0.0)
    delay, torque = 0.0237, 0.4
    machine = with_effects(platform, parse_effects(f"joint_torque_delay={delay}"))
    plant = SimulatedPlant(machine)
    ticks = round(2.0 / platform.tick)
    for k in range(ticks):
        plant.read(k * platform.tick)
        # an impulse of half a second
        plant.write({"command_joint_torque": np.array([[torque * (k < ticks // 4)]])})
    plant.read(2.0)
    spin = 0.5 * torque / platform.inertia[1, 1]
    angle = plant.truth()["truth_joint_angle"].value[0, 0, 0]
    off = angle / (spin * (1.75 - delay)) - 1.0
    agrees("joint_torque_delay: angle after an impulse, without weight", abs(off), 1e-11)


def test_an_encoder_shows_waves_around_the_turn_and_its_rate_is_that_of_what_it_shows(agrees):
    platform = undisturbed(load_platform("dfki_pendulum"))
    sensors = {name: replace(sensor, rate=400.0) for name, sensor in platform.sensors.items()}
    platform = replace(platform, sensors=sensors)
    sine, cosine, waves = 2e-3, -1e-3, 12.0
    text = f"encoder_error={sine}/{cosine}/{waves}"
    sound, faulty = (
        swing(machine) for machine in (platform, with_effects(platform, parse_effects(text)))
    )
    turns = waves * sound["joint_angle"]
    slope = waves * (sine * np.cos(turns) - cosine * np.sin(turns))
    error = sine * np.sin(turns) + cosine * np.cos(turns)
    off = faulty["joint_angle"] - sound["joint_angle"] - error
    agrees("encoder_error: reading, by its formula", np.abs(off).max() / 1e-3, 1e-11)
    off = faulty["joint_rate"] - sound["joint_rate"] * (1.0 + slope)
    agrees("encoder_error: rate, by its formula", np.abs(off).max() / 1e-3, 1e-11)


def test_a_rate_sensor_that_shakes_shows_a_sinusoid_beside_the_rate(agrees):
    platform = undisturbed(load_platform("dfki_pendulum"))
    shaken = with_effects(platform, parse_effects("joint_rate_vibration=0.02/-0.01/8"))
    sound, faulty = (swing(machine) for machine in (platform, shaken))
    turns = 2.0 * np.pi * 8.0 * platform.tick * np.arange(len(sound["joint_rate"]))
    off = faulty["joint_rate"] - sound["joint_rate"] - 0.02 * np.sin(turns) + 0.01 * np.cos(turns)
    agrees("joint_rate_vibration: reading, by its formula", np.abs(off).max() / 1e-2, 1e-11)


def swing(machine):
    """Angle and rate (n,) that are shown."""
    plant = SimulatedPlant(machine, initial=InitialState(joint_angle=2.0))
    shown = {"joint_angle": [], "joint_rate": []}
    for k in range(400):
        reading = plant.read(k * machine.tick)
        for name, parts in shown.items():
            if name in reading.streams:
                parts.append(reading.streams[name].value[0, :, 0])
    return {name: np.concatenate(parts) for name, parts in shown.items()}
