"""`twin reproduce [PAPER]`: the papers' tables and figures compared with ours."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

_CHECKOUT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Reproduce:
    """Compute what five papers published and say where ours agrees.

    Every value is computed on the spot; when it agrees was fixed beforehand, in
    docs/reproduction.toml. Writes a table and a page with figures; of pages that exist, the
    sections of other papers stay as they are.
    """

    paper: Annotated[tyro.conf.Positional[str | None], tyro.conf.arg(metavar="[PAPER]")] = None
    """One alone, 000 to 004; default: all."""
    jobs: int = 2
    """Parts computed at the same time, one per core."""
    table: Annotated[Path, tyro.conf.arg(metavar="OUT.md")] = Path("docs/reproduction.md")
    """Where the table goes."""
    report: Annotated[Path, tyro.conf.arg(metavar="OUT.html")] = Path("runs/reproduction.html")
    """Where the page with the figures goes."""
    json: bool = False
    """Print one JSON document instead of sentences."""

    def kept(self) -> str:
        """Of a reproduction that was stopped."""
        return f"{self.table} and {self.report} are as they were"

    def run(self) -> int:
        """Compute, write, print; 1 where a part failed."""
        from twin.cli.output import print_json
        from twin.errors import TwinError, UsageError
        from twin.files import check_writable

        if not _CHECKOUT.joinpath("docs", "reproduction.toml").is_file():
            raise TwinError(
                "this installation has no folder papers/, which computes the papers' figures; get "
                "the source archive or the repository of airbearing-twin and run `pip install -e .`"
                " in it"
            )
        from papers.page import summary, write_html, write_markdown
        from papers.rows import paper_named, read_papers
        from papers.run import parts_of, reproduce

        if self.jobs < 1:
            raise UsageError(f"--jobs is {self.jobs}; give 1 or more")
        papers = read_papers()
        chosen = papers if self.paper is None else (paper_named(papers, self.paper),)
        check_writable(self.table, ".md")
        check_writable(self.report, ".html")
        result = [
            reproduce(paper, parts_of(paper.number), jobs=self.jobs, say=_say) for paper in chosen
        ]
        order = [paper.number for paper in papers]
        write_markdown(self.table, result, order)
        write_html(self.report, result, order)
        rows = [row for item in result for row in item.rows]
        if self.json:
            print_json([row.document() for row in rows])
        else:
            for row in rows:
                print(f"{row.row.id:<42} {row.verdict}")
            print(f"{summary(rows)} Wrote {self.table} and {self.report}.")
        failures = [failure for item in result for failure in item.failures]
        for failure in failures:
            print(f"twin: {failure}", file=sys.stderr)
        return 1 if failures else 0


def _say(doing: str) -> None:
    print(doing, file=sys.stderr, flush=True)
