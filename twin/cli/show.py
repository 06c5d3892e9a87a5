"""`twin show LOG`: what is in a log."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from twin.cli.output import LogPart, Restricted

if TYPE_CHECKING:
    from twin.errors import TwinError
    from twin.platform import Platform
    from twin.recording import Recording


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

        from twin.cli.output import print_json
        from twin.report.contents import contents_document, contents_of, contents_words
        from twin.stop import check

        platform, problem = platform_of_log(recording)
        contents = contents_of(str(self.log), recording, platform, problem)
        check()
        print_json(contents_document(contents)) if self.json else print(contents_words(contents))
        refusal = None if platform is None else _refusal(recording, platform)
        if refusal is not None:
            to = sys.stderr if self.json else sys.stdout
            print(f"identify and diagnose will refuse this log: {refusal}", file=to)
        if self.picture is not None:
            from twin.report.picture import draw_contents

            check()
            draw_contents(contents, self.picture)
        return 1 if problem or refusal is not None or contents.misread else 0


def _refusal(recording: "Recording", platform: "Platform") -> "TwinError | None":
    """What the verbs that fit would say of the log instead of an answer."""
    from twin.conventions.time_base import check_times
    from twin.diagnosis import check_logs
    from twin.errors import TwinError

    try:
        check_times(recording, platform)
        check_logs([recording], platform)
    except TwinError as problem:
        return problem
    return None


def platform_of_log(recording: "Recording") -> "tuple[Platform | None, str]":
    """The machine, if it can be found; else why not."""
    from twin.errors import TwinError
    from twin.platform import platform_of

    if recording.provenance.get("platform") is None:
        return None, ""
    try:
        return platform_of(recording), ""
    except TwinError as problem:
        return None, str(problem)
