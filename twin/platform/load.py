"""Read platform.toml into a `Platform`.

The keys and their units are those of models/sads/platform.toml; every key that is not known is an
error with its line. A variant ([variants.NAME]) replaces the keys it gives in [mass_properties].
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twin.config import Table, read_toml
from twin.errors import PlatformError, UnknownName
from twin.library import find_model
from twin.platform.mjcf import joint_axes
from twin.platform.parts import Array, Base, Platform, Sensor, Stage, StatedEffect, Wheel
from twin.signals import stream_named

MEASURED = (
    "gyro",
    "attitude",
    "wheel_speed",
    "stage_position",
    "joint_angle",
    "joint_rate",
)
"""Streams that the simulated plant can measure."""


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


def _platform(table: Table, folder: Path, variant: str) -> Platform:
    name = table.text("name")
    title = table.text("title")
    model_path = folder / table.text("model", "platform.xml")
    if not model_path.resolve().is_relative_to(folder.resolve()):
        raise table.fail("model", "lies outside the platform's folder", "keep the MJCF beside it")
    if not model_path.exists():
        raise table.fail("model", f"names {model_path.name}, which is missing", "add the MJCF")

    base = _base(table.table("base"))
    axes = joint_axes(model_path)
    wheels = tuple(_wheel(row, axes) for row in table.tables("wheels"))
    stages = tuple(_stage(row, axes) for row in table.tables("stages"))
    _refuse_doubles(table, [part.name for part in (*wheels, *stages)])
    mass, inertia, offset = _mass_properties(table, variant)
    step, control_rate = _timing(table)
    environment = table.table("environment", required=False)
    gravity = environment.number("gravity", 9.81, low=0.0, unit="m/s^2")
    field = environment.numbers("magnetic_field", 3, np.zeros(3), unit="T")
    environment.close()
    frames = table.table("frames", required=False)
    paper_from_body = frames.numbers("paper_from_body", 4, np.array([1.0, 0.0, 0.0, 0.0]))
    if abs(np.linalg.norm(paper_from_body) - 1.0) > 1e-9:
        raise frames.fail("paper_from_body", "is no unit quaternion", "scale it to length 1")
    frames.close()
    tilt_stop = table.table("tilt_stop", required=False)
    tilt_limit = tilt_stop.number("angle", np.inf, low=0.0, high=np.pi, unit="rad")
    tilt_stop.close()

    widths = {"wheel_speed": len(wheels), "stage_position": len(stages), "joint": 1}
    sensor_table = table.table("sensors", required=False)
    sensors = {
        stream: _sensor(sensor_table, stream, widths, base, step) for stream in sensor_table.keys
    }
    effects = _effects(table.table("effects", required=False))
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
        wheels=wheels,
        stages=stages,
        sensors=sensors,
        gravity=gravity,
        magnetic_field=field,
        tilt_limit=tilt_limit,
        paper_from_body=paper_from_body,
        effects=effects,
    )


def _effects(table: Table) -> tuple[StatedEffect, ...]:
    """`[effects.NAME]`, or `[effects.NAME.TARGET]` for an effect on a stream or part."""
    found: list[StatedEffect] = []
    for name in table.keys:
        one = table.table(name)
        values = {key: one.raw(key) for key in one.keys}
        own = {key: value for key, value in values.items() if not isinstance(value, dict)}
        if own or not values:
            found.append(StatedEffect(name, "", own, table.line(name)))
        for target in (key for key in values if key not in own):
            aimed = one.table(target)
            given = {key: aimed.raw(key) for key in aimed.keys}
            found.append(StatedEffect(name, target, given, one.line(target)))
    return tuple(found)


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


def _mass_properties(table: Table, variant: str) -> tuple[float, Array, Array]:
    base = table.table("mass_properties")
    variants = table.table("variants", required=False)
    for known in variants.keys:
        variants.table(known)
    if variant and variant not in variants:
        raise UnknownName("variant", variant, variants.keys)
    override = variants.table(variant) if variant else base

    def source(key: str) -> Table:
        return override if key in override else base

    mass = source("mass").number("mass", low=1e-6, unit="kg")
    xx, yy, zz, xy, xz, yz = source("inertia").numbers("inertia", 6, unit="kg m^2")
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if np.min(np.linalg.eigvalsh(inertia)) <= 0.0:
        raise source("inertia").fail(
            "inertia",
            "has a principal moment that is not positive",
            "check the products' signs",
        )
    principal = np.linalg.eigvalsh(inertia)
    if principal[0] + principal[1] < principal[2] * (1.0 - 1e-9):
        raise source("inertia").fail(
            "inertia",
            f"has principal moments {principal.round(4).tolist()}: no rigid body has one moment "
            "above the sum of the other two",
            "check its entries",
        )
    offset = source("center_of_mass_offset").numbers("center_of_mass_offset", 3, unit="kg m")
    for used in {id(base): base, id(override): override}.values():
        for key in ("mass", "inertia", "center_of_mass_offset"):
            used.raw(key)
        used.close()
    return mass, inertia, offset


def _base(table: Table) -> Base:
    kind = table.text("kind", among=("ball", "hinge"))
    base = Base(
        kind="ball" if kind == "ball" else "hinge",
        joint=table.text("joint"),
        body=table.text("body"),
        actuator=table.text("actuator", None),
        torque_limit=table.number("torque_limit", np.inf, low=0.0, unit="N m"),
    )
    if base.kind == "ball" and base.actuator is not None:
        raise table.fail("actuator", "is given on a ball joint", "only a hinge has a motor")
    table.close()
    return base


def _wheel(table: Table, axes: Mapping[str, Array]) -> Wheel:
    wheel = Wheel(
        name=table.text("name"),
        axis=_axis(table, axes),
        inertia=table.number("inertia", low=1e-12, unit="kg m^2"),
        momentum_limit=table.number("momentum_limit", low=0.0, unit="N m s"),
        torque_limit=table.number("torque_limit", low=0.0, unit="N m"),
    )
    table.close()
    return wheel


def _axis(table: Table, axes: Mapping[str, Array]) -> Array:
    name = table.text("name")
    if name not in axes:
        hint = str(UnknownName("joint", name, axes)).partition("(")[2].rstrip(")")
        raise table.fail("name", f"is {name!r}, which is no joint of the MJCF", hint)
    return axes[name]


def _stage(table: Table, axes: Mapping[str, Array]) -> Stage:
    low, high = table.numbers("travel", 2, unit="m")
    if low >= high:
        raise table.fail("travel", f"runs from {low:g} to {high:g} m", "give the lower end first")
    stage = Stage(
        name=table.text("name"),
        axis=_axis(table, axes),
        mass=table.number("mass", low=1e-9, unit="kg"),
        travel=(float(low), float(high)),
        speed=table.number("speed", low=1e-9, unit="m/s"),
        acceleration=table.number("acceleration", low=1e-9, unit="m/s^2"),
        resolution=table.number("resolution", 0.0, low=0.0, unit="m"),
    )
    table.close()
    return stage


def _sensor(sensors: Table, stream: str, widths: dict[str, int], base: Base, step: float) -> Sensor:
    if stream not in MEASURED:
        raise sensors.fail(
            stream,
            "is no stream that the simulation measures",
            "use " + ", ".join(MEASURED),
        )
    table = sensors.table(stream)
    if stream in ("gyro", "attitude"):
        width = 3
    else:
        width = widths["joint" if stream.startswith("joint") else stream]
    if width == 0 or (stream.startswith("joint") and base.kind == "ball"):
        raise sensors.fail(stream, "measures a part the machine does not have", "remove it")
    unit = "rad" if stream == "attitude" else stream_named(stream).unit
    sensor = Sensor(
        stream=stream,
        rate=table.number("rate", low=1e-3, high=1.0 / step, unit="Hz"),
        noise=table.numbers("noise", width, low=0.0, unit=unit),
        bias=table.numbers("bias", width, np.zeros(width), low=0.0, unit=unit),
        resolution=table.number("resolution", 0.0, low=0.0, unit=unit),
        range=table.number("range", np.inf, low=0.0, unit=unit),
        latency=table.number("latency", 0.0, low=0.0, high=10.0, unit="s"),
        dropout=table.number("dropout", 0.0, low=0.0, high=1.0),
    )
    table.close()
    return sensor


def _refuse_doubles(table: Table, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            key = "wheels" if "wheels" in table else "stages"
            raise table.fail(
                key,
                f"and stages hold two parts named {name!r}",
                "give each part its own name",
            )
