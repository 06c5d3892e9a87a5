"""Forces that a model may lack, at strength 1 along the measured motion of a log.

Formed from the smoothed motion, not from the predicted one, so that a strength is a linear unknown
and a model need not contain the law. Each returns (S, steps, nv) [N m] for its `Body`.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.predict.body import Body
from twin.predict.log.motion import Motion

Array = NDArray[np.float64]
Shape = Callable[[Body], Array]

DELAY_STEP = 0.01
"""Lag [s] of the difference that stands for a command's derivative."""
STANDSTILL = 0.01
"""Share of the highest rates below which dry friction fades."""


def on_base(law: Callable[[Body, Motion], Array]) -> Shape:
    """A torque (m, k) on the base joint, body axes, from the motion at the middle of each step."""

    def shape(body: Body) -> Array:
        return _spread(body, law(body, _middle(body)), body.machine.base_dof)

    return shape


def viscous(body: Body, at: Motion) -> Array:
    """-w."""
    return -at.rate


def dry(body: Body, at: Motion) -> Array:
    """-w / abs(w), faded where the machine stands still."""
    slow = standstill(body.motion)
    return -at.rate / np.sqrt(np.sum(np.square(at.rate), axis=1, keepdims=True) + slow**2)


def drag(body: Body, at: Motion) -> Array:
    """-abs(w_i) w_i an axis."""
    return -np.abs(at.rate) * at.rate


def swirl(body: Body, at: Motion) -> Array:
    """R^T (0, 0, 1); of a hinge, a constant torque."""
    if at.position.shape[1] == 1:
        return np.ones_like(at.rate)
    return rotation.vertical_body(at.position)


def cable(body: Body, at: Motion) -> Array:
    """-phi, the turn from the log's first attitude."""
    first = body.motion.position[0]
    if at.position.shape[1] == 1:
        return first - at.position
    turned = rotation.multiply(rotation.conjugate(first), at.position)
    return -rotation.to_rotation_vector(turned)


def fixed(axis: int) -> Callable[[Body, Motion], Array]:
    """1 N m about a body axis."""

    def law(body: Body, at: Motion) -> Array:
        torque = np.zeros_like(at.rate)
        torque[:, axis] = 1.0
        return torque

    return law


def dipole(axis: int) -> Callable[[Body, Motion], Array]:
    """m x R^T B of 1 A m2 along a body axis."""

    def law(body: Body, at: Motion) -> Array:
        field = body.inputs.field_world
        field_body = rotation.rotate(rotation.conjugate(at.position), field)
        return rotation.cross(np.eye(3)[axis], field_body)

    return law


def drifting_mass(axis: int) -> Callable[[Body, Motion], Array]:
    """(m r) x g of a CM that moves steadily along a body axis, 1 kg m/s, from the log's start."""

    def law(body: Body, at: Motion) -> Array:
        gravity = -body.machine.platform.gravity * rotation.vertical_body(at.position)
        moment = (at.time - body.motion.time[0])[:, None] * np.eye(3)[axis]
        return rotation.cross(moment, gravity)

    return law


def command_gain(index: int) -> Shape:
    """One commanded torque once more: of a hinge's motor, or of a wheel's."""

    def shape(body: Body) -> Array:
        force = np.zeros((body.grid.segments, body.grid.steps, body.machine.model.nv))
        column = _driven(body)[index]
        force[..., column] = body.commanded()[..., column]
        return force

    return shape


def command_delay(body: Body) -> Array:
    """What commands that act 1 s later would change, by their slope."""
    return (body.commanded(DELAY_STEP) - body.commanded()) / DELAY_STEP


def wheel_friction(index: int, *, dry: bool) -> Shape:
    """A torque against one wheel's spin, on wheel and body: 1 N m s times it, or 1 N m."""

    def shape(body: Body) -> Array:
        time = body.grid.starts[:, None] + body.grid.step * (np.arange(body.grid.steps) + 0.5)
        speed = body.inputs.joint_states(time.ravel())[1][:, body.machine.wheel_dof[index]]
        slow = max(STANDSTILL * float(np.quantile(np.abs(speed), 0.95)), 1e-9)
        torque = -speed / np.hypot(speed, slow) if dry else -speed
        dof = body.machine.wheel_dof[index]
        return _spread(body, torque[:, None], slice(dof, dof + 1))

    return shape


def wheel_misalignment(index: int, across: int) -> Shape:
    """One wheel turned by 1 rad in its mount, about one of the two directions across its axis.

    Its momentum h a becomes h (a + u x a), and its change pushes the body the other way.
    """

    def shape(body: Body) -> Array:
        machine = body.machine
        wheel, dof = machine.platform.wheels[index], machine.wheel_dof[index]
        axis = np.asarray(wheel.axis, dtype=np.float64)
        turned = np.asarray(np.linalg.svd(axis[None])[2][1 + across], dtype=np.float64)
        middle = _middle(body)
        _, velocity, acceleration = body.inputs.joint_states(middle.time)
        momentum = wheel.inertia * (velocity[:, dof] + middle.rate @ axis)
        commanded = body.commanded()[..., dof].ravel()
        # what acts on a rotor is its change of momentum, and has no noise of a difference in it
        change = commanded if commanded.any() else wheel.inertia * acceleration[:, dof]
        torque = -np.outer(change, turned)
        torque -= rotation.cross(middle.rate, np.outer(momentum, turned))
        return _spread(body, torque, machine.base_dof)

    return shape


def standstill(motion: Motion) -> float:
    """Rate below which dry friction fades [rad/s]."""
    rates = np.linalg.norm(motion.rate, axis=1)
    return max(STANDSTILL * float(np.quantile(rates, 0.95)), 1e-9)


def _driven(body: Body) -> list[int]:
    """Degrees of freedom that commanded torques act on."""
    machine = body.machine
    if machine.platform.base.kind == "hinge":
        return [machine.base_dof.start]
    return [int(dof) for dof in machine.wheel_dof]


def _middle(body: Body) -> Motion:
    """The smoothed motion at the middle of each step, flat."""
    time = body.grid.starts[:, None] + body.grid.step * (np.arange(body.grid.steps) + 0.5)
    return body.motion.at(time.ravel())


def _spread(body: Body, torque: Array, dofs: slice) -> Array:
    force = np.zeros((body.grid.segments, body.grid.steps, body.machine.model.nv))
    force[..., dofs] = torque.reshape(body.grid.segments, body.grid.steps, -1)
    return force
