"""Read the base and the parts of a machine out of platform.toml, with what its MJCF says of them.

Axes, and what carries what, are the MJCF's; limits and inertias are platform.toml's.
"""

from dataclasses import dataclass

import numpy as np

from twin.config import Table
from twin.errors import UnknownName
from twin.platform.mjcf import Layout
from twin.platform.parts import (
    Array,
    Base,
    Gas,
    Gimbal,
    Magnetorquer,
    Rotor,
    Stage,
    Thruster,
    Wheel,
)
from twin.rotation import from_rotation_vector, rotate

_ARRAYS = ("wheels", "stages", "rotors", "gimbals", "magnetorquers", "thrusters")


@dataclass(frozen=True)
class Parts:
    """All that a machine carries."""

    wheels: tuple[Wheel, ...]
    stages: tuple[Stage, ...]
    rotors: tuple[Rotor, ...]
    gimbals: tuple[Gimbal, ...]
    magnetorquers: tuple[Magnetorquer, ...]
    thrusters: tuple[Thruster, ...]
    gas: Gas | None


def read_base(table: Table, layout: Layout) -> Base:
    """The table [base]."""
    kind = table.text("kind", among=("ball", "hinge", "free"))
    base = Base(
        kind="ball" if kind == "ball" else "hinge" if kind == "hinge" else "free",
        joint=table.text("joint"),
        body=table.text("body"),
        actuator=table.text("actuator", None),
        torque_limit=table.number("torque_limit", np.inf, low=0.0, unit="N m", infinite=True),
        planar=table.texts("planar", ()),
        locked=table.texts("locked", ()),
    )
    if base.joint not in layout.axes:
        raise _missing(table, "joint", base.joint, list(layout.axes), key="joint")
    if base.kind != "hinge" and base.actuator is not None:
        raise table.fail(
            "actuator",
            f"is {base.actuator!r} on a {kind} joint",
            "only a hinge has a motor: remove it",
        )
    if np.isfinite(base.torque_limit) and base.actuator is None:
        raise table.fail("torque_limit", "is that of no motor", "name its `actuator`, or remove it")
    if base.planar and (base.kind != "ball" or len(base.planar) != 3):
        raise table.fail(
            "planar",
            f"is {list(base.planar)}",
            "name the joints of a stage below a ball: slide along x, slide along y, heading",
        )
    for name in base.locked:
        if name not in (base.joint, *base.planar) or base.kind != "ball":
            raise table.fail(
                "locked", f"names {name!r}", "it can hold the ball's joint and those of `planar`"
            )
    table.close()
    return base


def read_parts(table: Table, layout: Layout, base: Base) -> Parts:
    """The arrays of tables [[wheels]] and so on, and [gas]."""
    names: list[str] = []
    for key in _ARRAYS:
        for row in table.tables(key):
            names.append(row.text("name"))
            if names.count(names[-1]) > 1:
                raise row.fail(
                    "name",
                    f"is {names[-1]!r}, which another part has",
                    "give each part its own name",
                )
    gimbals = [row.text("name") for row in table.tables("gimbals")]
    rotors = tuple(_rotor(row, layout, gimbals) for row in table.tables("rotors"))
    wheels = tuple(_wheel(row, layout, gimbals) for row in table.tables("wheels"))
    spin = {part.gimbal: part.axis for part in (*wheels, *rotors) if part.gimbal is not None}
    return Parts(
        wheels=wheels,
        stages=tuple(_stage(row, layout) for row in table.tables("stages")),
        rotors=rotors,
        gimbals=tuple(_gimbal(row, layout, spin) for row in table.tables("gimbals")),
        magnetorquers=tuple(
            _magnetorquer(row, layout, base) for row in table.tables("magnetorquers")
        ),
        thrusters=tuple(_thruster(row, layout, base) for row in table.tables("thrusters")),
        gas=_gas(table.table("gas")) if "gas" in table else None,
    )


def _wheel(table: Table, layout: Layout, gimbals: list[str]) -> Wheel:
    wheel = Wheel(
        name=table.text("name"),
        axis=_axis(table, layout),
        gimbal=_gimbal_of(table, layout, gimbals),
        inertia=table.number("inertia", low=1e-12, unit="kg m^2"),
        momentum_limit=table.number("momentum_limit", low=1e-9, unit="N m s", infinite=True),
        torque_limit=table.number("torque_limit", low=0.0, unit="N m", infinite=True),
        home=table.number("home", 0.0, unit="rad/s"),
    )
    if abs(wheel.home) > wheel.speed_limit:
        raise table.fail(
            "home",
            f"is {wheel.home:g} rad/s, beyond the {wheel.speed_limit:g} rad/s of momentum_limit",
            "start it within its limit",
        )
    table.close()
    return wheel


def _rotor(table: Table, layout: Layout, gimbals: list[str]) -> Rotor:
    rotor = Rotor(
        name=table.text("name"),
        axis=_axis(table, layout),
        gimbal=_gimbal_of(table, layout, gimbals),
        inertia=table.number("inertia", low=1e-12, unit="kg m^2"),
        speed=table.number("speed", unit="rad/s"),
    )
    table.close()
    return rotor


def _gimbal(table: Table, layout: Layout, spin: dict[str, Array]) -> Gimbal:
    name, axis = table.text("name"), _axis(table, layout)
    skew = table.number("skew", 0.0, low=-np.pi, high=np.pi, unit="rad")
    if name not in spin:
        raise table.fail(
            "name",
            f"is {name!r}, on which no wheel and no rotor turns",
            "hang one on that joint in the MJCF and state it in [[wheels]] or [[rotors]]",
        )
    if abs(axis @ spin[name]) > 1e-9:
        raise table.fail(
            "name",
            f"is {name!r}, whose axis in the MJCF is not perpendicular to the one it carries",
            "turn one of the two joints",
        )
    gimbal = Gimbal(
        name=name,
        axis=rotate(from_rotation_vector(skew * spin[name]), axis),
        rate=table.number("rate", low=1e-9, unit="rad/s"),
        acceleration=table.number("acceleration", low=1e-9, unit="rad/s^2"),
        home=table.number("home", 0.0, unit="rad"),
        skew=skew,
    )
    table.close()
    return gimbal


def _stage(table: Table, layout: Layout) -> Stage:
    low, high = table.numbers("travel", 2, unit="m")
    if low >= high:
        raise table.fail("travel", f"runs from {low:g} to {high:g} m", "give the lower end first")
    stage = Stage(
        name=table.text("name"),
        axis=_axis(table, layout),
        mass=table.number("mass", low=1e-9, unit="kg"),
        travel=(float(low), float(high)),
        speed=table.number("speed", low=1e-9, unit="m/s"),
        acceleration=table.number("acceleration", low=1e-9, unit="m/s^2"),
        resolution=table.number("resolution", 0.0, low=0.0, unit="m"),
        response=table.number("response", 0.0, low=0.0, high=10.0, unit="s"),
    )
    if stage.resolution > high - low:
        raise table.fail(
            "resolution",
            f"is {stage.resolution:g} m, more than the {high - low:g} m of its travel",
            "give the step of its drive in m, or 0 where it is continuous",
        )
    table.close()
    return stage


def _magnetorquer(table: Table, layout: Layout, base: Base) -> Magnetorquer:
    away = _pushed_site(table, layout, base)
    distance = float(np.linalg.norm(away))
    if distance < 1e-3:
        raise table.fail("name", "has its site at the centre of rotation", "set it off the CR")
    torquer = Magnetorquer(
        name=table.text("name"),
        dipole_limit=table.number("dipole_limit", low=0.0, unit="A m^2", infinite=True),
        axis=away / distance,
    )
    table.close()
    return torquer


def _thruster(table: Table, layout: Layout, base: Base) -> Thruster:
    point = _pushed_site(table, layout, base)
    push = layout.pushes[table.text("name")]
    if abs(np.linalg.norm(push) - 1.0) > 1e-9:
        raise table.fail(
            "name",
            f"is {table.text('name')!r}, with gear {push.round(6).tolist()} in the MJCF",
            "make it a unit vector along the force on the body, so that its control is in N",
        )
    thruster = Thruster(
        name=table.text("name"),
        force_limit=table.number("force_limit", low=0.0, unit="N", infinite=True),
        point=point,
        direction=push,
    )
    table.close()
    return thruster


def _gas(table: Table) -> Gas:
    gas = Gas(
        mass=table.number("mass", low=1e-9, unit="kg"),
        pressure=table.number("pressure", low=1.0, unit="Pa"),
        specific_impulse=table.number("specific_impulse", low=1e-3, unit="s"),
    )
    table.close()
    return gas


def _axis(table: Table, layout: Layout) -> Array:
    name = table.text("name")
    if name not in layout.axes:
        raise _missing(table, "joint", name, list(layout.axes))
    return layout.axes[name]


def _gimbal_of(table: Table, layout: Layout, gimbals: list[str]) -> str | None:
    """The gimbal whose joint is the first above the one of the table."""
    above = layout.carriers[table.text("name")][:1]
    return above[0] if above and above[0] in gimbals else None


def _pushed_site(table: Table, layout: Layout, base: Base) -> Array:
    """(3,) from the CR to the site of that name, on which an actuator of that name acts [m]."""
    name = table.text("name")
    if name not in layout.sites:
        raise _missing(table, "site", name, list(layout.sites))
    if name not in layout.pushes:
        raise table.fail(
            "name",
            f"is {name!r}, on whose site no actuator {name!r} of the MJCF acts",
            f'add <general name="{name}" site="{name}" .../>',
        )
    return layout.sites[name] - layout.anchors[base.joint]


def _missing(table: Table, noun: str, name: str, known: list[str], key: str = "name") -> Exception:
    hint = UnknownName(noun, name, known).hint
    return table.fail(key, f"is {name!r}, which is no {noun} of the MJCF", hint)
