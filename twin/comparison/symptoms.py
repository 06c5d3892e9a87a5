"""Symptoms: possible departures from a model, as columns along its predicted motion."""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.predict.body import Body
from twin.predict.forces import Perturbation
from twin.predict.logs import Motion
from twin.predict.sensors import Output

Array = NDArray[np.float64]
Shape = Callable[[Body], Array]
DELAY_STEP = 0.01
"""Lag [s] of the difference that stands for a command's derivative."""
LATEST = 0.1
"""Share of a log by which a clock or a command may be late: over more of it, another motion is as
likely."""
SMALLEST_SCALE = -0.9
LARGEST_SCALE = 9.0
"""Errors of a scale beyond are of a sign or a unit."""
CLOCKS_RATE = 0.5
"""By which a clock may run fast or slow."""
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


ALONG_FLOOR = (1.0, 1.0, 0.0)
ABOUT_VERTICAL = (0.0, 0.0, 1.0)


def masked(
    law: Callable[[Body, Motion], Array], mask: tuple[float, float, float]
) -> Callable[[Body, Motion], Array]:
    """The law with only those rates of the base that a mask of ones and zeros keeps."""

    def masked_law(body: Body, at: Motion) -> Array:
        other = copy(body)
        other.motion = replace(body.motion, rate=body.motion.rate * mask)
        return law(other, replace(at, rate=at.rate * mask))

    return masked_law


def command_whole(body: Body) -> Array:
    """All that was commanded once more."""
    return body.commanded()


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


def bias(stream: str, column: int, unit: str) -> Perturbation:
    """A constant error of one column; of an attitude, a turn about a body axis."""
    return Perturbation(
        f"{stream}_bias", unit, stream=stream, shown=lambda output, _: _only(output, column)
    )


def drift(stream: str, column: int, unit: str) -> Perturbation:
    """An error of one column that grows with time, 0 at the log's first instant."""

    def shown(output: Output, _: Array) -> Array:
        return _only(output, column) * (output.time - output.time[0])[:, None]

    return Perturbation(f"{stream}_drift", f"{unit}/s", stream=stream, shown=shown)


def scale_factor(stream: str, column: int) -> Perturbation:
    """One column shows (1 + strength) of the truth."""

    def shown(output: Output, truth: Array) -> Array:
        return truth * _only(output, column)

    return Perturbation(f"{stream}_scale_factor", "1", stream=stream, shown=shown)


def misalignment(stream: str, axis: int) -> Perturbation:
    """A vector's sensor is turned about a body axis: it shows R(strength)^T of the truth."""
    unit = np.eye(3)[axis]

    def shown(_: Output, truth: Array) -> Array:
        return rotation.cross(truth, unit)

    return Perturbation(f"{stream}_misalignment", "rad", stream=stream, shown=shown)


def clock_lag(stream: str) -> Perturbation:
    """A value stamped t was true at t - strength."""
    return Perturbation(
        "clock_lag", "s", stream=stream, late=lambda output: np.ones(len(output.time))
    )


def clock_drift(stream: str) -> Perturbation:
    """A value true at t, counted from the log's first instant, is stamped t (1 + strength)."""
    return Perturbation(
        "clock_drift", "s/s", stream=stream, late=lambda output: output.time - output.time[0]
    )


def _only(output: Output, column: int) -> Array:
    """(1, m, k) of ones in a column."""
    shown = np.zeros((1, *output.slot.shape))
    shown[..., column] = 1.0
    return shown


class SymptomDomain(Enum):
    """Where a departure lives."""

    torque = "an external torque"
    """It changes the machine's angular momentum, or its energy."""
    exchange = "an exchange inside"
    """It moves momentum between the machine's own parts, or stands between command and torque."""
    sensor = "a sensor"
    clock = "a clock"


@dataclass(frozen=True)
class Symptom:
    """One departure; a vector has a perturbation for each of its components."""

    name: str
    """The effect's canonical name (docs/design.md 4.4), or what it would be called there."""
    domain: SymptomDomain
    looks: str
    """What it looks like, in a sentence: "a torque against the rate (viscous friction)"."""
    words: str
    """The same with its size: {} is the strength."""
    unit: str
    """SI, of the strengths."""
    perturbations: tuple[Perturbation, ...]
    dissipative: bool = False
    """Whether only positive strengths make sense."""
    offset: float = 0.0
    """What is added to a strength when it is printed."""
    of_scale: bool = False
    """Whether a base that is fitted takes it: mass, J and m r have its factor in common."""
    parts: tuple[str, ...] = ()
    """Of a vector over wheels, which each component is of: "for w1"."""
    low: float = -np.inf
    """Strengths below are no such departure: a scale of -200 % is a sign, and belongs to the
    conventions that a log is read in."""
    high: float = np.inf

    def is_possible(self, strengths: Array) -> bool:
        """Whether strengths (k,) are such a departure's."""
        if self.dissipative and bool(np.all(strengths < 0.0)):
            return False
        return bool(np.all((strengths >= self.low) & (strengths <= self.high)))


def symptoms_of(bodies: Sequence[Body]) -> tuple[Symptom, ...]:
    """Those that the streams of these logs can show."""
    body = bodies[0]
    kind = body.machine.platform.base.kind
    on_base = _on_floor() if kind == "planar" else []
    if not on_base:
        on_base = [*_dissipative(), *_steady(bodies, ball=kind == "ball")]
    result = [*on_base, *_inside(body)]
    for output in body.outputs:
        result += _of_sensor(output.stream, output.columns, output.unit, body)
    return tuple(result)


def _torque(
    name: str, looks: str, words: str, unit: str, *laws: Shape, dissipative: bool = False
) -> Symptom:
    return Symptom(
        name,
        SymptomDomain.torque,
        looks,
        words,
        unit,
        tuple(Perturbation(name, unit, force=law) for law in laws),
        dissipative,
    )


def _dissipative() -> list[Symptom]:
    return [
        _torque(
            "bearing_coulomb_friction",
            "a torque against the motion that does not depend on the rate (dry friction)",
            "{} at every speed (dry friction)",
            "N m",
            on_base(dry),
            dissipative=True,
        ),
        _torque(
            "bearing_viscous_friction",
            "a torque against the motion that grows with the rate (viscous friction)",
            "{} times the rate (viscous friction)",
            "N m s",
            on_base(viscous),
            dissipative=True,
        ),
        _torque(
            "aerodynamic_drag",
            "a torque against the motion that grows with the squared rate (drag of the air)",
            "{} times the squared rate (drag of the air)",
            "N m s^2",
            on_base(drag),
            dissipative=True,
        ),
    ]


def _on_floor() -> list[Symptom]:
    return [
        _torque(
            "pad_coulomb_friction",
            "a force against the motion that does not depend on the speed (pads that touch)",
            "{} at every speed (pads that touch)",
            "N",
            on_base(masked(dry, ALONG_FLOOR)),
            dissipative=True,
        ),
        _torque(
            "pad_coulomb_friction about the vertical",
            "a torque against the turn that does not depend on the rate (pads that touch)",
            "{} at every rate of turn (pads that touch)",
            "N m",
            on_base(masked(dry, ABOUT_VERTICAL)),
            dissipative=True,
        ),
        _torque(
            "pad_viscous_friction",
            "a force that grows with the speed (drag of the pads)",
            "{} times the speed (drag of the pads)",
            "N s/m",
            on_base(masked(viscous, ALONG_FLOOR)),
        ),
        _torque(
            "pad_viscous_friction about the vertical",
            "a torque that grows with the rate of turn (drag of the pads)",
            "{} times the rate of turn (drag of the pads)",
            "N m s",
            on_base(masked(viscous, ABOUT_VERTICAL)),
        ),
        _torque(
            "floor_slope",
            "a constant force in the room (a floor out of level)",
            "a constant force of {} along x and y (a floor out of level)",
            "N",
            on_base(fixed(0)),
            on_base(fixed(1)),
        ),
    ]


def _steady(bodies: Sequence[Body], *, ball: bool) -> list[Symptom]:
    result = [
        _torque(
            "harness_stiffness",
            "a torque back towards the first position (a cable or a spring)",
            "a torque of {} back towards the first position (a cable or a spring)",
            "N m/rad",
            on_base(cable),
        ),
        _torque(
            "bearing_swirl_torque",
            "a constant torque about the vertical (a turbine in the air film)"
            if ball
            else "a constant torque",
            "a constant torque of {} about the vertical" if ball else "a constant torque of {}",
            "N m",
            on_base(swirl),
        ),
    ]
    if not ball:
        return result
    result.append(
        _torque(
            "body_fixed_torque",
            "a torque that turns with the body (a leaking jet)",
            "a torque of {} fixed in the body (a leaking jet)",
            "N m",
            *(on_base(fixed(axis)) for axis in range(3)),
        )
    )
    result.append(
        _torque(
            "center_of_mass_drift",
            "a gravity torque that grows with time (the centre of mass moves)",
            "a mass moment that drifts by {}",
            "kg m/s",
            *(on_base(drifting_mass(axis)) for axis in range(3)),
        )
    )
    if all(np.any(body.inputs.field_world) for body in bodies):
        result.append(
            _torque(
                "residual_dipole",
                "a torque across the magnetic field (a dipole of the body)",
                "a dipole of {}",
                "A m^2",
                *(on_base(dipole(axis)) for axis in range(3)),
            )
        )
    return result


def _inside(body: Body) -> list[Symptom]:
    """Between command and torque, or between body and wheels."""
    platform = body.machine.platform
    hinge, planar = platform.base.kind == "hinge", platform.base.kind == "planar"
    driven = 1 if hinge else len(platform.wheels)
    if not np.any(body.commanded()):
        return []

    def inside(
        name: str,
        looks: str,
        words: str,
        unit: str,
        laws: list[Shape],
        *,
        dissipative: bool = False,
        offset: float = 0.0,
        of_scale: bool = False,
        across: bool = False,
        high: float = np.inf,
    ) -> Symptom:
        own = tuple(Perturbation(name, unit, force=law) for law in laws)
        parts = tuple(f"for {wheel.name}" for wheel in platform.wheels)
        if across:
            parts = tuple(f"{part} {way}" for part in parts for way in ("one way", "the other"))
        return Symptom(
            name,
            SymptomDomain.exchange,
            looks,
            words,
            unit,
            own,
            dissipative=dissipative,
            offset=offset,
            of_scale=of_scale,
            low=-high,
            high=high,
            parts=parts if 1 < len(laws) == len(parts) else (),
        )

    result = [
        inside(
            "torque_gain" if hinge else "thruster_gain" if planar else "wheel_torque_gain",
            f"a commanded {'force' if planar else 'torque'} of which another share arrives",
            f"a commanded {'force' if planar else 'torque'} of which {{}} arrives",
            "1",
            [command_whole] if planar else [command_gain(index) for index in range(driven)],
            offset=1.0,
            of_scale=planar and platform.mass_sd is None,
        ),
        inside(
            "command_delay",
            "a commanded torque that acts after its stamp",
            "a commanded torque that acts {} after its stamp",
            "s",
            [command_delay],
            high=_latest(body),
        ),
    ]
    if not (hinge or planar):
        result += [
            inside(
                "wheel_viscous_friction",
                "a torque between wheel and body that grows with the wheel's speed",
                "wheels braked by {} times their speed",
                "N m s",
                [wheel_friction(index, dry=False) for index in range(driven)],
                dissipative=True,
            ),
            inside(
                "wheel_coulomb_friction",
                "a torque between wheel and body against the wheel's spin",
                "wheels braked by {} at every speed",
                "N m",
                [wheel_friction(index, dry=True) for index in range(driven)],
                dissipative=True,
            ),
            inside(
                "wheel_misalignment",
                "wheels turned in their mounts",
                "wheels turned in their mounts by {}",
                "rad",
                [
                    wheel_misalignment(index, across)
                    for index in range(driven)
                    for across in range(2)
                ],
                across=True,
            ),
        ]
    return result


def _of_sensor(stream: str, columns: Sequence[str], unit: str, body: Body) -> list[Symptom]:
    symptoms: list[Symptom] = []

    def fault(
        kind: str,
        looks: str,
        words: str,
        unit: str,
        make: Callable[[int], Perturbation],
        domain: SymptomDomain = SymptomDomain.sensor,
        count: int = len(columns),
        low: float = -np.inf,
        high: float = np.inf,
    ) -> None:
        perturbations = tuple(make(index) for index in range(count))
        name = f"{kind}:{stream}" if domain is SymptomDomain.clock else f"{stream}_{kind}"
        symptoms.append(
            Symptom(name, domain, looks, words, unit, perturbations, low=low, high=high)
        )

    stated = {o.stream: o.bias for o in body.outputs}[stream]
    rate = stream in ("gyro", "joint_rate")
    if rate and not np.any(stated > 0.0):
        fault(
            "bias",
            f"a constant error of {stream}",
            f"{stream} off by {{}}",
            unit,
            lambda i: bias(stream, i, unit),
        )
    if rate:
        fault(
            "drift",
            f"an error of {stream} that grows with time",
            f"{stream} drifting by {{}}",
            f"{unit}/s",
            lambda i: drift(stream, i, unit),
        )
    if stream != "attitude" and (len(body.outputs) > 1 or _inside(body)):
        fault(
            "scale_factor",
            f"another scale of {stream}",
            f"{stream} scaled by {{}} too much",
            "1",
            lambda i: scale_factor(stream, i),
            low=SMALLEST_SCALE,
            high=LARGEST_SCALE,
        )
    if stream == "gyro":
        fault(
            "misalignment",
            "a gyro turned in its mount",
            "a gyro turned by {} in its mount",
            "rad",
            lambda i: misalignment(stream, i),
        )
    if stream == "attitude":
        fault(
            "misalignment",
            "an attitude sensor turned in its mount",
            "an attitude sensor turned by {} in its mount",
            "rad",
            lambda i: bias(stream, i, unit),
        )
    if len(body.outputs) == 1 and not any(name.startswith("command") for name in body.recording):
        # nothing to be late against: another start of the motion is as good
        return symptoms
    fault(
        "clock_lag",
        f"{stream} late against the others",
        f"{stream} late by {{}}",
        "s",
        lambda _: clock_lag(stream),
        SymptomDomain.clock,
        1,
        -_latest(body),
        _latest(body),
    )
    fault(
        "clock_drift",
        f"a clock of {stream} that runs at another rate",
        f"a clock of {stream} that runs fast by {{}}",
        "s/s",
        lambda _: clock_drift(stream),
        SymptomDomain.clock,
        1,
        -CLOCKS_RATE,
        CLOCKS_RATE,
    )
    return symptoms


def _latest(body: Body) -> float:
    """By which a clock or a command may be late [s]."""
    return LATEST * float(body.motion.time[-1] - body.motion.time[0])
