"""How the fit by prediction error steps."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from twin.identification.prediction_error import _share


def test_steps_that_overshoot_are_shortened_to_where_they_end() -> None:
    # along every number the true curvature is 2.2 times what the columns say: steps would diverge
    columns = np.random.default_rng(3).normal(size=(20, 4))
    now: Any = SimpleNamespace(columns=columns)
    at, before = np.ones(4), None
    for _ in range(3):
        step = -2.2 * at
        share = 1.0 if before is None else _share(now, step, *before)
        at, before = at + share * step, (step, share)
    np.testing.assert_allclose(at, 0.0, atol=1e-12)


def test_steps_that_fall_short_are_not_lengthened() -> None:
    now: Any = SimpleNamespace(columns=np.eye(2))
    assert _share(now, np.array([0.5, 0.5]), np.array([1.0, 1.0]), 1.0) == 1.0
