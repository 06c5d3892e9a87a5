"""Torques on the base that a model may lack, as shapes along the measured motion.

A law's strength is its one unknown. Its shape is formed from the smoothed motion, not from the
predicted one, so that a strength is a linear unknown and a model need not contain the law.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.predict.drive import Inputs
from twin.predict.motion import Motion
from twin.predict.rollout import Predictor

Array = NDArray[np.float64]

DELAY_STEP = 0.01
"""Lag [s] of the difference that stands for a command's derivative."""

STANDSTILL = 0.01
"""Share of the highest rates below which dry friction fades."""


@dataclass(frozen=True)
class Context:
    """Where a shape is evaluated."""

    motion: Motion
    """At the middle of each step."""
    command: Array | None
    """(m, k) mean torque that the commands put on the base over each step [N m]."""
    later: Array | None
    """The same, `DELAY_STEP` before."""
    slow: float
    """Rate below which dry friction fades [rad/s]."""
    first: Array
    """Position at the log's first sample: angle (1,) or attitude (4,)."""


@dataclass(frozen=True)
class Law:
    """One torque that a model may lack."""

    name: str
    """The effect's canonical name (docs/design.md 4.4), or what it would be called there."""
    unit: str
    """SI, of the strength."""
    words: str
    """What it is, as it stands in a sentence; {} is the strength. Of a dissipative law: after "a
    torque against the motion of"."""
    shape: Callable[[Context], Array]
    """(m, k) [N m] at strength 1."""
    dissipative: bool = False
    """Whether only a positive strength makes sense."""
    offset: float = 0.0
    """What is added to the strength when it is printed."""


def _dry(at: Context) -> Array:
    rate = at.motion.rate
    return -rate / np.sqrt(np.sum(np.square(rate), axis=1, keepdims=True) + at.slow**2)


def _spring(at: Context) -> Array:
    if at.motion.position.shape[1] == 1:
        return at.first - at.motion.position
    turned = rotation.multiply(rotation.conjugate(at.first), at.motion.position)
    return -rotation.to_rotation_vector(turned)


def _swirl(at: Context) -> Array:
    if at.motion.position.shape[1] == 1:
        return np.ones_like(at.motion.rate)
    return rotation.vertical_body(at.motion.position)


def _gain(at: Context) -> Array:
    return np.zeros_like(at.motion.rate) if at.command is None else at.command


def _delay(at: Context) -> Array:
    if at.command is None or at.later is None:
        return np.zeros_like(at.motion.rate)
    return (at.later - at.command) / DELAY_STEP


LAWS = (
    Law(
        "bearing_coulomb_friction",
        "N m",
        "{} at every speed (dry friction)",
        _dry,
        dissipative=True,
    ),
    Law(
        "bearing_viscous_friction",
        "N m s",
        "{} times the rate (viscous friction)",
        lambda at: -at.motion.rate,
        dissipative=True,
    ),
    Law(
        "aerodynamic_drag",
        "N m s^2",
        "{} times the squared rate (drag of the air)",
        lambda at: -np.abs(at.motion.rate) * at.motion.rate,
        dissipative=True,
    ),
    Law(
        "harness_stiffness",
        "N m/rad",
        "a torque of {} back towards the first position (a cable or a spring)",
        _spring,
    ),
    Law("bearing_swirl_torque", "N m", "a constant torque of {}", _swirl),
    Law("torque_gain", "1", "a commanded torque of which {} arrives", _gain, offset=1.0),
    Law("command_delay", "s", "a commanded torque that acts {} after its stamp", _delay),
)


def shape_of(law: Law, predictor: Predictor) -> list[Array]:
    """(steps, k) torque of a law at strength 1, over the physics steps of each segment [N m]."""
    return [
        law.shape(context_over(predictor.inputs, predictor.motion, predictor.edges(segment)))
        for segment in range(len(predictor.segments))
    ]


def context_over(inputs: Inputs, motion: Motion, edges: Array) -> Context:
    """The context of a recording over the steps between these edges in time [s]."""
    rates = np.linalg.norm(motion.rate, axis=1)
    return Context(
        motion=motion.at(0.5 * (edges[1:] + edges[:-1])),
        command=inputs.torque_on_base(edges),
        later=inputs.torque_on_base(edges - DELAY_STEP),
        slow=max(STANDSTILL * float(np.quantile(rates, 0.95)), 1e-9),
        first=motion.position[0],
    )
