"""`twin import FILE... OUT`: files of other programs as a log of ours."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Import:
    """Make a log of recorded files: find streams, units, axes, clocks and frames, each with why.

    The files are copied into OUT (unless they are in it), beside a log.toml that says how they are
    read. What is unsure stands there as a comment; what two streams show of each other is held
    against them. Ends with what `twin show OUT` says.
    """

    paths: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="FILE [FILE ...] OUT")
    ]
    """Files, or folders of such: text (.csv .tsv .txt .log), .mcap .bag .db3, .ulg, .mat .h5 .tdms
    .xlsx .parquet; and the folder of the log, new or that of the files."""
    platform: str | None = None
    """The machine: one of models/, or the path of a platform folder."""
    rate: float | None = None
    """Of tables without times [Hz]."""
    json: bool = False
    """Print one JSON document instead of text: that of `twin show`, and what was unsure."""

    def run(self) -> int:
        """Look, write, read, show; the exit code."""
        from twin.errors import UsageError

        if len(self.paths) < 2:
            raise UsageError("`twin import` needs files and the folder of the log: FILE OUT")
        if self.rate is not None and not 0.0 < self.rate < float("inf"):
            raise UsageError(f"--rate is {self.rate:g} Hz; it must be above 0")

        from twin.api import imported, show
        from twin.cli.output import LogPart, print_json

        *files, folder = self.paths
        done = imported(files, folder, platform=self.platform, rate=self.rate)
        unsure = [
            (proposal.stream, question)
            for proposal in done.proposals
            for question in proposal.unsure
        ]
        recording = LogPart().open(folder)
        contents = show(recording)
        if self.json:
            document = contents.document()
            open_questions = [{"stream": name, "what": what} for name, what in unsure]
            print_json({**document, "unsure": open_questions, "not_taken": done.unread})
            return 0
        print(f"{folder / 'log.toml'} is written, with the reason for each line.")
        for stream, question in unsure:
            print(f"Unsure of {stream}: {question}.")
        for sentence in done.unread:
            print(f"{sentence}.")
        print(f"\n{contents}")
        return 0
