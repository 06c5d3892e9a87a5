"""Steps under torque laws, which answer to each step's state."""

import numpy as np
import pytest
from mujoco.batch import SimulationError

from twin.effects import parse_effects, with_effects
from twin.model import compile_model
from twin.plant.forces import Forces
from twin.platform import load_platform

FRICTION = "bearing_coulomb_friction=1e-3"


class Failing:
    """A batch in which run 0 fails at the first step, run 1 at the second, and no run after."""

    def __init__(self, nq: int, nv: int) -> None:
        self._sizes = {"qpos": nq, "qvel": nv}
        self._calls = 0

    def bind(self, name: str) -> np.ndarray:
        return np.ones((3, self._sizes[name]))

    def rollout(self, *_: object, out: dict[str, np.ndarray], **__: object) -> None:
        for rows in out.values():
            rows[:] = 0.0
        self._calls += 1
        if self._calls <= 2:
            raise SimulationError(np.array([self._calls - 1]), "bad QACC")


def test_every_run_that_failed_at_any_step_is_told():
    machine = compile_model(with_effects(load_platform("sads"), parse_effects(FRICTION)))
    nq, nv = machine.model.nq, machine.model.nv
    with pytest.raises(SimulationError) as told:
        Forces(machine, 3).rollout(
            Failing(nq, nv),
            5,
            None,
            np.zeros(3),
            np.empty((3, 5, nq + nv)),  # pyright: ignore
        )
    assert told.value.ids.tolist() == [0, 1]
