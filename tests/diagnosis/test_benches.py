"""A lab's first benches: a wheel that coasts down, a body on a spring that the model lacks.

Their motions are integrated by SciPy.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from twin.diagnosis import diagnose
from twin.platform import Platform, load_platform
from twin.recording import Recording, Series

MJCF = """<mujoco model="bench">
  <worldbody>
    <body name="rotor">
      <joint name="pivot" type="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="2" diaginertia="0.1 0.1 0.12"/>
      <geom type="cylinder" size="0.3 0.01" mass="0"/>
    </body>
  </worldbody>
</mujoco>
"""
TOML = """name = "bench"
title = "A rotor on a vertical axis, with an encoder and a gyro"
[simulation]
step = 0.005
control_rate = 100.0
[base]
kind = "hinge"
joint = "pivot"
body = "rotor"
[mass_properties]
mass = 2.0
inertia = [0.1, 0.1, 0.12, 0.0, 0.0, 0.0]
center_of_mass_offset = [0.0, 0.0, 0.0]
[sensors.joint_angle]
rate = 100.0
noise = 1e-3
[sensors.joint_rate]
rate = 100.0
noise = 0.02
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Platform:
    """A rotor on a vertical axis: no weight, a moment of inertia that is known."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "platform.xml").write_text(MJCF)
    (folder / "platform.toml").write_text(TOML)
    return load_platform(folder)


def integrated(slope, start, duration: float) -> np.ndarray:
    """(m, .) states at 100 Hz."""
    time = 0.01 * np.arange(round(100.0 * duration))
    found = solve_ivp(slope, (0.0, time[-1]), start, t_eval=time, rtol=1e-10, atol=1e-12)
    return found.y.T


def readings(rng: np.random.Generator, **streams: np.ndarray) -> Recording:
    """With a noise of 1 mrad of an angle and 0.02 rad/s of a rate."""
    noise = {"joint_angle": (1e-3, "rad"), "joint_rate": (0.02, "rad/s")}
    return Recording(
        {
            name: Series(
                0.01 * np.arange(len(value)),
                (value + noise[name][0] * rng.standard_normal(len(value)))[:, None],
                ("pivot",),
                noise[name][1],
            )
            for name, value in streams.items()
        }
    )


@pytest.mark.slow
def test_a_coast_down_of_a_wheel_has_its_three_frictions_to_within_their_intervals(
    bench: Platform, drawn_seed: int
):
    rng = np.random.default_rng(drawn_seed)
    inertia = float(bench.inertia[2, 2])
    dry, viscous, drag = inertia * rng.uniform([0.07, 4e-3, 8e-4], [0.12, 8e-3, 1.5e-3])

    def slope(_: float, state: np.ndarray) -> list[float]:
        (rate,) = state
        return [-(dry + viscous * rate + drag * rate**2) / inertia]

    # slowed down by half, the three can hardly be told from two of them
    rate = integrated(slope, [30.0], 40.0)[:, 0]
    found = diagnose([readings(rng, joint_rate=rate)], bench)
    # a wheel that never turns back cannot tell dry friction from a steady torque
    assert found.verdict == "ambiguous"
    named = {one.effect.name: one for one in found.causes}
    sizes = {"bearing_coulomb_friction": dry, "bearing_viscous_friction": viscous}
    sizes["aerodynamic_drag"] = drag
    assert set(named) == set(sizes)
    for name, size in sizes.items():
        # four standard deviations
        assert abs(named[name].effect.values[0] - size) < 2.0 * named[name].half_widths[0]
    assert [tie.label for tie in named["bearing_coulomb_friction"].ties] == ["bearing_swirl_torque"]


def test_a_spring_that_the_model_lacks_is_named_and_no_draught_at_its_frequency(
    bench: Platform, drawn_seed: int
):
    rng = np.random.default_rng(drawn_seed)
    inertia = float(bench.inertia[2, 2])
    stiffness = inertia * (2.0 * np.pi * rng.uniform(0.2, 0.8)) ** 2
    damping = inertia * rng.uniform(0.01, 0.05)

    def slope(_: float, state: np.ndarray) -> list[float]:
        angle, rate = state
        return [rate, -(stiffness * angle + damping * rate) / inertia]

    angle, rate = integrated(slope, [rng.uniform(0.2, 0.5), 0.0], 20.0).T
    found = diagnose([readings(rng, joint_angle=angle, joint_rate=rate)], bench)
    assert found.verdict == "explained"
    named = {one.effect.name: one for one in found.causes}
    sizes = {"harness_stiffness": stiffness, "bearing_viscous_friction": damping}
    assert set(named) == set(sizes)
    for name, size in sizes.items():
        assert abs(named[name].effect.values[0] - size) < 2.0 * named[name].half_widths[0]
        assert named[name].half_widths[0] < 0.1 * size
