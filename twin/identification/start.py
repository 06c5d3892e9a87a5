"""What logs can show of a machine, and the initial guess of a fit.

J and m r from the balance of angular momentum, by linear least squares.
About the centre of rotation, in world axes, with R = R(q):

    R (J w + sum a_i I_i Omega_i) - integral R (m r x g_body) dt - integral T_applied dt = constant

It is linear in J and m r, and nothing is differentiated. Motion and wheel speeds are smoothed
first; the noise that is left in w makes J a little small, so this is where a fit starts, and a
cross-check of it. It is the momentum integral of J. L. Schwartz and C. D. Hall (AAS 04-122), with
the constant as three more unknowns in place of differences between neighbours.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.effects import BodyEffect
from twin.errors import TwinError
from twin.identification.linear import (
    Equations,
    LinearEstimate,
    inertia_rows,
    integral,
    least_squares,
)
from twin.identification.prediction_error import NORMAL, Fit, fit
from twin.identification.track import gyro_bias, track_of
from twin.model import Machine
from twin.predict.base import BaseParameters, base_parameters, joint_parameters
from twin.predict.body import Body
from twin.predict.innovations import Problem, retraced
from twin.predict.logs import Motion
from twin.recording import Recording

Array = NDArray[np.float64]


SURE = 0.2
"""Of a parameter's scale: half an interval with which the momentum's answer is worth starting from.
"""


WHEEL_COMMANDS = ("command_wheel_torque", "command_wheel_duty")


def base_of(machine: Machine, logs: Sequence[Recording]) -> tuple[BaseParameters, BaseParameters]:
    """J and m r as these logs can show them, and with what the MJCF states of its joints."""
    base = base_parameters(
        machine,
        torque=any(drives(log, machine) for log in logs),
        angle=any("joint_angle" in log for log in logs),
    )
    wheels = any(name in log for log in logs for name in WHEEL_COMMANDS)
    return base, base.with_joints(joint_parameters(machine, wheels))


def drives(recording: Recording, machine: Machine) -> bool:
    """Whether a log has a torque of known size, or a momentum or mass that moves.

    A stream that is zero throughout drives nothing.
    """
    known = (*machine.platform.commands, "command_wheel_duty", "wheel_speed", "stage_position")
    return any(bool(np.any(recording[name].value)) for name in known if name in recording)


def first_theta(base: BaseParameters, first: LinearEstimate) -> Array:
    """The momentum's answer where it is sure, if some rigid body has it, else as stated."""
    known = first.half_widths < SURE * base.scale
    theta = np.where(known, first.theta, base.as_stated)
    try:
        base.model(theta)
    except TwinError:
        return base.as_stated
    return theta


def first_biases(body: Body) -> Array:
    """(b,) first guess of the sensors' constant errors."""
    guess = gyro_bias(body.recording)
    return np.concatenate(
        [
            guess[o.bias > 0.0] if o.stream == "gyro" else np.zeros(np.count_nonzero(o.bias))
            for o in body.outputs
        ]
    )


ROUNDS = 3
"""Times that a motion is followed, each nearer to its own."""


def rings(machine: Machine) -> bool:
    """Whether a part hangs on it that moves by itself."""
    return any(isinstance(effect, BodyEffect) and effect.hangs_on for effect in machine.effects)


def along_what_rings(problem: Problem, result: Fit) -> tuple[Problem, Fit]:
    """The same along the motion that the fit gives the logs, fitted again.

    Args:
        problem: the logs.
        result: their fit.
    """
    for _ in range(ROUNDS):
        bodies = [retraced(problem, result.innovations, log) for log in range(len(problem.bodies))]
        problem = Problem(bodies, problem.base, problem.perturbations, held=problem.held)
        starts = tuple(body.start for body in bodies)
        result = fit(problem, replace(result.at, starts=starts))
    return problem, result


INTERVAL = 0.25
"""Between the instants at which the balance is taken [s]."""


def momentum_fit(logs: list[tuple[Recording, Motion]], base: BaseParameters) -> LinearEstimate:
    """Fit logs together.

    Args:
        logs: each with its smoothed motion.
        base: the parameters sought.

    Raises:
        UsageError: nothing that could be sought shows in the logs, be they too short or still.
    """
    if base.machine.platform.base.kind == "planar":
        # the machine as stated is near enough: what is predicted is linear in what is fitted
        return LinearEstimate(base.as_stated, np.diag(np.square(base.scale)), NORMAL)
    balances = [_balance(recording, motion, base.machine) for recording, motion in logs]
    return least_squares(balances, base, constants=balances[0].target.shape[1])


def _balance(recording: Recording, motion: Motion, machine: Machine) -> Equations:
    stride = max(round(INTERVAL / float(np.median(np.diff(motion.time)))), 1)
    if machine.platform.base.kind == "ball":
        motion = replace(motion, rate=motion.rate - gyro_bias(recording))
    track = track_of(machine, recording, motion)
    turn = rotation.matrix(track.attitude)
    gravity = np.array([0.0, 0.0, -machine.platform.gravity])
    push = rotation.cross(rotation.rotate(track.attitude, track.moved), gravity)
    push = push + rotation.rotate(track.attitude, track.torque)
    target = integral(push, track) - rotation.rotate(track.attitude, track.carried)
    moment = -integral(rotation.cross(turn.swapaxes(1, 2), gravity), track).swapaxes(1, 2)
    rows = np.concatenate([turn @ inertia_rows(track.rate), moment], axis=2)
    # the constants, one a component, are taken out by the mean
    rows, target = rows[::stride], target[::stride]
    rows, target = rows - rows.mean(axis=0), target - target.mean(axis=0)
    return Equations(track.time[::stride], rows, target).about(track.axis)
