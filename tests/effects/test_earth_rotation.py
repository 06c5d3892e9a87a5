"""The Earth's rotation against an integration in inertial space."""

import numpy as np
from scipy.integrate import solve_ivp

from twin.contrast import undisturbed
from twin.effects import parse_effects, with_effects
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.rotation import conjugate, from_rotation_vector, multiply, rotate, to_rotation_vector

SECONDS = 100.0


def test_a_gyrostat_turns_in_a_room_that_turns_as_it_does_in_inertial_space(agrees):
    platform = undisturbed(load_platform("sads"))
    effect = parse_effects("earth_rotation=4.7e-5/1e-5/5.6e-5")[0]
    start = InitialState(
        attitude=from_rotation_vector(np.array([0.02, -0.03, 0.4])),
        rate_body=np.array([0.01, -0.02, 0.05]),
        wheel_speed=np.array([150.0, -100.0, 60.0, 0.0][: len(platform.wheels)]),
    )
    plain, turned = (flown(one, start) for one in (platform, with_effects(platform, (effect,))))
    expected = (
        inertial(platform, start, np.asarray(effect.rate)),
        inertial(platform, start, np.zeros(3)),
    )
    apart = [
        to_rotation_vector(multiply(conjugate(a), b))
        for a, b in ((plain[0], turned[0]), (expected[1], expected[0]))
    ]
    error = np.abs(apart[0] - apart[1]).max() / np.abs(apart[1]).max()
    agrees("earth_rotation: turn of a gyrostat beside one in inertial space", error, 2e-3)
    time = platform.tick * np.arange(len(turned[0]))
    shown = turned[1] - turned[2]
    room = rotate(conjugate(turned[0]), np.asarray(effect.rate))
    assert time[-1] > 0.9 * SECONDS
    agrees("earth_rotation: gyro, by its formula", np.abs(shown - room).max() / 7e-5, 1e-11)


def flown(machine, start):
    """Attitudes (m, 4), what the gyro shows and the true rate (m, 3)."""
    plant = SimulatedPlant(machine, initial=start)
    attitude, gyro, rate = [], [], []
    for k in range(round(SECONDS / machine.tick)):
        shown = plant.read(k * machine.tick).streams
        truth = plant.truth()
        attitude.append(truth["truth_attitude"].value[0, 0])
        rate.append(truth["truth_rate"].value[0, 0])
        gyro.append(shown["gyro"].value[0, -1])
    return np.array(attitude), np.array(gyro), np.array(rate)


def inertial(platform, start, room):
    """Attitudes (m, 4) in a room that turns at `room`: momentum and attitude against the stars."""
    spin = np.array([wheel.inertia * wheel.axis for wheel in platform.wheels])
    axes = np.array([wheel.axis for wheel in platform.wheels])
    whole, alone = platform.inertia, platform.inertia - spin.T @ axes
    moment, up = platform.center_of_mass_offset, np.array([0.0, 0.0, platform.gravity])

    def slope(time, state):
        q, w, s = state[:4], state[4:7], state[7:]
        # the vertical goes round with the room
        down = -rotate(from_rotation_vector(room * time), up)
        torque = np.cross(moment, rotate(conjugate(q), down))
        rate = np.linalg.solve(alone, torque - np.cross(w, whole @ w + s @ spin))
        wheel = -axes @ rate
        return np.concatenate([0.5 * multiply(q, np.concatenate([[0.0], w])), rate, wheel])

    q0 = np.asarray(start.attitude)
    w0 = np.asarray(start.rate_body) + rotate(conjugate(q0), room)
    first = np.concatenate([q0, w0, start.wheel_speeds(platform).ravel()])
    times = platform.tick * np.arange(round(SECONDS / platform.tick))
    found = solve_ivp(
        slope, (0.0, times[-1]), first, "DOP853", t_eval=times, rtol=1e-11, atol=1e-13
    )
    stars = found.y[:4].T
    return multiply(conjugate(from_rotation_vector(room * times[:, None])), stars)
