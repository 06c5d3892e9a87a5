"""J and m r from the balance of angular momentum, by linear least squares.

About the centre of rotation, in world axes, with R = R(q):

    R (J w + sum a_i I_i Omega_i) - integral R (m r x g_body) dt - integral T_applied dt = constant

It is linear in J and m r, and nothing is differentiated. Motion and wheel speeds are smoothed
first; the noise that is left in w makes J a little small, so this is where a fit starts, and a
cross-check of it. It is the momentum integral of J. L. Schwartz and C. D. Hall (AAS 04-122), with
the constant as three more unknowns in place of differences between neighbours.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.identification.linear.equations import Equations, inertia_rows, integral
from twin.identification.linear.least_squares import Estimate, least_squares
from twin.identification.track import gyro_bias, track_of
from twin.model import Machine
from twin.predict.base import BaseParameters
from twin.predict.logs import Motion
from twin.recording import Recording

Array = NDArray[np.float64]

INTERVAL = 0.25
"""Between the instants at which the balance is taken [s]."""


def momentum_fit(logs: list[tuple[Recording, Motion]], base: BaseParameters) -> Estimate:
    """Fit logs together.

    Args:
        logs: each with its smoothed motion.
        base: the parameters sought.

    Raises:
        UsageError: nothing that could be sought shows in the logs, be they too short or still.
    """
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
