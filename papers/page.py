"""The two pages: a table of every paper in Markdown, and one HTML file that has the figures too.

Each paper is a section of its own. A page that exists keeps the sections of papers that were not
computed anew: nothing else remembers them.
"""

import re
from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path

from papers.rows import Judged
from papers.run import Reproduced
from twin.files import write_whole
from twin.report.style import bullets, framed, page, table

TITLE = "The papers reproduced"

ABOUT = (
    "Each row was written down with its criterion before its value was computed: docs/reproduction."
    "toml. `twin reproduce` computes every value on the spot, with the shipped machines and laws; "
    "numbers are in SI units and in our frames (z up), intervals are 95 %. A row agrees, differs "
    "as its file said beforehand that it may (explained), or differs."
)

HEAD = ("item", "published", "ours", "criterion", "status", "note")

_MARKDOWN = re.compile(r"^## (\w+):.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
_HTML = re.compile(r"<section id='paper-(\w+)'>.*?</section>\n", re.DOTALL)


def write_markdown(path: Path, reproduceds: Sequence[Reproduced], order: Sequence[str]) -> None:
    """Write docs/reproduction.md, or replace sections of it.

    Args:
        path: of the page.
        reproduceds: the papers that were computed.
        order: numbers of all papers.
    """
    sections = _kept(path, _MARKDOWN) | {item.paper.number: _markdown(item) for item in reproduceds}
    body = "\n".join(sections[number].strip() + "\n" for number in order if number in sections)
    _write(path, f"# {TITLE}\n\n{ABOUT}\n\n{body}")


def write_html(path: Path, reproduceds: Sequence[Reproduced], order: Sequence[str]) -> None:
    """Write the page with the figures, or replace sections of it; see `write_markdown`."""
    sections = _kept(path, _HTML) | {item.paper.number: _html(item) for item in reproduceds}
    about = ABOUT.replace("`", "")
    body = "".join(sections[number] for number in order if number in sections)
    _write(path, page(TITLE, f"<h1>{TITLE}</h1>\n<p class='under'>{escape(about)}</p>\n{body}"))


def summary(rows: Sequence[Judged]) -> str:
    """How many agree."""
    count = Counter(row.verdict for row in rows)
    counts = ", ".join(f"{verdict} {count[verdict]}" for verdict in sorted(count))
    return f"{len(rows)} rows: {counts}."


def cells(judged: Judged) -> tuple[str, ...]:
    """Of a row, as `HEAD` names them."""
    row = judged.row
    published = row.published if isinstance(row.published, str) else f"{row.published:.6g}"
    assumed = f"Assumed: {row.assumed}." if row.assumed else ""
    note = " ".join(filter(None, (judged.note, assumed)))
    return row.item, published, _ours(judged), row.criterion, judged.verdict, note


def _ours(judged: Judged) -> str:
    ours = judged.ours
    if ours is None:
        return "none"
    if isinstance(ours.value, bool):
        return "yes" if ours.value else "no"
    if ours.low is None or ours.high is None:
        return f"{ours.value:.4g}"
    return f"{ours.value:.4g} ({ours.low:.4g} to {ours.high:.4g})"


def _heading(reproduced: Reproduced) -> str:
    return (
        f"{reproduced.paper.number}: {', '.join(reproduced.paper.facts)}, on "
        f"`{reproduced.paper.platform}`"
    )


def _markdown(reproduced: Reproduced) -> str:
    lines = [f"## {_heading(reproduced)}", "", summary(reproduced.rows), ""]
    lines += ["| " + " | ".join(HEAD) + " |", "| " + " | ".join("---" for _ in HEAD) + " |"]
    for judged in reproduced.rows:
        plain = (" ".join(cell.replace("|", "\\|").split()) for cell in cells(judged))
        lines.append("| " + " | ".join(plain) + " |")
    return "\n".join(lines) + "\n"


def _html(reproduced: Reproduced) -> str:
    parts = [
        f"<section id='paper-{reproduced.paper.number}'>",
        f"<h2>{escape(_heading(reproduced).replace('`', ''))}</h2>",
        bullets([summary(reproduced.rows)]),
        table(HEAD, [cells(judged) for judged in reproduced.rows]),
        *(framed(svg, caption) for caption, svg in reproduced.figures.items()),
        "</section>\n",
    ]
    return "\n".join(parts)


def _kept(path: Path, section: re.Pattern[str]) -> dict[str, str]:
    """Number -> section of a page that exists."""
    if not path.exists():
        return {}
    return {result[1]: result[0] for result in section.finditer(path.read_text(encoding="utf-8"))}


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text)
