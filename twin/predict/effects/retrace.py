"""A log's motion as a fit has it: along this, forces are formed that smoothed data would lose.

Smoothed data lack what is faster than their window: the kick of a command, and with it the ringing
of whatever hangs on the machine. And their noise is in every force along them, and so in the column
of an effect, which a large effect is multiplied by. A fit's motion has all that the commands do; of
the data it takes what the model cannot say, as the torque that a Kalman smoother finds.
"""

from dataclasses import replace

import numpy as np

from twin.predict.body import Body
from twin.predict.path.states import States
from twin.predict.whitening.innovations import Innovations, Problem
from twin.predict.whitening.unexplained import smoothed_torque


def retraced(problem: Problem, now: Innovations, log: int) -> Body:
    """The predictor of a log, following the motion that a fit gives it, and starting there.

    Where nobody recorded what drove the wheels or the gimbals, a prediction knows no more of their
    kicks than smoothed data do: there the predictor is returned as it is.

    Args:
        problem: the logs.
        now: their fit, exact or disturbed.
        log: which of them.
    """
    body = problem.bodies[log]
    gimbals = body.start.gimbal_angle.shape[-1] > 0
    if body.inputs.wheels_undriven or (gimbals and body.inputs.gimbals_undriven):
        return body
    path = _path(problem, now, log)
    pushes = None if now.intensity > 0.0 else problem.pushes(log, now.at)
    followed = body.following(path, pushes)
    followed.start = path[0, :, 0]
    return followed


def _path(problem: Problem, now: Innovations, log: int) -> States:
    """(1, S, ...) from starts at their best, under the torque that the fit leaves unexplained."""
    body, exact = problem.bodies[log], now.exact[log]
    none = np.zeros(exact.linear.shared.shape[-1])
    starts = now.at.starts[log]
    start = starts.moved(now.chains[log].states(none)[:, : starts.width])
    push = problem.push(log, now.at)
    if now.intensity > 0.0:
        base, k = body.machine.base_dof, exact.path.rate.shape[-1]
        # It is a torque on the machine as stated, and the path is that of the machine as fitted.
        rate = slice(k, 2 * k)
        alike = np.linalg.solve(exact.answer[:, 0, rate, base], exact.local.pushed[:, rate])
        force = push.force.copy()
        force[..., base] += np.einsum("sij,stj->sti", alike, smoothed_torque(now, log))
        push = replace(push, force=force)
    return body.rollouts.paths(problem.base.model(now.at.theta), start.one(), push)
