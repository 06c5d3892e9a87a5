"""`twin report`: a campaign's answers."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Report:
    """Say what came of a campaign: distributions, what they depend on, worst runs, comparisons.

    Writes DIR/report.html with figures and DIR/report.md; of a campaign that still goes on, what is
    there so far.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Of the campaign."""
    against: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Another campaign to hold it against, arm by arm where both have it."""
    html: Annotated[Path | None, tyro.conf.arg(metavar="F.html")] = None
    """The page goes here instead, the table beside it; those that exist are written anew."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Read, compute, write."""
        from twin.api import results
        from twin.cli.output import print_json, progress
        from twin.files import check_writable, write_whole
        from twin.report.campaign_page import write_campaign_page
        from twin.report.campaign_words import markdown

        page = self.html or self.folder / "report.html"
        check_writable(page, ".html")
        with progress() as say:
            result = results(self.folder, self.against, say=say)
            say("drawing")
            write_campaign_page(page, result)
            write_whole(page.with_suffix(".md"), markdown(result))
        if self.json:
            print_json({**result.document(), "report": page})
        else:
            print(f"{result}\nreport: {page}")
        return 0
