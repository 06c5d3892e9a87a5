"""Every shipped machine: which way its law drives it."""

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.reference import Hold
from twin.rotation import from_rotation_vector, tilt
from twin.stream.recorder import MemoryRecorder

LAWS = (
    ("sads", "quaternion_pd", 15.0),
    ("cubesat", "mass_magnetic_pid", 150.0),
    ("tas2", "cmg_pd", 18.0),
    ("whorl1", "quaternion_pd", 15.0),
    ("whorl2", "quaternion_pd", 22.0),
    ("astros", "mass_pid", 50.0),
    ("astros", "cmg_pd", 18.0),
)
"""Laws for each machine, and how long they have to bring 5 deg of tilt below one [s]."""


WAYS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
"""Axes to lean about, a run each."""


@pytest.mark.parametrize(("name", "law", "duration"), LAWS)
def test_its_law_levels_every_machine_from_five_degrees(name: str, law: str, duration: float):
    """A sign that slipped, in the machine or in the law, drives it away. A stop may be nearer."""
    platform = load_platform(name)
    leaning = min(np.radians(5.0), 0.98 * platform.stop_angle)
    start = InitialState(attitude=from_rotation_vector(leaning * WAYS))
    runs, recorder = range(len(WAYS)), MemoryRecorder(platform)
    outcome = fly(
        SimulatedPlant(platform, runs=runs, seed=1, initial=start),
        load_estimator("filter"),
        load_controller(law),
        Hold(),
        SimulatedClock(),
        duration=duration,
        observers=[recorder],
    )
    assert outcome.ended.value == "done", outcome.reason
    for run in runs:
        late = recorder.recording(run)["truth_attitude"].value[-round(5.0 / platform.tick) :]
        most = np.degrees(tilt(late).max())
        print(f"{name} by {law}, about {WAYS[run]}: {most:.2g} deg after {duration:g} s")
        assert most < 1.0
