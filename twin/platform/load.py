"""Read platform.toml into a `Platform`.

docs/platforms.md has the keys, their units and defaults; every key that is not known is an error
with its line. A variant ([variants.NAME]) replaces the keys it gives.
"""

from pathlib import Path
from typing import cast

import numpy as np

from twin.config import Table, read_toml
from twin.errors import PlatformError, UnknownName
from twin.library import find_model
from twin.platform.load_parts import read_base, read_parts
from twin.platform.load_sensors import read_sensor
from twin.platform.mjcf import read_layout
from twin.platform.parts import Array, PitchStop, Platform, StatedEffect
from twin.recording.environment import read_earth_rate, read_field, read_gravity


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
    effects = (*earth, *_effects(table.table("effects", required=False)))
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
    )


def _earth(environment: Table) -> tuple[StatedEffect, ...]:
    """The Earth's rotation as an effect, where the place and heading of the room are stated."""
    rate = read_earth_rate(environment)
    if rate is None:
        return ()
    return (StatedEffect("earth_rotation", "", {"rate": rate}, environment.line("latitude")),)


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
    found = cast(Array | None, table.numbers(key, size, None, low=0.0, unit=unit))
    if found is not None and not np.all(found > 0.0):
        raise table.fail(key, "holds 0", f"give what the measurement leaves open [{unit}]")
    return found
