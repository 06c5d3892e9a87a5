"""First-order changes of a path."""

import numpy as np
import pytest

from twin.errors import TwinError
from twin.predict.states import carried_states


def test_what_carries_a_state_on_is_what_its_reach_grows_by() -> None:
    steps = np.random.default_rng(5).normal(size=(3, 6, 4, 4))
    reach = np.empty((3, 7, 4, 4))
    reach[:, 0] = np.eye(4)
    for k in range(6):
        reach[:, k + 1] = steps[:, k] @ reach[:, k]
    np.testing.assert_allclose(carried_states(reach), steps, rtol=1e-7, atol=1e-7)


def test_a_motion_that_forgets_its_start_is_refused_with_a_sentence() -> None:
    reach = np.tile(np.eye(2), (1, 4, 1, 1))
    reach[:, 2:, 1] = 0.0
    with pytest.raises(TwinError, match="damped so strongly"):
        carried_states(reach)
