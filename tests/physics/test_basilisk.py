"""The same gyrostat in Basilisk, which shares no code with MuJoCo or us.

Needs the extra `peers`. Basilisk's hub is free and feels no gravity, so ours is balanced.
"""

from dataclasses import replace

import numpy as np
import pytest

from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.rotation import conjugate, multiply, to_rotation_vector

pytest.importorskip("Basilisk", reason="the extra `peers` is not installed")

SECONDS = 300.0
PIECE = 50.0
"""[s] that each set of torques is held."""
TORQUES = 0.05 * np.array(
    [
        [1.0, -0.5, 0.2],
        [-0.7, 0.8, 0.3],
        [0.1, -0.6, -0.9],
        [-0.4, 0.2, 0.6],
        [0.3, 0.4, -0.5],
        [-0.3, -0.3, 0.3],
    ]
)
RATE = np.array([0.01, -0.02, 0.05])
SPEED = np.array([20.0, -30.0, 40.0])


def test_a_gyrostat_with_three_wheels_turns_as_in_basilisk(agrees):
    from benchmarks.basilisk import Spacecraft

    platform = replace(
        load_platform("sads"),
        center_of_mass_offset=np.zeros(3),
        tilt_limit=np.pi,
        step=0.005,
        sensors={},
    )
    peer = Spacecraft(platform, platform.step, RATE, SPEED)
    told = peer.take_torques()
    run = peer.ready()
    plant = SimulatedPlant(platform, initial=InitialState(rate_body=RATE, wheel_speed=SPEED))
    ticks = round(PIECE / platform.tick)
    for piece, torque in enumerate(TORQUES):
        told(torque)
        run((piece + 1) * PIECE)
        for k in range(ticks):
            plant.read((piece * ticks + k) * platform.tick)
            plant.write({"command_wheel_torque": torque[None]})
    plant.read(SECONDS)
    ours = plant.truth()["truth_attitude"].value[0, 0]
    error = np.degrees(np.linalg.norm(to_rotation_vector(multiply(conjugate(peer.attitude), ours))))
    turned = np.degrees(np.linalg.norm(to_rotation_vector(ours)))
    print(f"turned by {turned:.1f} deg in the end")
    agrees("gyrostat with three wheels: attitude after 300 s, Basilisk", error, 1e-6, "deg")
