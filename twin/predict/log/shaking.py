"""How much more a sensor scatters while something moves: as a platform states it, and where stages
move as nobody knows."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.effects import ScatterEffect
from twin.predict.drive.inputs import Inputs
from twin.predict.drive.unread import felt
from twin.predict.sensors.sensed import Sense

Array = NDArray[np.float64]


def added_variance(effect: ScatterEffect, inputs: Inputs, time: Array) -> Array:
    """(m, 1) or (m, k) of its sensor at some instants (m,) [s]."""
    _, velocity, _ = inputs.joint_states(time)
    cause = velocity[:, inputs.machine.stage_dof]
    return np.square(effect.sigma(cause[None], inputs.machine.platform))[0]


def shaking(inputs: Inputs, senses: Mapping[str, Sense], stream: str, time: Array) -> Array | None:
    """(m, 1) or (m, k) variance of it all; None where nothing shakes a stream."""
    every = [effect for effect in inputs.machine.effects if isinstance(effect, ScatterEffect)]
    parts = [added_variance(effect, inputs, time) for effect in every if effect.acts_on == stream]
    sense, doubt = senses.get(stream), inputs.stage_doubt
    if sense is not None and sense.feels_turning and doubt is not None:
        pull = felt(inputs.machine, doubt, sense.site, time)
        tilted = pull[:, 1::-1] / sense.gravity**2
        parts.append(pull if stream == "accelerometer" else tilted)
    return np.asarray(sum(parts)) if parts else None
