"""What a command to one actuator should do: to the body, and to what the actuator itself shows.

Each is linear in the command u(t) that was applied, so it is predicted from the platform alone:

    wheel      -a u              thruster   r x d u
    coils      e_k x B u         gimbal     -(g x H) u, H what it carries

on the body [N m], and on its own reading  u / I  a wheel's speed,  u  a gimbal's angle.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.rotation import conjugate, cross, rotate
from twin.service.sense import Motion, at, carried_axes, rows, speeds
from twin.signals import Command, Reading

Array = NDArray[np.float64]

OWN = {"command_wheel_torque": "wheel_speed", "command_gimbal_rate": "gimbal_angle"}
"""Command -> the stream that shows its integral."""

Applied = Sequence[tuple[float, Command]]
"""Commands and from when on each was applied [s]."""


def lever(
    platform: Platform, readings: Sequence[Reading], times: Array, stream: str, column: int
) -> Array | None:
    """Torque on the body (m, 3) for each unit of a command.

    Returns:
        None where it cannot be told: no field is known, or nothing turns a free body by it.
    """
    shape = (len(times), 3)
    match stream:
        case "command_wheel_torque":
            return -carried_axes(platform, readings, times)[column]
        case "command_thruster":
            part = platform.thrusters[column]
            return np.broadcast_to(np.cross(part.point, part.direction), shape)
        case "command_dipole":
            field = _field(platform, readings, times)
            return (
                None if field is None else cross(np.broadcast_to(np.eye(3)[column], shape), field)
            )
        case "command_gimbal_rate":
            gimbal = platform.gimbals[column]
            carried = np.zeros(shape)
            parts = (*platform.wheels, *platform.rotors)
            axes, turning = (part(platform, readings, times) for part in (carried_axes, speeds))
            for part, axis, speed in zip(parts, axes, turning, strict=True):
                if part.gimbal == gimbal.name:
                    carried = carried + part.inertia * speed[:, None] * axis
            return -cross(np.broadcast_to(gimbal.axis, shape), carried)
        case _:
            return None


def turned(
    platform: Platform,
    readings: Sequence[Reading],
    applied: Applied,
    seen: Motion,
    stream: str,
    column: int,
) -> Array | None:
    """Change of the rate (m, 3) that a command should have made since the start [rad/s].

    Returns:
        As `lever`.
    """
    torque = lever(platform, readings, seen.times, stream, column)
    if torque is None:
        return None
    pushed = np.diff(pushes(applied, seen.times, stream, column))[:, None]
    pieces = 0.5 * (torque[1:] + torque[:-1]) * pushed
    angular = np.concatenate([np.zeros((1, 3)), np.cumsum(pieces, axis=0)])
    return angular @ np.linalg.inv(platform.inertia)


def pushes(applied: Applied, times: Array, stream: str, column: int) -> Array:
    """(m,) integral of what was applied, up to each time."""
    begun = np.array([time for time, _ in applied])
    value = np.array([command[stream][0, column] for _, command in applied])
    ends = np.append(begun, max(float(begun[-1]), float(times[-1])))
    whole = np.concatenate([[0.0], np.cumsum(value * np.diff(ends))])
    return np.interp(times, ends, whole)


def own_gain(platform: Platform, stream: str, column: int) -> float:
    """Of an actuator's own reading, for each unit of its pushes."""
    return 1.0 / platform.wheels[column].inertia if "wheel" in stream else 1.0


def limit(platform: Platform, stream: str, column: int) -> float:
    """The largest command."""
    match stream:
        case "command_wheel_torque":
            return platform.wheels[column].torque_limit
        case "command_thruster":
            return platform.thrusters[column].force_limit
        case "command_gimbal_rate":
            return platform.gimbals[column].rate
        case "command_dipole":
            return min(coil.dipole_limit for coil in platform.magnetorquers)
        case _:
            return platform.base.torque_limit


def _field(platform: Platform, readings: Sequence[Reading], times: Array) -> Array | None:
    """B (m, 3) in body axes [T]: the stated one, which laws go by, or as it is measured."""
    attitude = rows(readings, "attitude")
    if attitude is not None and np.any(platform.magnetic_field):
        turns = attitude[1][np.argmin(np.abs(times[:, None] - attitude[0]), axis=1)]
        return rotate(conjugate(turns), np.broadcast_to(platform.magnetic_field, (len(times), 3)))
    measured = rows(readings, "magnetometer")
    return None if measured is None else at(times, *measured)
