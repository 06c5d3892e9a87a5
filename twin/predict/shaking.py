"""How much more a sensor scatters while something moves, as a platform states it."""

import numpy as np
from numpy.typing import NDArray

from twin.effects import ScatterEffect
from twin.predict.drive import Inputs

Array = NDArray[np.float64]


def added_variance(effect: ScatterEffect, inputs: Inputs, time: Array) -> Array:
    """(m, 1) or (m, k) of its sensor at some instants (m,) [s]."""
    _, velocity, _ = inputs.joint_states(time)
    cause = velocity[:, inputs.machine.stage_dof]
    return np.square(effect.sigma(cause[None], inputs.machine.platform))[0]


def shaking(inputs: Inputs, stream: str, time: Array) -> Array | None:
    """(m, 1) or (m, k) variance of all that the machine states; None where nothing shakes it."""
    every = [effect for effect in inputs.machine.effects if isinstance(effect, ScatterEffect)]
    own = [effect for effect in every if effect.acts_on == stream]
    if not own:
        return None
    return np.asarray(sum(added_variance(effect, inputs, time) for effect in own))
