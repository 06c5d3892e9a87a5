"""How pages and figures look, what a page is made of, and the provenance in its foot."""

import csv
import hashlib
import json
import os
import re
import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date
from html import escape
from importlib.metadata import version
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from twin.files import whole, write_whole
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
.drawn { overflow-x: auto; }
.drawn svg { width: 100%; height: auto; display: block; background: #fff; border-radius: 4px; }
@media (prefers-color-scheme: dark) { .drawn svg { filter: invert(.91) hue-rotate(180deg); } }
figcaption { color: var(--soft); font-size: .9rem; margin-top: .3rem; }
table { border-collapse: collapse; width: 100%; font-size: .92rem;
  font-variant-numeric: tabular-nums; }
th { text-align: left; color: var(--soft); font-weight: 500; border-bottom: 1px solid var(--soft); }
th, td { padding: .4rem .8rem .4rem 0; vertical-align: top; }
td { border-bottom: 1px solid var(--line); }
.wide { overflow-x: auto; } .wide td, .wide th { overflow-wrap: normal; }
footer { border-top: 1px solid var(--line); color: var(--soft); font-size: .82rem;
  margin-top: 4rem; padding-top: .8rem; } footer p { margin: .15rem 0; }
pre { font: .85rem/1.5 "DejaVu Sans Mono", Menlo, Consolas, monospace; overflow-x: auto; }
details { margin-top: 2rem; } summary { cursor: pointer; font-weight: 650; font-size: 1.25rem; }
@media (max-width: 40rem) { main { padding: 1.5rem 1rem 3rem; } h1 { font-size: 1.45rem; }
  .drawn svg { width: 40rem; } .wide td, .wide th { min-width: 5.5rem; }
  pre { white-space: pre-wrap; } }
@media print { .drawn svg { filter: none; } }
"""


def page(title: str, body: str) -> str:
    """A self-contained HTML page; paths below the working folder are relative to it."""
    body = body.replace(escape(f"{Path.cwd()}{os.sep}"), "")
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
    """A figure, or its SVG text, with its caption; on a phone it is scrolled sideways."""
    text = drawn if isinstance(drawn, str) else svg(drawn)
    under = f"<figcaption>{_prose(caption)}</figcaption>" if caption else ""
    return f"<figure><div class='drawn'>{text}</div>{under}</figure>"


@dataclass(frozen=True)
class Drawing:
    """A figure of a page."""

    name: str
    """Of its file, without an ending."""
    figure: Figure
    caption: str = ""


@dataclass(frozen=True)
class PageTable:
    """A table of a page; without rows it is left out."""

    name: str
    """Of its file, without an ending."""
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


Part = str | Drawing | PageTable
"""Of a page: HTML, a figure or a table."""


def opened(title: str, under: str, answer: str, rest: Sequence[str]) -> list[Part]:
    """How a page begins: title, subject, the answer in a sentence, and what qualifies it."""
    parts: list[Part] = [
        f"<h1>{escape(title)}</h1>",
        f"<p class='under'>{escape(under)}</p>",
        f"<p class='verdict'>{_prose(answer)}</p>",
    ]
    return [*parts, bullets(rest)] if rest else parts


def rendered(parts: Iterable[Part]) -> str:
    """Parts of a page as HTML."""
    return "\n".join(map(_rendered, parts))


def _rendered(part: Part) -> str:
    if isinstance(part, Drawing):
        return framed(part.figure, part.caption)
    if isinstance(part, PageTable):
        return table(part.head, part.rows) if part.rows else ""
    return part


def write_parts(folder: Path, parts: Iterable[Part]) -> list[Path]:
    """Write the figures of a page as SVG and PDF and its tables as CSV; a folder that is missing is
    made, and files of these names are written anew.

    Returns:
        The files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    for part in parts:
        if isinstance(part, Drawing):
            for ending in ("svg", "pdf"):
                path = folder / f"{part.name}.{ending}"
                date_of = {"Date": None} if ending == "svg" else {"CreationDate": None}
                with mpl.rc_context(FIGURE), whole(path) as file:
                    part.figure.savefig(file, format=ending, metadata=date_of)
                written.append(path)
        elif isinstance(part, PageTable) and part.rows:
            path, text = folder / f"{part.name}.csv", StringIO()
            csv.writer(text, lineterminator="\n").writerows([part.head, *part.rows])
            write_whole(path, text.getvalue())
            written.append(path)
    return written


def bullets(items: Sequence[str]) -> str:
    """Sentences, each a point."""
    return "<ul>" + "".join(f"<li>{_prose(item)}</li>" for item in items) + "</ul>"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Cells as text."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(typeset(cell))}</td>" for cell in row) + "</tr>"
        for row in rows
    )
    rows_and_head = f"<thead><tr>{top}</tr></thead><tbody>{body}</tbody>"
    return f"<div class='wide'><table>{rows_and_head}</table></div>"


def _prose(text: str) -> str:
    """Sentences as HTML; what stands in backticks is code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(typeset(text)))


_MICRO = re.compile(r"(?<=[\d).] )u(?=m\b|N m\b|s\b|T\b)")
"""The u of a micro-unit behind a number."""


def typeset(text: str) -> str:
    """Plain signs as print has them."""
    plain = text.replace("+-", "±").replace("^2", "²").replace("^3", "³").replace(" -", " −")
    return _MICRO.sub("µ", plain)


LARGEST = 512 * 2**20
"""Bytes of a log up to which it is hashed: a person waits for the page."""
SHOWN = 12
"""Digits of a hash."""


def foot(
    recordings: Sequence[Recording], platforms: Sequence[Platform], facts: Sequence[str] = ()
) -> str:
    """Lines as HTML: version and date, the command, a hash of each log and of each machine's files.

    Args:
        recordings: the logs of the page.
        platforms: the machines.
        facts: further lines.
    """
    lines = [f"airbearing-twin {version('airbearing-twin')}, {date.today().isoformat()}"]
    words = [Path(sys.argv[0]).name, *map(bare, sys.argv[1:])]
    lines.append("made by: " + shlex.join(words))
    for log in recordings:
        digest = _hash_of_log(log)
        lines.append(f"log {_name(log)}: {digest}" if digest else "log: from memory")
    for platform in platforms:
        text = json.dumps(hashes_of(platform.folder), sort_keys=True)
        lines.append(f"platform {platform.name}: {hash_of(text.encode())}")
    lines += facts
    return "<footer>" + "".join(f"<p>{escape(line)}</p>" for line in lines) + "</footer>"


def bare(word: str) -> str:
    """A word of a command line, of an absolute path its name alone: a page may go elsewhere."""
    return Path(word).name if Path(word).is_absolute() else word


def _name(log: Recording) -> str:
    return Path(log.source).name or log.source


def _hash_of_log(log: Recording) -> str:
    """Of its file, or of all files in its folder; empty where there is none."""
    path = Path(log.source)
    if path.name == "log.toml":
        path = path.parent
    files = sorted(item for item in path.iterdir() if item.is_file()) if path.is_dir() else [path]
    if not all(file.is_file() for file in files):
        return ""
    size = sum(file.stat().st_size for file in files)
    if size > LARGEST:
        return f"{size / 2**30:.1f} GiB, not hashed"
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return f"sha256 {digest.hexdigest()[:SHOWN]}"


def hash_of(data: bytes) -> str:
    """The first digits of a SHA-256."""
    return f"sha256 {hashlib.sha256(data).hexdigest()[:SHOWN]}"
