"""How a path's neighbours go is read from the path itself."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.predict.flights import flown, predictor
from twin import rotation
from twin.effects import State
from twin.library import library
from twin.predict import rollouts
from twin.predict.base import base_parameters
from twin.predict.body import Body
from twin.predict.states import STEP, PathForces
from twin.recording.log import open_log

SEED = 20261123

MACHINES = ["sads", "tas2", "astros", "astros:mode_c", "cubesat", "whorl1"]
HINGES = [
    "dfki_pendulum/logs/energy_shaping",
    "bicycle_fork/logs/first_swing",
    "vnucec_cubesat/logs/second_step",
]


def body_along(flight: str) -> Body:
    """A flight of ten seconds on a ball, or a measured log of a hinge."""
    name = flight.partition("/")[0]
    log = open_log(library("models") / flight) if "/" in flight else flown(name, SEED, 10.0)
    return predictor(log, name)


@pytest.mark.parametrize("platform", MACHINES + HINGES)
def test_neighbours_go_as_rollouts_of_them_do(platform: str, monkeypatch: pytest.MonkeyPatch):
    body = body_along(platform)
    base = base_parameters(body.machine)
    off_by = np.random.default_rng(SEED).uniform(0.97, 1.03, len(base.as_stated))
    model = base.model(base.as_stated * off_by)
    around, carried = body.rollouts.around(model, body.start)
    monkeypatch.setattr(rollouts, "is_gyrostat", lambda *_: False)
    rolled, by_difference = body.rollouts.around(model, body.start)
    np.testing.assert_allclose(carried, by_difference, atol=1e-2 * body.grid.step)
    np.testing.assert_array_equal(around[:1].rate, rolled[:1].rate)
    change, due = (paths[1:].less(paths[:1]) / STEP for paths in (around, rolled))
    largest = np.abs(due).max(axis=(0, 1, 2))
    off = np.abs(change - due).max(axis=(0, 1, 2)) / largest
    print(f"{platform}: at most {off.max():.1e} of the largest change of each number")
    assert off.max() < 1e-3


def test_neighbours_of_a_path_that_meets_the_stop_are_rolled_out(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rollouts, "STOP_GUARD", np.radians(5.0))
    body = predictor(flown("whorl1", SEED, 10.0), "whorl1")
    base = base_parameters(body.machine)
    model = base.model(base.as_stated)
    turn = np.zeros((body.grid.segments, body.start.width))
    turn[:, 0] = body.machine.platform.stop_angle
    beyond = body.start.moved(turn)
    found = body.rollouts.around(model, beyond)
    monkeypatch.setattr(rollouts, "is_gyrostat", lambda *_: False)
    rolled = body.rollouts.around(model, beyond)
    np.testing.assert_array_equal(found[0].rate, rolled[0].rate)
    np.testing.assert_array_equal(found[1], rolled[1])


@pytest.mark.parametrize("platform", MACHINES + HINGES)
def test_neighbours_feel_what_answers_to_the_path(platform: str, monkeypatch: pytest.MonkeyPatch):
    body = body_along(platform)
    model = base_parameters(body.machine).model(base_parameters(body.machine).as_stated)
    inertia = body.machine.platform.inertia.trace() / 3.0

    def law(state: State) -> NDArray[np.float64]:
        drag = -0.1 * state.rate - 0.5 * np.abs(state.rate) * state.rate
        wheels = 1e-6 * state.wheel_speed.sum(axis=-1, keepdims=True)
        hinge = state.position.shape[-1] == 1
        lean = np.sin(state.position) if hinge else rotation.vertical_body(state.position)
        return inertia * (drag + 0.05 * lean + wheels)

    push = PathForces(np.zeros_like(body.rollouts.force), ((1.0, law),))
    around, _ = body.rollouts.around(model, body.start, push)
    without, _ = body.rollouts.around(model, body.start)
    monkeypatch.setattr(rollouts, "is_gyrostat", lambda *_: False)
    rolled, _ = body.rollouts.around(model, body.start, push)
    change, due, bare = (paths[1:].less(paths[:1]) / STEP for paths in (around, rolled, without))
    largest = np.abs(due).max(axis=(0, 1, 2))
    off, felt = (np.abs(one - due).max(axis=(0, 1, 2)) / largest for one in (change, bare))
    print(f"{platform}: off by {off.max():.1e} where the law does {felt.max():.1e}")
    assert felt.max() > 1e-2
    assert off.max() < 1e-2 * felt.max()


def test_neighbours_of_what_turns_over_within_a_step_are_rolled_out(
    monkeypatch: pytest.MonkeyPatch,
):
    body = predictor(flown("sads", SEED, 10.0), "sads")
    model = base_parameters(body.machine).model(base_parameters(body.machine).as_stated)
    push = _dry(body)
    _, carried = body.rollouts.around(model, body.start, push)
    monkeypatch.setattr(rollouts, "is_gyrostat", lambda *_: False)
    _, rolled = body.rollouts.around(model, body.start, push)
    np.testing.assert_array_equal(carried, rolled)


def _dry(body: Body) -> PathForces:
    """Friction that has its whole size from 1e-5 rad/s on."""
    return PathForces(
        np.zeros_like(body.rollouts.force), ((0.1, lambda s: -np.tanh(s.rate / 1e-5)),)
    )
