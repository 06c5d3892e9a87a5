"""How a path's neighbours go is read from the path itself."""

import numpy as np
import pytest

from tests.predict.flights import flown, predictor
from twin.predict.parameters.base import base_parameters
from twin.predict.path import rollouts
from twin.predict.path.rollouts import STEP

SEED = 20261123


@pytest.mark.parametrize("platform", ["sads", "tas2", "astros", "cubesat", "whorl1"])
def test_neighbours_go_as_rollouts_of_them_do(platform: str, monkeypatch: pytest.MonkeyPatch):
    body = predictor(flown(platform, SEED), platform)
    base = base_parameters(body.machine)
    model = base.model(base.as_stated * np.random.default_rng(SEED).uniform(0.97, 1.03, 9))
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
    body = predictor(flown("whorl1", SEED), "whorl1")
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
