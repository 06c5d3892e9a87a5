"""Every shipped machine: what its own actuators cannot change, and which way its law drives."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.simulated import InitialState, SimulatedPlant
from twin.platform import Platform, load_platform
from twin.reference import Hold
from twin.rotation import from_rotation_vector, tilt
from twin.stream.recorder import MemoryRecorder

SECONDS = 300.0

STEPS = {
    "cubesat": 0.01,
    "tas2": 0.01,
    "whorl1": 0.005,
    "whorl2": 0.005,
    "astros": 0.01,
    "astros:mode_c": 0.01,
}
"""[s] at which momentum about the vertical is kept to 1e-10 of the largest any part holds."""

LAWS = (
    ("sads", "quaternion_pd", 30.0),
    ("cubesat", "mass_magnetic_pid", 150.0),
    ("tas2", "cmg_pd", 30.0),
    ("whorl1", "quaternion_pd", 30.0),
    ("whorl2", "quaternion_pd", 30.0),
    ("astros", "mass_pid", 90.0),
    ("astros", "cmg_pd", 30.0),
)
"""Laws for each machine, and how long they have to bring 5 deg of tilt below one [s]."""


def vertical_momentum(plant: SimulatedPlant) -> float:
    """About the room's vertical through the CR at its start, L_CM + M c x v of all that moves.

    The bearing's force passes through that line while the CR stands; where it floats away on a
    planar stage, nothing holds the whole.
    """
    model, data = plant.machine.model, mujoco.MjData(plant.machine.model)
    (data.qpos[:],), (data.qvel[:],) = plant.state
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    carried = model.body_subtreemass[0] * np.cross(data.subtree_com[0], data.subtree_linvel[0])
    return float((data.subtree_angmom[0] + carried)[2])


def internal_commands(platform: Platform, time: float) -> dict[str, np.ndarray]:
    """Slow waves on all that exchanges momentum within the machine, and on coils along z.

    Torques and rates are cosines, so that what they move swings about its start.
    """

    def phases(count: int) -> np.ndarray:
        return time * (0.5 - 0.1 * np.arange(count) / max(count, 1))[None]

    wheels, stages, gimbals = platform.wheels, platform.stages, platform.gimbals
    inertia = np.linalg.eigvalsh(platform.inertia)[0]
    commands = {
        # 1 cm moves the CM by far more than its offset, so a share of the weight's moment is taken
        "command_stage_position": np.sin(phases(len(stages)))
        * np.array([min(0.2 * s.travel[1], 1e-5 * platform.mass / s.mass) for s in stages]),
        "command_wheel_torque": np.cos(phases(len(wheels)))
        * np.array([min(0.02 * w.torque_limit, 1e-3 * inertia) for w in wheels]),
        "command_gimbal_rate": np.cos(phases(len(gimbals)))
        * np.array([0.05 * g.rate for g in gimbals]),
        "command_dipole": 0.1 * np.sin(phases(3)),
    }
    return {name: value for name, value in commands.items() if name in platform.commands}


def momentum_drift(platform: Platform) -> float:
    """In SECONDS, in parts of the largest momentum that any part holds."""
    deep = np.array([5e-7, -5e-7, -5e-5]) * platform.mass  # it swings clear of the stop
    platform = replace(platform, center_of_mass_offset=deep)
    swing = min(0.01, 0.01 * platform.stop_angle)
    rate = np.array([swing, -swing, 0.03])
    plant = SimulatedPlant(platform, initial=InitialState(rate_body=rate))
    plant.read(0.0)
    wheels = np.array([wheel.inertia for wheel in platform.wheels])
    largest = max((abs(rotor.momentum) for rotor in platform.rotors), default=0.0)
    start, drift, lean = math.nan, 0.0, 0.0
    for k in range(round(SECONDS / platform.tick)):
        plant.read(k * platform.tick)
        if k % 20 == 0:
            truth = {stream: samples.value[0, 0] for stream, samples in plant.truth().items()}
            momentum = vertical_momentum(plant)
            start = momentum if k == 0 else start
            drift = max(drift, abs(momentum - start))
            turning = float(np.linalg.norm(platform.inertia @ truth["truth_rate"]))
            spinning = np.abs(truth.get("truth_wheel_speed", np.zeros(0)) * wheels)
            largest = max(largest, turning, *spinning)
            lean = max(lean, float(platform.lean(truth["truth_attitude"])))
        plant.write(internal_commands(platform, k * platform.tick))
    print(
        f"{platform.name}, {platform.step:g} s steps: {drift / largest:.1e} of {largest:.3g} N m s,"
        f" {np.degrees(lean):.2g} deg"
    )
    assert not plant.stopped
    assert lean < platform.stop_angle, "what the stop takes is not kept"
    return drift / largest


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if "whorl" in name else name for name in STEPS],
)
def test_momentum_about_the_vertical_is_kept_by_all_that_acts_within(name: str):
    """Coils in a vertical field change none of it either. The default step's drift is printed."""
    platform = load_platform(name)
    if platform.step != STEPS[name]:
        momentum_drift(platform)
    assert momentum_drift(replace(platform, step=STEPS[name])) < 1e-10


@pytest.mark.parametrize("about", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
@pytest.mark.parametrize(("name", "law", "duration"), LAWS)
def test_its_law_levels_every_machine_from_five_degrees(
    name: str, law: str, duration: float, about: tuple[float, float]
):
    """A sign that slipped, in the machine or in the law, drives it away. A stop may be nearer."""
    platform = load_platform(name)
    leaning = min(np.radians(5.0), 0.98 * platform.stop_angle)
    start = from_rotation_vector(leaning * np.array([*about, 0.0]))
    recorder = MemoryRecorder(platform)
    outcome = fly(
        SimulatedPlant(platform, seed=1, initial=InitialState(attitude=start)),
        load_estimator("filter"),
        load_controller(law),
        Hold(),
        SimulatedClock(),
        duration=duration,
        observers=[recorder],
    )
    assert outcome.ended.value == "done", outcome.reason
    late = recorder.recording()["truth_attitude"].value[-round(5.0 / platform.tick) :]
    print(f"{name} by {law}: {np.degrees(tilt(late).max()):.2g} deg after {duration:g} s")
    assert np.degrees(tilt(late).max()) < 1.0
