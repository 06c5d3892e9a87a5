"""The verbs of logs: `twin import`, `twin show`, `twin export`, `twin view`."""

import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from twin.cli.output import LogPart, Restricted

if TYPE_CHECKING:
    from twin.platform import Platform
    from twin.recording import Recording


@dataclass(frozen=True)
class Import:
    """Make a log of recorded files: find streams, units, axes, clocks and frames, with reasons.

    The files are copied into OUT (unless they are in it), together with a log.toml that says how to
    read them. Open questions are comments in log.toml; streams that show the same motion are
    compared with each other. Ends with the output of `twin show OUT`.
    """

    paths: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="FILE [FILE ...] OUT")
    ]
    """Files, or folders of such: text (.csv .tsv .txt .log), .mcap .bag .db3, .ulg, .mat .h5 .tdms
    .xlsx .parquet; and the folder of the log, new or that of the files."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine: one of models/, or the path of a platform folder."""
    rate: Annotated[float | None, tyro.conf.arg(metavar="HZ")] = None
    """Sample rate of tables without times."""
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


@dataclass(frozen=True)
class Show:
    """Print what is in a log: streams with rates, gaps, ranges and noise, repairs, what it states.

    Noise is estimated from the data and compared with what the log or its platform states. A unit,
    an axis, a quaternion or a clock that looks misread is named first, with the lines of log.toml
    that correct it; then the exit code is 1, as it is where the platform cannot be read or other
    verbs will refuse the log.
    """

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG")]
    """A recording (.rrd) or a folder with a log.toml."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine, by name or folder; default: the one that the log names."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="OUT.png|html")] = None
    """Also draw it, one panel for each stream, as a picture or a page."""
    part: Restricted = LogPart()
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Look into it; the exit code."""
        recording = self.part.open(self.log)

        from twin.api import check_log, load, show
        from twin.cli.output import print_json
        from twin.errors import TwinError
        from twin.platform import platform_or_reason
        from twin.stop import check

        if self.platform is None:
            platform, problem = platform_or_reason(recording)
        else:
            platform, problem = load(self.platform), ""
        contents = show(recording, platform)
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


@dataclass(frozen=True)
class Export:
    """Write any log as a folder with log.toml and one file a stream, in SI."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG")]
    """A recording (.rrd) or a folder with a log.toml."""
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT")]
    """The folder to make."""
    format: Literal["csv", "parquet", "mat", "mcap"] = "csv"
    """Format of the streams' files; mcap, a topic of JSON messages for each stream, suits archives:
    it contains its description and needs no viewer to read."""
    truth: bool = False
    """Include the true states of a simulation."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Export; the exit code."""
        from twin.cli.output import LogPart, print_json
        from twin.recording import write_folder

        recording = LogPart().open(self.log)
        files = write_folder(recording, self.out, format=self.format, truth=self.truth)
        rows = {name: len(recording[name]) for name in files}
        if self.json:
            print_json({"folder": self.out, "rows": rows, "repairs": recording.repairs})
            return 0
        for repair in recording.repairs:
            print(f"repaired: {repair}", file=sys.stderr)
        for name, path in files.items():
            print(f"{path}: {rows[name]} rows [{recording[name].unit}]")
        hidden = sum(name.startswith("truth_") for name in recording)
        if hidden and not self.truth:
            print(f"left out: {hidden} streams of true states; --truth writes them too")
        return 0


_VIEWER = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
"""In place of `-m rerun_cli`, which ends with 0 whatever became of the viewer."""


@dataclass(frozen=True)
class View:
    """Open a log in the Rerun viewer; returns when the viewer is closed."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG")]
    """A recording (.rrd) or a folder with a log.toml; of a run of several machines all of them, or
    one, as in two.rrd#whorl1."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine that is drawn, by name or folder; default: the one that the log names."""

    def kept(self) -> str:
        """Of a viewer that was closed with this program."""
        return "the viewer was closed"

    def run(self) -> int:
        """Show it; the exit code."""
        from twin.api import load
        from twin.cli.output import LogPart
        from twin.errors import RecordingError
        from twin.stream.runfile import write_recording

        machine = None if self.platform is None else load(self.platform)
        try:
            recording = LogPart().open(self.log)
        except RecordingError as problem:
            if not problem.machines or machine is not None:
                raise
            return _show(self.log)  # all of them, in one scene
        for repair in recording.repairs:
            print(f"repaired: {repair}", file=sys.stderr)
        if self.log.suffix == ".rrd" and not recording.repairs and machine is None:
            return _show(self.log)
        with TemporaryDirectory() as folder:
            copy = Path(folder) / f"{self.log.resolve().stem}.rrd"
            write_recording(recording, copy, machine or _platform(recording))
            return _show(copy)


def _platform(recording: "Recording") -> "Platform | None":
    """The machine, if it can be found; without it there are plots but no 3D view."""
    from twin.errors import TwinError
    from twin.platform import platform_of

    try:
        return platform_of(recording)
    except TwinError as problem:
        print(f"the machine cannot be drawn: {problem}", file=sys.stderr)
        return None


def _show(path: Path) -> int:
    from twin.errors import TwinError
    from twin.processes import run

    code = run([sys.executable, "-c", _VIEWER, "--bind=127.0.0.1", str(path)])
    if code:
        raise TwinError(
            f"the viewer ended with code {code}, and says why above; "
            "without a display, open the file where there is one"
        )
    return 0
