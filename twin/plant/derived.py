"""Streams that stand in no column of MuJoCo's state: what a perfect sensor makes of it.

Specific force is the mean over the physics step before the sample, or over as many of them as fill
the sensor's window, as an accelerometer that sums up velocity increments gives it.
"""

import math
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.model import Machine
from twin.platform import Sensor
from twin.rotation import conjugate, cross, rotate

Array = NDArray[np.float64]
_EPS = 1e-9
Derived = Callable[[Sensor | None, Array, Array], Array]
"""Of a sensor, states (n, m, nq + nv) and those before them (n, b, nq + nv): (n, m, k)."""


def window_steps(sensor: Sensor, step: float) -> int:
    """Physics steps that hold a sensor's window, at least one."""
    return max(math.ceil(sensor.window / step - _EPS), 1)


def derived_streams(machine: Machine) -> dict[str, Derived]:
    """By stream, those that this machine can have."""
    if machine.platform.base.kind == "hinge":
        return {}
    streams = _Derived(machine)
    return {
        "inclinometer": streams.inclinometer,
        "accelerometer": streams.accelerometer,
        "magnetometer": streams.magnetometer,
        "position": streams.position,
        "velocity": streams.velocity,
    }


def site_places(machine: Machine) -> dict[str, Array]:
    """(3,) from the CR to each site, body axes [m]."""
    model = machine.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    anchor = data.xanchor[model.body_jntadr[machine.base_body]]
    return {model.site(i).name: data.site_xpos[i] - anchor for i in range(model.nsite)}


def specific_force(attitude: Array, push: Array, rate: Array, turning: Array, site: Array) -> Array:
    """What an accelerometer feels, body axes [m/s^2].

    Args:
        attitude: (..., 4).
        push: (..., 3) acceleration of the CR less gravity's, in the room [m/s^2].
        rate: (..., 3) [rad/s], body axes.
        turning: (..., 3) its derivative [rad/s^2].
        site: (3,) from the CR [m].
    """
    felt = rotate(conjugate(attitude), push)
    return felt + cross(turning, site) + cross(rate, cross(rate, site))


def elevations(force: Array, gravity: float) -> Array:
    """Roll and pitch (..., 2) that specific force (..., 3) makes believe [rad]."""
    level = np.clip(force / gravity, -1.0, 1.0)
    return np.stack([np.arcsin(level[..., 1]), -np.arcsin(level[..., 0])], axis=-1)


class _Derived:
    def __init__(self, machine: Machine) -> None:
        model, nq = machine.model, machine.model.nq
        self._step = machine.platform.step
        self._gravity = machine.platform.gravity
        self._field = machine.platform.magnetic_field
        self._attitude = machine.base_qpos
        self._rate = slice(nq + machine.base_dof.start, nq + machine.base_dof.stop)
        self._place = machine.place_qpos
        self._speed = nq + machine.place_dof
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        anchor = data.xanchor[model.body_jntadr[machine.base_body]]
        self._height = float(anchor[2])
        self._sites = site_places(machine)

    def accelerometer(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """Specific force at the sensor's site, body axes [m/s^2]."""
        assert sensor is not None
        steps, window = window_steps(sensor, self._step), max(sensor.window, self._step)
        moving = np.concatenate([before[:, before.shape[1] - steps :], states], axis=1)
        earlier = moving[:, :-steps]
        too_early = steps - window / self._step
        if too_early > _EPS:
            later = moving[:, 1 : moving.shape[1] - steps + 1]
            earlier = earlier + too_early * (later - earlier)
        rate, site = states[..., self._rate], self._sites[sensor.site]
        turning = (rate - earlier[..., self._rate]) / window
        push = np.zeros_like(rate)
        push[..., 2] = self._gravity
        if self._speed.size:
            gained = states[..., self._speed] - earlier[..., self._speed]
            push[..., : self._speed.size] += gained / window
        return specific_force(states[..., self._attitude], push, rate, turning, site)

    def inclinometer(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """Elevations roll and pitch that specific force makes believe [rad]."""
        return elevations(self.accelerometer(sensor, states, before), self._gravity)

    def magnetometer(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """The field in body axes [T]."""
        del sensor, before
        return rotate(conjugate(states[..., self._attitude]), self._field)

    def position(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """Of the CR in the room [m]."""
        del sensor, before
        place = np.empty((*states.shape[:-1], 3))
        place[..., 2] = self._height
        place[..., : self._place.size] = states[..., self._place]
        return place

    def velocity(self, sensor: Sensor | None, states: Array, before: Array) -> Array:
        """Of the CR in the room [m/s]."""
        del sensor, before
        speed = np.zeros((*states.shape[:-1], 3))
        speed[..., : self._speed.size] = states[..., self._speed]
        return speed
