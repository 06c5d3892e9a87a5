"""A body that is thrown: its CM flies a parabola, and it keeps its momentum about it."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.physics.motion import run
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.rotation import rotate
from twin.scaffold import new_platform


def test_a_thrown_gyrostat_flies_a_parabola_and_keeps_its_momentum(tmp_path: Path, agrees):
    platform = load_platform(new_platform(tmp_path / "thrown", "free"))
    platform = replace(platform, sensors={})
    rate, speed = np.array([1.0, -2.0, 3.0]), np.array([1.0, -0.5, 4.0])
    start = InitialState(rate_body=rate, velocity=speed)
    time, true = run(platform, start, 1.0)

    arm = platform.center_of_mass_offset / platform.mass
    center = true["position"] + rotate(true["attitude"], arm)
    launch = speed + np.cross(rate, arm)
    fall = 0.5 * platform.gravity * np.square(time)[:, None] * np.array([0.0, 0.0, 1.0])
    error = np.abs(center - center[0] - time[:, None] * launch + fall).max()
    agrees("thrown gyrostat: path of its CM over 1 s", error, 1e-11, "m")

    # about the CM: what the CM's distance from the CR adds to J is taken off
    spread = platform.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    (wheel,) = platform.wheels
    body = true["rate"] @ (platform.inertia - spread)
    body = body + wheel.inertia * true["wheel_speed"] * wheel.axis
    momentum = rotate(true["attitude"], body)
    drift = np.abs(momentum - momentum[0]).max() / np.linalg.norm(momentum[0])
    agrees("thrown gyrostat: momentum about its CM over 1 s", drift, 2e-9, "of the momentum")
