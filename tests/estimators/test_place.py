"""Position and velocity from a camera, of a machine that travels."""

from dataclasses import replace

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.reference import parse_reference
from twin.signals import Tick

SEED = 20261130


class _Places:
    def __init__(self) -> None:
        self.error: list[np.ndarray] = []
        self.shown: list[bool] = []

    def collect(self, tick: Tick) -> None:
        position, velocity = tick.estimate.position, tick.estimate.velocity
        self.shown.append(position is not None)
        if position is None or velocity is None:
            return
        true = [tick.truth[f"truth_{name}"].value[:, 0] for name in ("position", "velocity")]
        self.error.append(np.stack([position - true[0], velocity - true[1]], axis=1))


def _errors(platform, law="free_float", runs=8, duration=16.0, estimator="filter", **start):
    plant = SimulatedPlant(
        platform, runs=tuple(range(runs)), seed=SEED, initial=InitialState(**start)
    )
    places, controller = _Places(), load_controller(law)
    fly(
        plant,
        load_estimator(estimator),
        controller,
        parse_reference(controller.reference),
        SimulatedClock(),
        duration=duration,
        observers=[places],
    )
    return np.array(places.error), places.shown  # (ticks, n, 2, 3)


@pytest.mark.parametrize("estimator", ["filter", "mekf", "inclinometer", "passthrough"])
def test_a_machine_that_glides_is_located_better_than_its_camera_shows_it(estimator):
    platform = load_platform("astros:mode_c")
    velocity = np.array([0.02, -0.01, 0.0])
    error, _ = _errors(platform, estimator=estimator, velocity=velocity)
    late = error[len(error) // 2 :, :, :, :2]
    rms = np.sqrt(np.mean(late**2, axis=(0, 1, 3)))
    print(f"seed {SEED}: {1e3 * rms[0]:.3f} mm, {1e3 * rms[1]:.3f} mm/s")
    camera = float(platform.sensors["position"].noise[0])
    assert rms[0] < 0.25 * camera
    assert rms[1] < 0.5e-3
    assert np.abs(np.mean(late, axis=(0, 1))).max() < 1e-4


def test_thrusters_that_the_law_fires_are_expected_by_the_estimate():
    error, _ = _errors(load_platform("astros:mode_c"), "thruster_five", runs=8, duration=30.0)
    rms = np.sqrt(np.mean(error[len(error) // 2 :, :, :, :2] ** 2, axis=(0, 1, 3)))
    assert rms[0] < 0.15e-3
    assert rms[1] < 0.3e-3


def test_a_late_camera_is_allowed_for():
    platform = load_platform("astros:mode_c")
    late = replace(platform.sensors["position"], latency=0.1)
    platform = replace(platform, sensors={**platform.sensors, "position": late})
    error, _ = _errors(platform, velocity=np.array([0.05, 0.0, 0.0]))
    mean = np.mean(error[len(error) // 2 :, :, 0, 0])
    assert abs(mean) < 1e-4, "5 mm, were the lateness not known"


@pytest.mark.parametrize("name", ["astros", "sads"])
def test_a_machine_that_stays_where_it_is_has_no_place_in_its_estimate(name):
    _, shown = _errors(load_platform(name), runs=1, duration=1.0)
    assert not any(shown)


def test_a_run_that_no_camera_has_seen_has_no_place_yet():
    platform = load_platform("astros:mode_c")
    blind = replace(platform.sensors["position"], latency=0.5)
    platform = replace(platform, sensors={**platform.sensors, "position": blind})
    error, _ = _errors(platform, runs=1, duration=1.0)
    unseen = np.isnan(error).all(axis=(1, 2, 3))
    assert unseen[:9].all()
    assert not np.isnan(error[12:]).any()
