"""`twin show LOG`: what is in a log."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from twin.cli.output import LogPart, Restricted


@dataclass(frozen=True)
class Show:
    """Print what is in a log: streams with rates, gaps, ranges and noise, repairs, what it states.

    Noise is estimated from the data, and held against what the log or its platform states. A unit,
    an axis, a quaternion or a clock that looks misread is named first, with the lines of log.toml
    that put it right; then the exit code is 1, as it is where the platform cannot be read or other
    verbs will refuse the log.
    """

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG")]
    """A recording (.rrd) or a folder with a log.toml."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="OUT.png|html")] = None
    """Draw it, too, one panel a stream: a picture, or a page."""
    part: Restricted = LogPart()
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Look into it; the exit code."""
        recording = self.part.open(self.log)

        from twin.api import check_log, show
        from twin.cli.output import print_json
        from twin.errors import TwinError
        from twin.platform import platform_or_reason
        from twin.stop import check

        platform, problem = platform_or_reason(recording)
        contents = show(recording)
        check()
        print_json(contents.document()) if self.json else print(contents)
        refused = False
        if platform is not None:
            try:
                check_log(recording, platform)
            except TwinError as refusal:
                refused = True
                to = sys.stderr if self.json else sys.stdout
                print(f"identify and diagnose will refuse this log: {refusal}", file=to)
        if self.picture is not None:
            from twin.report.picture import draw_contents

            check()
            draw_contents(contents, self.picture)
        return 1 if problem or refused or contents.misread else 0
