"""The departures that a log is asked for: each a few columns of the innovations, and a sentence."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from twin.compare import shapes
from twin.compare.shapes import on_base
from twin.predict.body import Body
from twin.predict.effects.perturbation import Perturbation
from twin.predict.sensors import faults


class Domain(Enum):
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
    domain: Domain
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


def symptoms_of(bodies: Sequence[Body]) -> tuple[Symptom, ...]:
    """Those that the streams of these logs can show."""
    body = bodies[0]
    ball = body.machine.platform.base.kind == "ball"
    found = [*_dissipative(), *_steady(bodies, ball=ball), *_inside(body)]
    for output in body.outputs:
        found += _of_sensor(output.stream, output.columns, output.unit, body)
    return tuple(found)


def _torque(
    name: str, looks: str, words: str, unit: str, *laws: shapes.Shape, dissipative: bool = False
) -> Symptom:
    return Symptom(
        name,
        Domain.torque,
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
            on_base(shapes.dry),
            dissipative=True,
        ),
        _torque(
            "bearing_viscous_friction",
            "a torque against the motion that grows with the rate (viscous friction)",
            "{} times the rate (viscous friction)",
            "N m s",
            on_base(shapes.viscous),
            dissipative=True,
        ),
        _torque(
            "aerodynamic_drag",
            "a torque against the motion that grows with the squared rate (drag of the air)",
            "{} times the squared rate (drag of the air)",
            "N m s^2",
            on_base(shapes.drag),
            dissipative=True,
        ),
    ]


def _steady(bodies: Sequence[Body], *, ball: bool) -> list[Symptom]:
    found = [
        _torque(
            "harness_stiffness",
            "a torque back towards the first position (a cable or a spring)",
            "a torque of {} back towards the first position (a cable or a spring)",
            "N m/rad",
            on_base(shapes.cable),
        ),
        _torque(
            "bearing_swirl_torque",
            "a constant torque about the vertical (a turbine in the air film)"
            if ball
            else "a constant torque",
            "a constant torque of {} about the vertical" if ball else "a constant torque of {}",
            "N m",
            on_base(shapes.swirl),
        ),
    ]
    if not ball:
        return found
    found.append(
        _torque(
            "body_fixed_torque",
            "a torque that turns with the body (a leaking jet)",
            "a torque of {} fixed in the body (a leaking jet)",
            "N m",
            *(on_base(shapes.fixed(axis)) for axis in range(3)),
        )
    )
    found.append(
        _torque(
            "center_of_mass_drift",
            "a gravity torque that grows with time (the centre of mass moves)",
            "a mass moment that drifts by {}",
            "kg m/s",
            *(on_base(shapes.drifting_mass(axis)) for axis in range(3)),
        )
    )
    if all(np.any(body.inputs.field_world) for body in bodies):
        found.append(
            _torque(
                "residual_dipole",
                "a torque across the magnetic field (a dipole of the body)",
                "a dipole of {}",
                "A m^2",
                *(on_base(shapes.dipole(axis)) for axis in range(3)),
            )
        )
    return found


def _inside(body: Body) -> list[Symptom]:
    """Between command and torque, or between body and wheels."""
    platform = body.machine.platform
    hinge = platform.base.kind == "hinge"
    driven = 1 if hinge else len(platform.wheels)
    if not np.any(body.commanded()):
        return []

    def inside(
        name: str,
        looks: str,
        words: str,
        unit: str,
        laws: list[shapes.Shape],
        *,
        dissipative: bool = False,
        offset: float = 0.0,
    ) -> Symptom:
        own = tuple(Perturbation(name, unit, force=law) for law in laws)
        return Symptom(
            name, Domain.exchange, looks, words, unit, own, dissipative=dissipative, offset=offset
        )

    found = [
        inside(
            "torque_gain" if hinge else "wheel_torque_gain",
            "a commanded torque of which another share arrives",
            "a commanded torque of which {} arrives",
            "1",
            [shapes.command_gain(index) for index in range(driven)],
            offset=1.0,
        ),
        inside(
            "command_delay",
            "a commanded torque that acts after its stamp",
            "a commanded torque that acts {} after its stamp",
            "s",
            [shapes.command_delay],
        ),
    ]
    if not hinge:
        found += [
            inside(
                "wheel_viscous_friction",
                "a torque between wheel and body that grows with the wheel's speed",
                "wheels braked by {} times their speed",
                "N m s",
                [shapes.wheel_friction(index, dry=False) for index in range(driven)],
                dissipative=True,
            ),
            inside(
                "wheel_coulomb_friction",
                "a torque between wheel and body against the wheel's spin",
                "wheels braked by {} at every speed",
                "N m",
                [shapes.wheel_friction(index, dry=True) for index in range(driven)],
                dissipative=True,
            ),
            inside(
                "wheel_misalignment",
                "wheels turned in their mounts",
                "wheels turned in their mounts by {}",
                "rad",
                [
                    shapes.wheel_misalignment(index, across)
                    for index in range(driven)
                    for across in range(2)
                ],
            ),
        ]
    return found


def _of_sensor(stream: str, columns: Sequence[str], unit: str, body: Body) -> list[Symptom]:
    found: list[Symptom] = []

    def fault(
        kind: str,
        looks: str,
        words: str,
        unit: str,
        make: Callable[[int], Perturbation],
        domain: Domain = Domain.sensor,
        count: int = len(columns),
    ) -> None:
        perturbations = tuple(make(index) for index in range(count))
        name = f"{kind}:{stream}" if domain is Domain.clock else f"{stream}_{kind}"
        found.append(Symptom(name, domain, looks, words, unit, perturbations))

    stated = {o.stream: o.bias for o in body.outputs}[stream]
    rate = stream in ("gyro", "joint_rate")
    if rate and not np.any(stated > 0.0):
        fault(
            "bias",
            f"a constant error of {stream}",
            f"{stream} off by {{}}",
            unit,
            lambda i: faults.bias(stream, i, unit),
        )
    if rate:
        fault(
            "drift",
            f"an error of {stream} that grows with time",
            f"{stream} drifting by {{}}",
            f"{unit}/s",
            lambda i: faults.drift(stream, i, unit),
        )
    if stream != "attitude" and (len(body.outputs) > 1 or _inside(body)):
        fault(
            "scale_factor",
            f"another scale of {stream}",
            f"{stream} scaled by {{}} too much",
            "1",
            lambda i: faults.scale_factor(stream, i),
        )
    if stream == "gyro":
        fault(
            "misalignment",
            "a gyro turned in its mount",
            "a gyro turned by {} in its mount",
            "rad",
            lambda i: faults.misalignment(stream, i),
        )
    if stream == "attitude":
        fault(
            "misalignment",
            "an attitude sensor turned in its mount",
            "an attitude sensor turned by {} in its mount",
            "rad",
            lambda i: faults.bias(stream, i, unit),
        )
    if len(body.outputs) == 1 and not any(name.startswith("command") for name in body.recording):
        # nothing to be late against: another start of the motion is as good
        return found
    fault(
        "clock_lag",
        f"{stream} late against the others",
        f"{stream} late by {{}}",
        "s",
        lambda _: faults.clock_lag(stream),
        Domain.clock,
        1,
    )
    fault(
        "clock_drift",
        f"a clock of {stream} that runs at another rate",
        f"a clock of {stream} that runs fast by {{}}",
        "s/s",
        lambda _: faults.clock_drift(stream),
        Domain.clock,
        1,
    )
    return found
