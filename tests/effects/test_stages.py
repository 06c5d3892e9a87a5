"""Sliding masses that do not do what they are told, in the running simulation."""

from dataclasses import replace

import numpy as np

from twin.effects import parse_effects, with_effects
from twin.plant.simulated import SimulatedPlant


def moved(platform, text, targets, seconds=4.0):
    """Where s1 comes to rest after each commanded position, and all readings of the gyro."""
    effects = parse_effects(text) if text else ()
    plant = SimulatedPlant(with_effects(platform, effects), seed=3)
    rests, gyro, tick = [], [], 0
    for target in targets:
        for _ in range(round(seconds / platform.tick)):
            reading = plant.read(tick * platform.tick)
            gyro.append(reading.streams["gyro"].value[0])
            plant.write({"command_stage_position": np.array([[target, 0.0, 0.0]])})
            tick += 1
        rests.append(plant.truth()["truth_stage_position"].value[0, 0, 0])
    return np.array(rests), np.concatenate(gyro)


TARGETS = (2e-3, 5e-3, 4e-3, 0.0, 3e-3)


def test_a_wrong_pitch_scales_every_position(sads, agrees):
    rests, _ = moved(sads, "stage_scale:s1=0.01", TARGETS)
    error = np.abs(rests - 1.01 * np.array(TARGETS)).max()
    agrees("stage_scale: where the mass comes to rest", error, 1e-12, "m")


def test_play_is_taken_up_after_every_reversal(sads, agrees):
    rests, _ = moved(sads, "stage_backlash=2e-4", TARGETS)
    side = np.array([-1.0, -1.0, 1.0, 1.0, -1.0]) * 1e-4
    error = np.abs(rests - np.array(TARGETS) - side).max()
    agrees("stage_backlash: where the mass comes to rest", error, 1e-12, "m")


def test_lost_steps_add_up(sads, agrees):
    rests, _ = moved(sads, "stage_step_loss=0.1", TARGETS)
    error = np.abs(rests - np.array([1.8e-3, 4.5e-3, 3.5e-3, -0.5e-3, 2.2e-3])).max()
    agrees("stage_step_loss: where the mass comes to rest", error, 1e-12, "m")


def test_another_stage_stays_as_it_is(sads):
    rests, _ = moved(sads, "stage_scale:s2=0.5,stage_step_loss:s3=0.5", TARGETS)
    np.testing.assert_allclose(rests, TARGETS, atol=1e-9)


def test_a_running_motor_shakes_the_gyro_as_much_as_it_is_fast(sads, agrees):
    quiet = replace(sads, center_of_mass_offset=np.zeros(3), gravity=0.0)
    _, plain = moved(quiet, "", (0.08,), seconds=7.0)
    _, shaken = moved(quiet, "stage_vibration=2", (0.08,), seconds=7.0)
    noise = (shaken - plain)[150:600]  # at full speed, 10 mm/s
    error = abs(noise.std() / (2.0 * 0.01) - 1.0)
    agrees("stage_vibration: scatter of the gyro at full speed", error, 0.05)
    assert np.abs((shaken - plain)[:1]).max() == 0.0
