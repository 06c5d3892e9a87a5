"""Where stages were between two readings: a torque that nobody knows while they move.

Of a mass that goes as it was told the drive's own profile says where it was. One that is late, or
sent on by each of many short moves, is seen at its readings alone, of which a shared line gives a
few in a move; what gravity does with the rest is white as a body feels it.
"""

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.model import Machine
from twin.recording import Series

Array = NDArray[np.float64]


def between_readings(error: Series, rounding: float) -> Series:
    """How well positions are known after each reading: their variance times how long it lasts.

    What a straight line through its neighbours misses a reading by is twice what one through the
    readings misses at a bend; it is taken as it is, since the axes of a line are read one after the
    other, and are stamped together.

    Args:
        error: readings (m, stages) beside the course that the stages were told to take [m].
        rounding: of a reading [m]; what strays no farther than twice that is known.

    Returns:
        (m, stages) [m^2 s].
    """
    time, value = error.time, error.value
    missed = np.zeros_like(value)
    if len(time) > 2:
        share = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
        missed[1:-1] = np.abs(value[1:-1] - (1.0 - share) * value[:-2] - share * value[2:])
    missed[missed <= 2.0 * rounding] = 0.0
    after = np.maximum(missed, np.concatenate([missed[1:], missed[-1:]]))
    lasting = np.diff(time, append=time[-1:])[:, None]
    return Series(time, np.square(after) * lasting, error.columns, "m^2 s")


def pushed(machine: Machine, doubt: Series, begins: Array, attitude: Array) -> Array:
    """Intensity (S, steps, 3, 3) of the torque on a base by what is not known [(N m)^2 s].

    Args:
        machine: compiled.
        doubt: as `between_readings` has it.
        begins: (S, steps) at which the steps begin [s].
        attitude: (S, steps, 4).
    """
    moved = np.einsum("b,bsi->si", machine.sliding.mass, machine.sliding.travel)
    gravity = machine.platform.gravity * rotation.vertical_body(attitude)
    torque = rotation.cross(moved, gravity[..., None, :])
    variance = doubt.held_at(begins.ravel()).reshape(*begins.shape, -1)
    return np.einsum("snki,snk,snkj->snij", torque, variance, torque)


def felt(machine: Machine, doubt: Series, site: Array, time: Array) -> Array:
    """Variance (m, 3) of what a sensor at a site feels of stages' unknown pulls [(m/s^2)^2].

    Their drives pull with all their acceleration, or do not, and the body turns against it.

    Args:
        machine: compiled.
        doubt: as `between_readings` has it.
        site: (3,) from the CR, body axes [m].
        time: (m,) of the sensor's samples [s].
    """
    sliding = machine.sliding
    momentum = rotation.cross(sliding.home[:, None], sliding.travel)
    pull = np.array([stage.acceleration for stage in machine.platform.stages])
    torque = pull[:, None] * np.einsum("b,bsi->si", sliding.mass, momentum)
    turning = np.linalg.solve(machine.platform.inertia, torque.T).T
    unknown = (doubt.held_at(time) > 0.0).astype(np.float64)
    return unknown @ np.square(rotation.cross(turning, site))
