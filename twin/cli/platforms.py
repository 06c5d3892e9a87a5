"""`twin platforms`: the machines that are shipped, and what each is made of."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from twin.model import Named
    from twin.platform import Platform


@dataclass(frozen=True)
class Platforms:
    """The machines that are shipped: mass, inertia, mass moment, actuators, sensors."""

    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Print them; the exit code."""
        from twin.cli.output import print_json
        from twin.library import model_names
        from twin.platform import load_platform

        platforms = [load_platform(name) for name in model_names()]
        if self.json:
            print_json([_facts(platform) for platform in platforms])
        else:
            print("\n\n".join(_text(platform) for platform in platforms))
        return 0


def _facts(platform: "Platform") -> dict[str, Any]:
    from twin.platform import variants_of

    return {
        "name": platform.name,
        "title": platform.title,
        "folder": platform.folder,
        "variants": variants_of(platform.folder),
        "mass": platform.mass,
        "inertia": platform.inertia,
        "center_of_mass_offset": platform.center_of_mass_offset,
        "base": platform.base.kind,
        "locked": platform.base.locked,
        **{kind: [part.name for part in parts] for kind, parts in _parts(platform).items()},
        "sensors": {name: sensor.rate for name, sensor in platform.sensors.items()},
        "commands": platform.commands,
        "control_rate": platform.control_rate,
    }


def _parts(platform: "Platform") -> "dict[str, Sequence[Named]]":
    return {
        "wheels": platform.wheels,
        "rotors": platform.rotors,
        "gimbals": platform.gimbals,
        "stages": platform.stages,
        "magnetorquers": platform.magnetorquers,
        "thrusters": platform.thrusters,
    }


def _bearing(platform: "Platform") -> str:
    base = platform.base
    if not base.planar:
        return f"a {base.kind} joint"
    locked = f" ({', '.join(base.locked)} locked)" if base.locked else ""
    return f"a ball on a planar stage{locked}"


def _text(platform: "Platform") -> str:
    from twin.platform import variants_of

    xx, yy, zz = platform.inertia.diagonal()
    xy, xz, yz = platform.inertia[[0, 0, 1], [1, 2, 2]]
    x, y, z = platform.center_of_mass_offset
    parts = [f"{len(parts)} {kind}" for kind, parts in _parts(platform).items() if parts]
    if platform.base.actuator is not None:
        parts.append("a motor at the joint")
    commands = [f"{name} ({width})" for name, width in platform.commands.items()]
    sensors = [f"{name} {sensor.rate:g} Hz" for name, sensor in platform.sensors.items()]
    rows = (
        ("mass", f"{platform.mass:g} kg on {_bearing(platform)}"),
        ("J", f"xx {xx:g}, yy {yy:g}, zz {zz:g}, xy {xy:g}, xz {xz:g}, yz {yz:g} kg m^2"),
        ("m r", f"x {x:g}, y {y:g}, z {z:g} kg m"),
        ("actuators", ", ".join(parts) or "none"),
        ("commands", f"{', '.join(commands) or 'none'} at {platform.control_rate:g} Hz"),
        ("sensors", ", ".join(sensors) or "none"),
        ("variants", ", ".join(variants_of(platform.folder)) or "none"),
    )
    lines = [f"{platform.name}: {platform.title}"]
    return "\n".join(lines + [f"  {name:<9} {text}" for name, text in rows])
