"""The verbs of the library: `twin platforms`, `twin controllers`, `twin effects`, `twin new`."""

import dataclasses
import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

if TYPE_CHECKING:
    from collections.abc import Sequence

    from twin.effects import Effect, Parameter
    from twin.model import Named
    from twin.platform import Platform


@dataclass(frozen=True)
class Platforms:
    """List the shipped machines: mass, inertia, mass moment, actuators, sensors."""

    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Print them; the exit code."""
        from twin.cli.output import print_json
        from twin.library import model_names
        from twin.platform import load_platform

        platforms = [load_platform(name) for name in model_names()]
        if self.json:
            print_json([_platform_facts(platform) for platform in platforms])
        else:
            print("\n\n".join(_platform_text(platform) for platform in platforms))
        return 0


def _platform_facts(platform: "Platform") -> dict[str, Any]:
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
        **{
            kind: [part.name for part in parts] for kind, parts in _platform_parts(platform).items()
        },
        "sensors": {name: sensor.rate for name, sensor in platform.sensors.items()},
        "commands": platform.commands,
        "control_rate": platform.control_rate,
    }


def _platform_parts(platform: "Platform") -> "dict[str, Sequence[Named]]":
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


def _platform_text(platform: "Platform") -> str:
    from twin.platform import variants_of

    xx, yy, zz = platform.inertia.diagonal()
    xy, xz, yz = platform.inertia[[0, 0, 1], [1, 2, 2]]
    x, y, z = platform.center_of_mass_offset
    parts = [f"{len(parts)} {kind}" for kind, parts in _platform_parts(platform).items() if parts]
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


@dataclass(frozen=True)
class Controllers:
    """List the shipped control laws: what each does, its usual reference, and its gains."""

    header: Annotated[str | None, tyro.conf.arg(metavar="PLATFORM")] = None
    """Print instead the channels that a law in another program has of this machine, as a C header
    (docs/link.md)."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Print them; the exit code."""
        if self.header is not None:
            print(_header(self.header), end="")
            return 0
        from twin.cli.output import print_json
        from twin.library import controller_names

        laws = [_law_facts(name) for name in controller_names()]
        if self.json:
            print_json(laws)
        else:
            print("\n\n".join(_law_text(law) for law in laws))
        return 0


def _header(name: str) -> str:
    from twin.controller.remote import LONGEST_VALID_MS, schema_of
    from twin.plant.devices.link.schema import c_header
    from twin.platform import load_platform

    platform = load_platform(name)
    return c_header(schema_of(platform), platform.name, LONGEST_VALID_MS)


def _law_facts(name: str) -> dict[str, Any]:
    from twin.controller import load_controller

    law: Any = load_controller(name)
    gains = [
        {
            "name": field.name,
            "value": getattr(law, field.name),
            "unit": field.metadata.get("unit", ""),
        }
        for field in dataclasses.fields(law)
    ]
    summary = (inspect.getdoc(type(law)) or "").partition("\n")[0]
    return {"name": name, "summary": summary, "reference": law.reference, "gains": gains}


def _law_text(law: dict[str, Any]) -> str:
    rows = [f"  {gain['name']:<24} {gain['value']} {gain['unit']}" for gain in law["gains"]]
    usual = f"  {'usual reference':<24} {law['reference']}"
    return "\n".join([f"{law['name']}: {law['summary']}", usual, *rows])


@dataclass(frozen=True)
class Effects:
    """List the effects, which are possible departures from a model, with sizes and observable
    traces."""

    name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[NAME]")] = None
    """Only this one: a name, a file, or either with values as `twin run --effects` takes
    them (`clock_lag:wheel_speed=0.17`)."""
    show: Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="[PLATFORM]")] = None
    """Simulate a platform with the effect and without it, and show the difference; by default the
    first shipped platform that can have it."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Print them; the exit code."""
        from twin.cli.output import print_json
        from twin.effects import catalogue, effect_named
        from twin.errors import UsageError

        if self.show is not None:
            return self._show()
        if self.name is None:
            kinds = list(catalogue())
        else:
            kinds = [effect_named(self.name.partition("=")[0].partition(":")[0])]
        if self.name is not None and "=" in self.name:
            raise UsageError(f"{self.name}: values are for --show; drop them, or add --show")
        if self.json:
            print_json([_effect_facts(kind) for kind in kinds])
        elif self.name is None:
            print(_list(kinds))
        else:
            print("\n\n".join(_effect_text(kind) for kind in kinds))
        return 0

    def _show(self) -> int:
        from twin.cli.output import print_json
        from twin.contrast import contrast
        from twin.errors import UsageError
        from twin.report.contrast import contrast_words, draw_contrast

        if self.name is None or self.show is None or len(self.show) > 1:
            raise UsageError("--show takes one effect and one platform: twin effects NAME --show")
        effect, platform = _aimed(self.name, self.show[0] if self.show else None)
        result = contrast(platform, effect)
        label = effect.label.replace(":", "-")
        picture = Path("runs", "effects", f"{label}-{platform.name.replace(':', '-')}.png")
        draw_contrast(result, picture)
        if self.json:
            rows = [
                {
                    "stream": difference.stream,
                    "unit": difference.unit,
                    "rms": difference.rms,
                    "worst": difference.worst,
                    "noise": difference.noise,
                }
                for difference in result.differences
            ]
            facts = {"name": effect.name, "target": effect.target, "platform": platform.name}
            print_json({**facts, "differences": rows, "picture": picture})
        else:
            print(contrast_words(result))
            print(f"\ndrawn in {picture}")
        return 0


def _aimed(text: str, name: str | None) -> "tuple[Effect, Platform]":
    """The effect, at its typical size and its first target unless told, and its platform."""
    from twin.effects import EffectError, able, parse_effects
    from twin.effects.effect import targets
    from twin.errors import UsageError
    from twin.library import model_names
    from twin.platform import load_platform

    label, equals, _ = text.partition("=")
    effects = parse_effects(text)
    if len(effects) != 1:
        raise UsageError(f"{text}: --show takes one effect")
    reasons: list[str] = []
    names = [name] if name else sorted(model_names(), key=lambda entry: (entry != "sads", entry))
    for item in names:
        platform = load_platform(item)
        effect = effects[0]
        known = targets(effect.takes, platform)
        if not effect.target and effect.takes == "stream" and known:
            effect = parse_effects(f"{label}:{known[0]}{equals}{text.partition('=')[2]}")[0]
        try:
            able(platform, effect)
        except EffectError as problem:
            reasons.append(str(problem))
            continue
        return effect, platform
    raise UsageError("; ".join(reasons))


def _effect_facts(kind: "type[Effect]") -> dict[str, Any]:
    return {
        "name": kind.name,
        "meaning": kind.meaning(),
        "domain": kind.domain.value,
        "target": kind.takes or None,
        "parameters": [
            {
                "name": parameter.name,
                "words": parameter.words,
                "unit": parameter.unit,
                "typical": parameter.typical,
                "source": parameter.source,
                "low": parameter.low,
                "high": parameter.high,
            }
            for parameter in kind.parameters()
        ],
        "observable": kind.observable,
        "streams": kind.streams,
    }


def _list(kinds: "list[type[Effect]]") -> str:
    """All of them, a few lines each, by where they live."""
    lines: list[str] = []
    for domain in dict.fromkeys(kind.domain for kind in kinds):
        of_domain = [kind for kind in kinds if kind.domain is domain]
        lines += [f"{domain.value}:", *(f"  {_short(kind)}" for kind in of_domain), ""]
    return "\n".join([*lines, "`twin effects NAME` describes one in full; `--show` simulates it."])


def _short(kind: "type[Effect]") -> str:
    aim = f":{kind.takes.upper()}" if kind.takes else ""
    sizes = [f"typical: {_size(parameter)} ({parameter.source})" for parameter in kind.parameters()]
    visible = f"seen in: {', '.join(kind.streams)}; {kind.observable}"
    return "\n".join(
        [
            f"{kind.name + aim:<28}  {kind.meaning()}",
            *(f"{'':<32}{line}" for line in [*sizes, visible]),
        ]
    )


def _effect_text(kind: "type[Effect]") -> str:
    import inspect
    import textwrap

    body = textwrap.indent(inspect.getdoc(kind) or "", "  ")
    aim = f", aimed at a {kind.takes}" if kind.takes else ""
    lines = [f"{kind.name} ({kind.domain.value}{aim})", body, ""]
    for parameter in kind.parameters():
        lines += [
            f"  {parameter.name} [{parameter.unit}]: {parameter.words}",
            f"    typical {_size(parameter)} ({parameter.source}); between "
            f"{parameter.low:g} and {parameter.high:g}",
        ]
    lines += ["", f"  observable: {kind.observable}", f"  streams: {', '.join(kind.streams)}"]
    return "\n".join(lines)


def _size(parameter: "Parameter") -> str:
    from twin.effects.effect import value_words

    return value_words(parameter, parameter.typical)


@dataclass(frozen=True)
class New:
    """Write a platform folder for a new machine.

    It passes `twin check` and flies with `twin run` as it is. Replace its masses, parts and sensors
    by yours, with a source for each number; `twin check` reports what does not fit together.
    """

    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")]
    """The machine's name, or a path that ends in it."""
    kind: Annotated[str, tyro.conf.arg(metavar="table|pendulum|free")] = "table"
    """A table on a ball bearing, a pendulum on a hinge, or a body that is thrown."""

    from_log: Annotated[Path | None, tyro.conf.arg(metavar="LOG")] = None
    """Begin with the sensors of this log, their rates and their noise."""

    def run(self) -> int:
        """Write it; the exit code."""
        from twin.api import new
        from twin.cli.output import LogPart
        from twin.scaffold import KINDS

        log = None if self.from_log is None else LogPart().open(self.from_log)
        folder = Path(self.name)
        new(folder, self.kind, log)
        print(f"{folder}: {KINDS[self.kind]}")
        print((folder / "README.md").read_text(encoding="utf-8").split("```")[1].strip())
        return 0
