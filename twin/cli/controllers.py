"""`twin controllers`: the control laws that are shipped, and their gains."""

import dataclasses
import inspect
from dataclasses import dataclass
from typing import Annotated, Any

import tyro


@dataclass(frozen=True)
class Controllers:
    """The control laws that are shipped: what each does, its usual reference, and its gains."""

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

        laws = [_facts(name) for name in controller_names()]
        if self.json:
            print_json(laws)
        else:
            print("\n\n".join(_text(law) for law in laws))
        return 0


def _header(name: str) -> str:
    from twin.controller.remote import LONGEST_VALID_MS, schema_of
    from twin.plant.devices.link.schema import c_header
    from twin.platform import load_platform

    platform = load_platform(name)
    return c_header(schema_of(platform), platform.name, LONGEST_VALID_MS)


def _facts(name: str) -> dict[str, Any]:
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


def _text(law: dict[str, Any]) -> str:
    rows = [f"  {gain['name']:<24} {gain['value']} {gain['unit']}" for gain in law["gains"]]
    usual = f"  {'usual reference':<24} {law['reference']}"
    return "\n".join([f"{law['name']}: {law['summary']}", usual, *rows])
