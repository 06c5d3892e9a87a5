"""How pages and figures look, and the provenance in a page's foot."""

import hashlib
import json
import shlex
import sys
from collections.abc import Sequence
from datetime import date
from html import escape
from importlib.metadata import version
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from twin.platform import Platform
from twin.recording import Recording
from twin.stream.provenance import hashes_of

INK, SOFT = "#1c2733", "#55626e"
PALETTE = ("#1f6f8b", "#c2571a", "#5b8c3a", "#8a5a9e", "#b8932f", "#7a7f87")
"""Colours of the columns of a stream, in turn."""
MISSING = "#f6d9d2"
"""Behind stretches without samples."""

FIGURE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "twin",
    "font.family": "sans-serif",
    "font.sans-serif": ["Inter", "Helvetica Neue", "Arial", "DejaVu Sans"],
    "font.size": 10,
    "axes.edgecolor": "#9aa7b2",
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e8edf1",
    "grid.linewidth": 0.8,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}
"""For `matplotlib.rc_context`."""

_PAGE = """
:root { --ink: #1c2733; --soft: #55626e; --line: #dfe6eb; --accent: #1f6f8b;
  --paper: #ffffff; --shade: #f4f8fa; color-scheme: light dark; }
@media (prefers-color-scheme: dark) { :root { --ink: #e3e9ee; --soft: #9fb0bd; --line: #33424e;
  --accent: #5fb3d1; --paper: #12191f; --shade: #1b252d; } }
* { box-sizing: border-box; }
body { margin: 0; color: var(--ink); background: var(--paper); overflow-wrap: anywhere;
  font: 16px/1.55 Inter, "Helvetica Neue", Arial, "DejaVu Sans", sans-serif; }
main { max-width: 60rem; margin: 0 auto; padding: 3rem 1.5rem 5rem; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .3rem; font-weight: 650; }
h2 { font-size: 1.25rem; margin: 3rem 0 .6rem; font-weight: 650; }
h3 { font-size: 1rem; margin: 2rem 0 .4rem; font-weight: 650; }
.under { color: var(--soft); margin: 0 0 2rem; }
.verdict { border-left: 4px solid var(--accent); background: var(--shade); padding: .9rem 1.2rem;
  font-size: 1.1rem; margin: 1.2rem 0; }
li { margin: .35rem 0; }
figure { margin: 1.2rem 0 0; }
figure svg { width: 100%; height: auto; display: block; background: #fff; border-radius: 4px; }
figcaption { color: var(--soft); font-size: .9rem; margin-top: .3rem; }
table { border-collapse: collapse; width: 100%; font-size: .92rem;
  font-variant-numeric: tabular-nums; }
th { text-align: left; color: var(--soft); font-weight: 500; border-bottom: 1px solid var(--soft); }
th, td { padding: .4rem .8rem .4rem 0; vertical-align: top; }
td { border-bottom: 1px solid var(--line); }
.wide { overflow-x: auto; } .wide td, .wide th { overflow-wrap: normal; }
footer { border-top: 1px solid var(--line); color: var(--soft); font-size: .82rem;
  margin-top: 4rem; padding-top: .8rem; } footer p { margin: .15rem 0; }
@media (max-width: 40rem) { main { padding: 1.5rem 1rem 3rem; } h1 { font-size: 1.45rem; } }
pre { font: .85rem/1.5 "DejaVu Sans Mono", Menlo, Consolas, monospace; overflow-x: auto; }
"""


def page(title: str, body: str) -> str:
    """A self-contained HTML page."""
    return (
        "<!doctype html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        f"<title>{escape(title)}</title>\n<style>{_PAGE}</style>\n</head>\n<body>\n<main>\n"
        f"{body}\n</main>\n</body>\n</html>\n"
    )


def svg(figure: Figure) -> str:
    """A figure as text to stand in a page."""
    text = StringIO()
    with mpl.rc_context(FIGURE):
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue().split("\n", 3)[-1]


def framed(drawn: Figure | str, caption: str) -> str:
    """A figure, or its SVG text, with its caption."""
    text = drawn if isinstance(drawn, str) else svg(drawn)
    return f"<figure>{text}<figcaption>{escape(caption)}</figcaption></figure>"


def bullets(items: Sequence[str]) -> str:
    """Sentences, each a point."""
    return "<ul>" + "".join(f"<li>{escape(typeset(item))}</li>" for item in items) + "</ul>"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells as text."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(typeset(cell))}</td>" for cell in row) + "</tr>"
        for row in rows
    )
    rows_and_head = f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody>"
    return f"<div class='wide'><table>{rows_and_head}</table></div>"


def typeset(text: str) -> str:
    """Plain signs as print has them."""
    return text.replace("+-", "±").replace("^2", "²").replace("^3", "³").replace(" -", " −")


LARGEST = 512 * 2**20
"""Bytes of a log up to which it is hashed: a person waits for the page."""
SHOWN = 12
"""Digits of a hash."""


def foot(recordings: Sequence[Recording], platform: Platform | None) -> str:
    """Lines as HTML: version and date, the command, a hash of each log and of the machine's files.

    Args:
        recordings: the logs of the page.
        platform: the machine; None without one.
    """
    lines = [f"airbearing-twin {version('airbearing-twin')}, {date.today().isoformat()}"]
    words = [Path(sys.argv[0]).name, *sys.argv[1:]]
    lines.append("made by: " + shlex.join(words))
    lines += [f"log {_name(log)}: {_hash_of_log(log)}" for log in recordings]
    if platform is not None:
        files = hashes_of(platform.folder)
        text = json.dumps(files, sort_keys=True)
        lines.append(f"platform {platform.name}: sha256 {_sha256(text.encode())[:SHOWN]}")
    return "<footer>" + "".join(f"<p>{escape(line)}</p>" for line in lines) + "</footer>"


def _name(log: Recording) -> str:
    return Path(log.source).name or log.source


def _hash_of_log(log: Recording) -> str:
    """Of its file, or of all files in its folder."""
    path = Path(log.source)
    if path.name == "log.toml":
        path = path.parent
    files = sorted(item for item in path.iterdir() if item.is_file()) if path.is_dir() else [path]
    if not all(file.is_file() for file in files):
        return "from memory"
    size = sum(file.stat().st_size for file in files)
    if size > LARGEST:
        return f"{size / 2**30:.1f} GiB, not hashed"
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return f"sha256 {digest.hexdigest()[:SHOWN]}"


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
