"""Results that print, draw and save themselves.

How a kind of result looks is in `twin.report.results`, which is imported when one is first shown:
a module that computes a result does not depend on those that draw it.
"""

import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEIGHT = 640
"""Of a page in a notebook [px]."""


class Shown:
    """A result of the Python interface: `print` it, `plot` it, `save` it, look at it in a
    notebook."""

    def __str__(self) -> str:
        """What the command line prints of it."""
        return "\n".join(_looks().sentences_of(self))

    def document(self) -> Mapping[str, Any]:
        """What the command line prints of it with `--json`; SI."""
        return _looks().document_of(self)

    def page(self) -> str:
        """One self-contained HTML page."""
        return _looks().page_of(self)

    def plot(self) -> "Figure":
        """Its main figure."""
        return _looks().figure_of(self)

    def save(self, path: str | Path) -> Path:
        """Write it into a file, in the format that the ending of its name says.

        Args:
            path: .html (the page), .json (the document), .txt (the text), .png, .svg or .pdf (the
                figure), or a folder: the page's figures as SVG and PDF and its tables as CSV, of a
                run or a log the log's tables; folders that are missing are made.

        Returns:
            The file.

        Raises:
            UsageError: another ending, or a file that cannot be written.
        """
        return _looks().save(self, Path(path))

    def _repr_html_(self) -> str:
        """The page, in a frame of a notebook: its style stays its own."""
        return (
            f'<iframe srcdoc="{escape(self.page())}" width="100%" height="{HEIGHT}" '
            'style="border:0"></iframe>'
        )


def as_json(document: object) -> str:
    """A document as text; arrays are lists, and what is no finite number is null."""
    return json.dumps(_plain(document), indent=2, allow_nan=False, ensure_ascii=False)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        items = cast(Mapping[Any, Any], value).items()
        return {str(key): _plain(entry) for key, entry in items}
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence):
        return [_plain(entry) for entry in cast(Sequence[Any], value)]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def _looks() -> Any:
    return import_module("twin.report.results")
