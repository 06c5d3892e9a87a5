"""The page of effects: written from the catalogue while the site is built."""

import inspect
from importlib import import_module
from typing import Any

from twin.effects import Effect, catalogue

PLACE = "<!-- effects -->"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """A page with the catalogue where it has the mark; mkdocs calls this for each page."""
    return markdown.replace(PLACE, "\n".join(map(_section, catalogue())))


def _section(kind: type[Effect]) -> str:
    module = inspect.getdoc(import_module(kind.__module__)) or ""
    rows = [
        f"| `{known.name}` | {known.words} | {known.unit} | {_usual(known)} "
        f"| {known.low:g} to {known.high:g} | {known.source} |"
        for known in kind.parameters()
    ]
    domain, shows = kind.domain.value, kind.observable
    return "\n".join(
        [
            f"## {kind.name}",
            "",
            module,
            "",
            inspect.getdoc(kind) or "",
            "",
            f"Domain: {domain}. In a log: {shows}.",
            "",
            "| parameter | meaning | unit | usual | bounds | source |",
            "|---|---|---|---|---|---|",
            *rows,
            "",
        ]
    )


def _usual(known: Any) -> str:
    return f"{known.typical:g}" if isinstance(known.typical, float) else str(known.typical)
