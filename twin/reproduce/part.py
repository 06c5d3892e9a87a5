"""A table or a figure of a paper: what is computed for it, and what comes out."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

Say = Callable[[str], None]
"""Told what is being done."""


@dataclass(frozen=True)
class Ours:
    """What came out for a row of docs/reproduction.toml."""

    value: float | bool
    low: float | None = None
    """Of the 95 % interval, where there is one."""
    high: float | None = None
    note: str = ""
    """How it was computed, or why it is so; a sentence."""


@dataclass(frozen=True)
class Computed:
    """Everything that one part computes."""

    rows: Mapping[str, Ours]
    """By the row's id."""
    figures: Mapping[str, str] = field(default_factory=dict[str, str])
    """Caption -> SVG text, drawn in the paper's axes."""


@dataclass(frozen=True)
class PaperPart:
    """Computes some rows of a paper, as they belong together; alone in a process of its own."""

    ids: tuple[str, ...]
    compute: Callable[[Say], Computed]
