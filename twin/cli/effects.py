"""`twin effects`: what may depart from a machine's model, and what each effect does to a run."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

if TYPE_CHECKING:
    from twin.effects import Effect, Parameter
    from twin.platform import Platform


@dataclass(frozen=True)
class Effects:
    """What may depart from a machine's model: each effect, its size, and what gives it away."""

    name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[NAME]")] = None
    """Only this one: a name, the file of one's own, or with values as `twin run --effects` takes
    them (`clock_lag:wheel_speed=0.17`)."""
    show: Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="[PLATFORM]")] = None
    """Run a platform with it and without, and show the difference; by default the first shipped
    platform that can have it."""
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
            print_json([_facts(kind) for kind in kinds])
        elif self.name is None:
            print(_list(kinds))
        else:
            print("\n\n".join(_text(kind) for kind in kinds))
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


def _facts(kind: "type[Effect]") -> dict[str, Any]:
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
        own = [kind for kind in kinds if kind.domain is domain]
        lines += [f"{domain.value}:", *(f"  {_short(kind)}" for kind in own), ""]
    return "\n".join(
        [*lines, "`twin effects NAME` tells one in full; `--show` shows what it does."]
    )


def _short(kind: "type[Effect]") -> str:
    aim = f":{kind.takes.upper()}" if kind.takes else ""
    sizes = [f"typical: {_size(parameter)} ({parameter.source})" for parameter in kind.parameters()]
    seen = f"seen in: {', '.join(kind.streams)}; {kind.observable}"
    return "\n".join(
        [
            f"{kind.name + aim:<28}  {kind.meaning()}",
            *(f"{'':<32}{line}" for line in [*sizes, seen]),
        ]
    )


def _text(kind: "type[Effect]") -> str:
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
