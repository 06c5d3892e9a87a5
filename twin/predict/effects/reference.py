"""Where a spring is at rest that pulls a machine back to where a log began.

A log shows its first attitude only as well as its sensors do. A spring that is seen ten thousand
times better than it need be shows it better, and would call the difference a torque of its own.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.effects import BodyEffect, Effect
from twin.predict.body import Body
from twin.predict.effects.forces import force_of
from twin.predict.effects.perturbation import Perturbation

Array = NDArray[np.float64]

TURN = 1e-4
"""Of a difference [rad]."""
UNSEEN = 1.0
"""1 sigma of a first attitude that no stream shows [rad]."""


def references_of(effect: Effect, bodies: Sequence[Body]) -> tuple[Perturbation, ...]:
    """How an effect would act whose spring rests elsewhere: of each log, a turn about each axis.

    Returns:
        For each log as many as its base has axes; none for an effect without such a spring.
    """
    if not isinstance(effect, BodyEffect) or not effect.follows_start:
        return ()
    return tuple(
        _turned(effect, body, axis, log)
        for log, body in enumerate(bodies)
        for axis in range(body.start.rate.shape[-1])
    )


def _turned(effect: BodyEffect, of: Body, axis: int, log: int) -> Perturbation:
    recording = of.recording

    def force(body: Body) -> Array:
        grid = body.grid
        if body.recording is not recording:
            return np.zeros((grid.segments, grid.steps, body.machine.model.nv))
        turn = np.zeros(body.start.rate.shape[-1])
        turn[axis] = TURN
        return (force_of(effect, body, turn) - force_of(effect, body, -turn)) / (2.0 * TURN)

    name = f"{effect.label} rest of log {log} about {'xyz'[axis]}"
    return Perturbation(name, "rad", _known(of), force=force)


def _known(body: Body) -> float:
    """1 sigma of the first attitude, before a motion is followed [rad]."""
    seen = [o.noise.max() for o in body.outputs if o.stream in ("attitude", "joint_angle")]
    return float(min(seen, default=UNSEEN))
