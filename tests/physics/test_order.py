"""How fast the error falls with the step: by the fourth power, or the second where effects push."""

from dataclasses import replace

import numpy as np
import pytest

from tests.physics.motion import run
from twin.effects import parse_effects, with_effects
from twin.plant.initial import InitialState
from twin.platform import Platform, load_platform
from twin.rotation import from_rotation_vector

SECONDS, TICK = 4.0, 0.4


def turns(platform: Platform, step: float, start: InitialState) -> np.ndarray:
    """(m, 4) attitudes, or (m, 1) angles, tick by tick."""
    coarse = replace(platform, step=step, control_rate=1.0 / TICK)
    _, true = run(coarse, start, SECONDS)
    return true["joint_angle" if platform.base.kind == "hinge" else "attitude"]


def order(platform: Platform, step: float, start: InitialState) -> float:
    """How fast what a step changes falls, from a step to half of it to a quarter."""
    coarse, middle, fine = (turns(platform, step / part, start) for part in (1, 2, 4))
    apart = np.abs(coarse - middle).max() / np.abs(middle - fine).max()
    return float(np.log2(apart))


TUMBLE = InitialState(
    attitude=from_rotation_vector(np.array([0.3, -0.2, 0.5])),
    rate_body=np.array([0.3, -0.4, 0.6]),
)


@pytest.mark.parametrize(
    ("name", "step", "tolerance"),
    [
        ("sads", 0.1, 0.1),
        ("cubesat", 0.1, 0.04),
        ("whorl1", 0.1, 0.1),
        ("whorl2", 0.1, 0.1),
        ("tas2", 0.05, 0.005),
        ("astros", 0.05, 0.04),
        ("astros:mode_c", 0.05, 0.04),
        ("dfki_pendulum", 0.002, 0.3),
    ],
)
def test_a_machine_left_alone_is_integrated_to_the_fourth_order(name, step, tolerance, agrees):
    platform = load_platform(name)
    start = InitialState(joint_angle=2.0) if platform.base.kind == "hinge" else TUMBLE
    if platform.wheels:
        start = replace(start, wheel_speed=20.0)
    free = replace(platform, tilt_limit=np.inf, pitch_stop=None, sensors={}, effects=())
    found = order(free, step, start)
    print(f"{name}: order {found:.3f}")
    agrees(f"{name}: order of RK4", abs(found - 4.0), tolerance, "beside 4")


@pytest.mark.parametrize(
    ("text", "tolerance"),
    [
        ("bearing_coulomb_friction=1", 0.05),
        ("structural_sag=1e-3", 0.05),
        ("room_draft=2/4/6/0.05/-0.1/0.05/0.2/0.5", 0.01),
    ],
)
def test_what_effects_push_is_integrated_to_the_second_order(text, tolerance, agrees):
    platform = replace(load_platform("sads"), tilt_limit=np.inf, sensors={})
    found = order(with_effects(platform, parse_effects(text)), 0.1, TUMBLE)
    name = text.partition("=")[0]
    print(f"{name}: order {found:.3f}")
    agrees(f"{name}: order of what it pushes", abs(found - 2.0), tolerance, "beside 2")
