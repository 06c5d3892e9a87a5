"""How sliding masses are planned to move."""

import numpy as np
import pytest

from tests.seeds import seed_of
from twin.plant.prescribed import plan


def test_stages_go_alone_as_they_do_in_a_batch_to_the_bit(request: pytest.FixtureRequest):
    seed = seed_of(request)
    draw = np.random.default_rng(seed)
    limits = {"max_speed": np.array([0.002, 0.01]), "max_acceleration": np.array([0.02, 0.05])}
    position, speed = draw.uniform(-0.02, 0.02, (3, 2)), np.zeros((3, 2))
    alone = [(position[i : i + 1], speed[i : i + 1]) for i in range(3)]
    for tick in range(400):
        if tick % 40 == 0:
            target = position + draw.choice([-1.0, 0.0, 1.0], (3, 2)) * 10.0 ** draw.uniform(-7, -2)
        together, position, speed = plan(position, speed, target, steps=5, step=0.01, **limits)
        for i in range(3):
            own, *alone[i] = plan(*alone[i], target[i : i + 1], steps=5, step=0.01, **limits)
            assert np.array_equal(own, together[i : i + 1])
            assert np.array_equal(np.concatenate(alone[i]), np.stack([position[i], speed[i]]))
