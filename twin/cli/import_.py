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

        from twin.cli.output import LogPart, print_json
        from twin.cli.show import platform_of_log
        from twin.intake import import_files
        from twin.platform import load_platform
        from twin.report.contents import contents_document, contents_of, contents_words

        *files, folder = self.paths
        platform = None if self.platform is None else load_platform(self.platform)
        name = self.platform
        if name is not None and Path(name).exists():
            name = str(Path(name).resolve())
        done = import_files(files, folder, platform, name, self.rate)
        unsure = [
            (proposal.stream, question)
            for proposal in done.proposals
            for question in proposal.unsure
        ]
        recording = LogPart().open(folder)
        contents = contents_of(str(folder), recording, *platform_of_log(recording))
        if self.json:
            document = contents_document(contents)
            open_questions = [{"stream": name, "what": what} for name, what in unsure]
            print_json({**document, "unsure": open_questions, "not_taken": done.unread})
            return 0
        print(f"{folder / 'log.toml'} is written, with the reason for each line.")
        for stream, question in unsure:
            print(f"Unsure of {stream}: {question}.")
        for sentence in done.unread:
            print(f"{sentence}.")
        print(f"\n{contents_words(contents)}")
        return 0
