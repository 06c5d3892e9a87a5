"""Read platform.toml into a `Platform`.

Read the base and the parts of a machine out of platform.toml, with what its MJCF says of them.
Axes, and what carries what, are the MJCF's; limits and inertias are platform.toml's.

docs/platforms.md has the keys, their units and defaults; every key that is not known is an error
with its line. A variant ([variants.NAME]) replaces the keys it gives.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from twin.config import Table, read_toml
from twin.errors import PlatformError, UnknownName
from twin.library import find_model
from twin.platform.mjcf import MjcfLayout, read_layout
from twin.platform.parts import (
    Array,
    Base,
    Gas,
    Gimbal,
    GimbalDrive,
    Magnetorquer,
    PitchStop,
    Platform,
    Rotor,
    Sensor,
    Stage,
    StatedEffect,
    Tank,
    Thruster,
    Wheel,
)
from twin.recording.environment import read_earth_rate, read_field, read_gravity
from twin.rotation import from_rotation_vector, rotate
from twin.signals import stream_named

CALIBRATION = "calibration.toml"
"""Of a platform's folder: effects that `twin calibrate` measured, beside those of platform.toml."""
_ARRAYS = ("wheels", "stages", "rotors", "gimbals", "magnetorquers", "thrusters")


@dataclass(frozen=True)
class CarriedParts:
    """All that a machine carries."""

    wheels: tuple[Wheel, ...]
    stages: tuple[Stage, ...]
    rotors: tuple[Rotor, ...]
    gimbals: tuple[Gimbal, ...]
    magnetorquers: tuple[Magnetorquer, ...]
    thrusters: tuple[Thruster, ...]
    gas: Gas | None


def read_base(table: Table, layout: MjcfLayout) -> Base:
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


def read_parts(table: Table, layout: MjcfLayout, base: Base) -> CarriedParts:
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
    return CarriedParts(
        wheels=wheels,
        stages=tuple(_stage(row, layout) for row in table.tables("stages")),
        rotors=rotors,
        gimbals=_gimbals(table.tables("gimbals"), layout, spin),
        magnetorquers=tuple(
            _magnetorquer(row, layout, base) for row in table.tables("magnetorquers")
        ),
        thrusters=tuple(_thruster(row, layout, base) for row in table.tables("thrusters")),
        gas=_gas(table.table("gas")) if "gas" in table else None,
    )


def _wheel(table: Table, layout: MjcfLayout, gimbals: list[str]) -> Wheel:
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


def _rotor(table: Table, layout: MjcfLayout, gimbals: list[str]) -> Rotor:
    rotor = Rotor(
        name=table.text("name"),
        axis=_axis(table, layout),
        gimbal=_gimbal_of(table, layout, gimbals),
        inertia=table.number("inertia", low=1e-12, unit="kg m^2"),
        speed=table.number("speed", unit="rad/s"),
    )
    table.close()
    return rotor


def _gimbals(
    rows: Sequence[Table], layout: MjcfLayout, spin: dict[str, Array]
) -> tuple[Gimbal, ...]:
    gimbals = tuple(_gimbal(row, layout, spin) for row in rows)
    for row, gimbal in zip(rows, gimbals, strict=True):
        if gimbals[0].drive is None or gimbal.drive is None:
            if gimbal.drive is not gimbals[0].drive:
                problem, remedy = "is stated of some gimbals", "state one of each, or none"
                raise row.fail("name", f"is {gimbal.name!r}; a drive {problem}", remedy)
        elif gimbal.drive.rate != gimbals[0].drive.rate:
            raise row.fail(
                "name",
                f"is {gimbal.name!r}, whose drive runs at {gimbal.drive.rate:g} Hz and that of "
                f"{gimbals[0].name!r} at {gimbals[0].drive.rate:g} Hz",
                "give all drives one rate",
            )
    return gimbals


def _gimbal(table: Table, layout: MjcfLayout, spin: dict[str, Array]) -> Gimbal:
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
        drive=_drive(table.table("drive")) if "drive" in table else None,
    )
    table.close()
    return gimbal


def _drive(table: Table) -> GimbalDrive:
    friction = table.number("friction", 0.0, low=0.0, unit="N m")
    drive = GimbalDrive(
        inertia=table.number("inertia", low=1e-12, unit="kg m^2"),
        proportional=table.number("proportional", low=0.0, unit="N m s/rad"),
        integral=table.number("integral", 0.0, low=0.0, unit="N m/rad"),
        rate=table.number("rate", 1000.0, low=1.0, unit="Hz"),
        torque_constant=table.number("torque_constant", 1.0, low=1e-9, unit="N m/A"),
        current_limit=table.number("current_limit", np.inf, low=0.0, unit="A", infinite=True),
        voltage=table.number("voltage", np.inf, low=0.0, unit="V", infinite=True),
        resistance=table.number("resistance", 1.0, low=1e-9, unit="ohm"),
        friction=friction,
        static_friction=max(table.number("static_friction", 0.0, low=0.0, unit="N m"), friction),
        encoder=table.number("encoder", 0.0, low=0.0, unit="rad"),
    )
    table.close()
    return drive


def _stage(table: Table, layout: MjcfLayout) -> Stage:
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


def _magnetorquer(table: Table, layout: MjcfLayout, base: Base) -> Magnetorquer:
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


def _thruster(table: Table, layout: MjcfLayout, base: Base) -> Thruster:
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
        delay=table.number("delay", 0.0, low=0.0, high=1.0, unit="s"),
        on_off=table.text("valve", "pulsed", among=("pulsed", "on-off")) == "on-off",
    )
    if thruster.on_off and np.isinf(thruster.force_limit):
        raise table.fail("valve", "has no force while it is open", "give its `force_limit`")
    table.close()
    return thruster


def _gas(table: Table) -> Gas:
    gas = Gas(
        mass=table.number("mass", low=1e-9, unit="kg"),
        pressure=table.number("pressure", low=1.0, unit="Pa"),
        specific_impulse=table.number("specific_impulse", low=1e-3, unit="s"),
        tanks=tuple(_tank(row) for row in table.tables("tanks")),
    )
    table.close()
    return gas


def _tank(table: Table) -> Tank:
    tank = Tank(
        place=table.numbers("place", 3, unit="m"),
        volume=table.number("volume", 1.0, low=1e-9),
    )
    table.close()
    return tank


def _axis(table: Table, layout: MjcfLayout) -> Array:
    name = table.text("name")
    if name not in layout.axes:
        raise _missing(table, "joint", name, list(layout.axes))
    return layout.axes[name]


def _gimbal_of(table: Table, layout: MjcfLayout, gimbals: list[str]) -> str | None:
    """The gimbal whose joint is the first above the one of the table."""
    above = layout.carriers[table.text("name")][:1]
    return above[0] if above and above[0] in gimbals else None


def _pushed_site(table: Table, layout: MjcfLayout, base: Base) -> Array:
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


MEASURED = (
    "gyro",
    "attitude",
    "inclinometer",
    "accelerometer",
    "magnetometer",
    "position",
    "velocity",
    "wheel_speed",
    "gimbal_angle",
    "gimbal_rate",
    "stage_position",
    "joint_angle",
    "joint_rate",
    "gas_pressure",
)
"""Streams that the simulated plant can measure."""

_AT_SITE = ("inclinometer", "accelerometer")


def read_sensor(
    sensors: Table,
    stream: str,
    parts: CarriedParts,
    base: Base,
    layout: MjcfLayout,
    timing: tuple[float, float],
) -> Sensor:
    """The table [sensors.STREAM]; `timing` is the physics step [s] and the control rate [Hz]."""
    if stream not in MEASURED:
        raise sensors.fail(
            stream,
            "is no stream that the simulation measures",
            "use " + ", ".join(MEASURED),
        )
    table = sensors.table(stream)
    width = _width(stream, parts, base)
    if width == 0:
        raise sensors.fail(stream, "measures a part the machine does not have", "remove it")
    unit = "rad" if stream == "attitude" else stream_named(stream).unit
    none = np.zeros(width)
    step, control_rate = timing
    sensor = Sensor(
        stream=stream,
        rate=_rate(table, step, control_rate),
        noise=table.numbers("noise", width, low=0.0, unit=unit),
        bias=table.numbers("bias", width, none, low=0.0, unit=unit),
        resolution=table.number("resolution", 0.0, low=0.0, unit=unit),
        range=table.number("range", np.inf, low=1e-12, unit=unit, infinite=True),
        latency=table.number("latency", 0.0, low=0.0, high=1.0, unit="s"),
        dropout=table.number("dropout", 0.0, low=0.0, high=1.0),
        cutoff=table.number("cutoff", np.inf, low=1e-3, unit="Hz", infinite=True),
        order=_order(table),
        site=_site(table, stream, layout),
        window=_window(table, stream),
    )
    if np.isfinite(sensor.cutoff) and sensor.cutoff >= 0.5 / step:
        raise table.fail(
            "cutoff",
            f"is {sensor.cutoff:g} Hz, which steps of {step:g} s cannot show",
            f"keep it below {0.5 / step:g} Hz, or choose a smaller simulation.step",
        )
    if stream == "attitude":
        _check_attitude(table, sensor)
    table.close()
    return sensor


def _rate(table: Table, step: float, control_rate: float) -> float:
    rate = table.number("rate", low=1e-3, unit="Hz")
    if rate * step > 1.0 + 1e-9:
        steps = math.ceil(rate / control_rate * (1.0 - 1e-9))
        raise table.fail(
            "rate",
            f"is {rate:g} Hz, but there is at most one sample a step of {step:g} s",
            f"give at most {1.0 / step:g} Hz, or a simulation.step of "
            f"{1.0 / (control_rate * steps):.6g} s",
        )
    return rate


def _order(table: Table) -> int:
    order = table.number("order", 4, low=1, high=8)
    if order != int(order):
        raise table.fail("order", f"is {order:g}", "give a whole number of poles, 1 to 8")
    return int(order)


def _check_attitude(table: Table, sensor: Sensor) -> None:
    """What is no matter of a quaternion's four numbers, each by itself."""
    if np.isfinite(sensor.cutoff):
        raise table.fail("cutoff", "filters a quaternion", "filter the gyro instead")
    if sensor.resolution > 0.0:
        raise table.fail("resolution", "rounds a quaternion", "add what it is worth to `noise`")
    if np.isfinite(sensor.range):
        raise table.fail("range", "clips a quaternion", "remove it: an attitude has no end")


def _width(stream: str, parts: CarriedParts, base: Base) -> int:
    """Numbers of a sensor's noise; 0 where the machine has nothing to measure."""
    turns, moves = base.kind != "hinge", bool(base.planar) or base.kind == "free"
    return {
        "gyro": 3 * turns,
        "attitude": 3 * turns,
        "inclinometer": 2 * turns,
        "accelerometer": 3 * turns,
        "magnetometer": 3 * turns,
        "position": 3 * moves,
        "velocity": 3 * moves,
        "wheel_speed": len(parts.wheels),
        "gimbal_angle": len(parts.gimbals),
        "gimbal_rate": len(parts.gimbals),
        "stage_position": len(parts.stages),
        "joint_angle": int(not turns),
        "joint_rate": int(not turns),
        "gas_pressure": int(parts.gas is not None),
    }[stream]


def _window(table: Table, stream: str) -> float:
    return table.number("window", 0.0, low=0.0, high=1.0, unit="s") if stream in _AT_SITE else 0.0


def _site(table: Table, stream: str, layout: MjcfLayout) -> str:
    if stream not in _AT_SITE:
        return ""
    site = table.text("site")
    if site not in layout.sites:
        raise table.fail("site", f"is {site!r}, which is no site of the MJCF", "name it there")
    return site


def load_platform(name: str | Path) -> Platform:
    """The platform of that name (`sads`, `sads:table1`) or in that folder.

    Raises:
        UnknownName: no such platform or variant.
        PlatformError: platform.toml is wrong, with file and line.
    """
    folder, variant = find_model(str(name))
    table = read_toml(folder / "platform.toml", PlatformError)
    return _platform(table, folder, variant)


def variants_of(folder: Path) -> tuple[str, ...]:
    """Names of the variants that a platform folder declares."""
    table = read_toml(folder / "platform.toml", PlatformError)
    return table.table("variants", required=False).keys


def _platform(file: Table, folder: Path, variant: str) -> Platform:
    table, mass_properties = _varied(file, variant)
    name = table.text("name")
    if not name.strip():
        raise table.fail("name", f"is {name!r}", "give the machine one, best that of its folder")
    title = table.text("title")
    model_path = folder / table.text("model", "platform.xml")
    if not model_path.resolve().is_relative_to(folder.resolve()):
        raise table.fail(
            "model",
            f"is {table.text('model')!r}, outside the platform's folder",
            "keep the MJCF beside it",
        )
    if not model_path.exists():
        raise table.fail("model", f"names {model_path.name}, which is missing", "add the MJCF")

    layout = read_layout(model_path)
    base = read_base(table.table("base"), layout)
    parts = read_parts(table, layout, base)
    mass, inertia, offset = _mass_properties(mass_properties)
    inertia_sd = _deviations(mass_properties, "inertia_sd", 6, "kg m^2")
    offset_sd = _deviations(mass_properties, "center_of_mass_offset_sd", 3, "kg m")
    mass_sd = _deviations(mass_properties, "mass_sd", 1, "kg")
    step, control_rate = _timing(table)
    environment = table.table("environment", required=False)
    gravity = read_gravity(environment, 9.81)
    field = read_field(environment, np.zeros(3))
    earth = _earth(environment)
    environment.close()
    frames = table.table("frames", required=False)
    paper_from_body = frames.numbers("paper_from_body", 4, np.array([1.0, 0.0, 0.0, 0.0]))
    if abs(np.linalg.norm(paper_from_body) - 1.0) > 1e-9:
        raise frames.fail(
            "paper_from_body",
            f"is {paper_from_body.tolist()}, no unit quaternion",
            "scale it to length 1",
        )
    frames.close()
    tilt_stop = table.table("tilt_stop", required=False)
    tilt_limit = tilt_stop.number("angle", np.inf, low=0.0, unit="rad", infinite=True)
    if np.pi < tilt_limit < np.inf:
        raise tilt_stop.fail(
            "angle", f"is {tilt_limit:g} rad", "give at most 3.14159 rad, or inf for none"
        )
    tilt_stop.close()
    pitch_stop = _pitch_stop(table.table("pitch_stop")) if "pitch_stop" in table else None
    if pitch_stop is not None and np.isfinite(tilt_limit):
        raise table.fail(
            "pitch_stop",
            f"stands beside tilt_stop.angle of {tilt_limit:g} rad",
            "keep the one the machine has",
        )

    sensor_table = table.table("sensors", required=False)
    sensors = {
        stream: read_sensor(sensor_table, stream, parts, base, layout, (step, control_rate))
        for stream in sensor_table.keys
    }
    for stream in table.texts("unmeasured", ()):
        if sensors.pop(stream, None) is None:
            raise table.fail(
                "unmeasured",
                f"names {stream!r}, for which there is no [sensors.{stream}]",
                f"take one of {', '.join(sensors)}, or remove it",
            )
    estimators = table.texts("estimators", ())
    effects = (*earth, *_effects(table.table("effects", required=False)))
    effects = (*effects, *_calibrated(folder, effects))
    table.raw("hardware")  # `twin.plant.hardware_setup` knows what it means
    if not variant:
        mass_properties.close()
    table.close()
    return Platform(
        name=f"{name}:{variant}" if variant else name,
        title=title,
        folder=folder,
        model_path=model_path,
        step=step,
        control_rate=control_rate,
        mass=mass,
        inertia=inertia,
        center_of_mass_offset=offset,
        base=base,
        wheels=parts.wheels,
        stages=parts.stages,
        rotors=parts.rotors,
        gimbals=parts.gimbals,
        magnetorquers=parts.magnetorquers,
        thrusters=parts.thrusters,
        gas=parts.gas,
        sensors=sensors,
        gravity=gravity,
        magnetic_field=field,
        tilt_limit=tilt_limit,
        paper_from_body=paper_from_body,
        effects=effects,
        pitch_stop=pitch_stop,
        inertia_sd=inertia_sd,
        center_of_mass_offset_sd=offset_sd,
        estimators=estimators,
        mass_sd=None if mass_sd is None else float(mass_sd[0]),
    )


def _earth(environment: Table) -> tuple[StatedEffect, ...]:
    """The Earth's rotation as an effect, where the place and heading of the room are stated."""
    rate = read_earth_rate(environment)
    if rate is None:
        return ()
    return (StatedEffect("earth_rotation", "", {"rate": rate}, environment.line("latitude")),)


def _effects(table: Table) -> tuple[StatedEffect, ...]:
    """`[effects.NAME]`, or `[effects.NAME.TARGET]` for an effect on a stream or part."""
    effects: list[StatedEffect] = []
    for name in table.keys:
        item = table.table(name)
        values = {key: item.raw(key) for key in item.keys}
        own = {key: value for key, value in values.items() if not isinstance(value, dict)}
        if own or not values:
            effects.append(StatedEffect(name, "", own, table.line(name)))
        for target in (key for key in values if key not in own):
            aimed = item.table(target)
            given = {key: aimed.raw(key) for key in aimed.keys}
            effects.append(StatedEffect(name, target, given, item.line(target)))
    return tuple(effects)


def _calibrated(folder: Path, stated: Sequence[StatedEffect]) -> tuple[StatedEffect, ...]:
    """Effects of the folder's calibration.toml, where it has one.

    Raises:
        PlatformError: platform.toml states one of them, too.
    """
    path = folder / CALIBRATION
    if not path.is_file():
        return ()
    table = read_toml(path, PlatformError)
    effects = _effects(table.table("effects"))
    table.close()
    known = {(effect.name, effect.target) for effect in stated}
    for effect in effects:
        if (effect.name, effect.target) in known:
            raise table.fail(
                "effects",
                f"state {effect.name}, as platform.toml does",
                "keep it in one of the two files",
            )
    return effects


def _pitch_stop(table: Table) -> PitchStop:
    axis = table.numbers("axis", 3)
    if abs(np.linalg.norm(axis) - 1.0) > 1e-9 or abs(axis[2]) > 1e-9:
        raise table.fail(
            "axis", f"is {axis.tolist()}", "give a unit vector that is horizontal when level"
        )
    angle = table.number("angle", low=0.0, high=0.5 * np.pi, unit="rad")
    table.close()
    return PitchStop(axis, angle)


def _timing(table: Table) -> tuple[float, float]:
    simulation = table.table("simulation")
    step = simulation.number("step", low=1e-6, high=1.0, unit="s")
    control_rate = simulation.number("control_rate", low=1e-3, high=1e5, unit="Hz")
    ratio = 1.0 / (step * control_rate)
    if ratio < 0.5 or abs(ratio - round(ratio)) > 1e-9 * ratio:
        raise simulation.fail(
            "step",
            f"is {step:g} s, which does not divide the control period of {1 / control_rate:g} s",
            "choose a step that fits a whole number of times",
        )
    simulation.close()
    return step, control_rate


def _varied(table: Table, variant: str) -> tuple[Table, Table]:
    """The file's table and its [mass_properties] as a variant has them.

    A variant holds the keys of [mass_properties] that it changes, and tables of what it changes in
    others; one under the name of an array of tables changes every row of it.
    """
    base = table.table("mass_properties")
    variants = table.table("variants", required=False)
    for known in variants.keys:
        variants.table(known)
    if not variant:
        return table, base
    if variant not in variants:
        raise UnknownName("variant", variant, variants.keys)
    change = variants.table(variant)
    for key in ("name", "hardware"):
        if key in change:
            raise change.fail(key, "is not a variant's to change", "state it for the whole machine")
    return change.over(table), change.over(base)


def _mass_properties(table: Table) -> tuple[float, Array, Array]:
    mass = table.number("mass", low=1e-6, unit="kg")
    xx, yy, zz, xy, xz, yz = table.numbers("inertia", 6, unit="kg m^2")
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    principal = np.linalg.eigvalsh(inertia)
    if principal[0] <= 0.0:
        raise table.fail(
            "inertia",
            f"has principal moments {principal.round(4).tolist()}, not all of them positive",
            "check its entries, xx yy zz xy xz yz",
        )
    if principal[0] + principal[1] < principal[2] * (1.0 - 1e-9):
        raise table.fail(
            "inertia",
            f"has principal moments {principal.round(4).tolist()}: no rigid body has one moment "
            "above the sum of the other two",
            "check its entries",
        )
    offset = table.numbers("center_of_mass_offset", 3, unit="kg m")
    return mass, inertia, offset


def _deviations(table: Table, key: str, size: int, unit: str) -> Array | None:
    """Standard deviations, if any are stated; none of them 0."""
    result = cast(Array | None, table.numbers(key, size, None, low=0.0, unit=unit))
    if result is not None and not np.all(result > 0.0):
        raise table.fail(key, "holds 0", f"give what the measurement leaves open [{unit}]")
    return result
