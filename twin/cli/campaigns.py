"""The verbs of campaigns: `twin campaign`, `twin report`, `twin replay`."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from twin.cli.output import TrustedFolders


@dataclass(frozen=True)
class Campaign:
    """Fly thousands of closed-loop runs, dispersed as a file states; docs/campaigns.md lists its
    keys.

    A shard of runs is written whole or not at all, so a campaign that was killed continues with
    --resume and loses no run. `twin report DIR` evaluates it, `twin replay DIR RUN` flies one run
    again.
    """

    spec: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SPEC.toml")]
    """The specification."""
    folder: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[DIR]")] = None
    """Folder for the results; not needed with --dry-run."""
    resume: bool = False
    """Continue the campaign in DIR, which may also be empty or complete."""
    workers: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of processes, by default one per core. The results do not depend on it."""
    cluster: Annotated[str, tyro.conf.arg(metavar="tcp://HOST:PORT")] = ""
    """Fly on the workers of this Dask scheduler instead of this computer, to the same bytes."""
    dry_run: bool = False
    """Only print the number of runs, the time and the disk space, measured on a short probe."""
    trust: TrustedFolders = ()
    """Run the control laws and effects that the specification names, where they lie in these
    folders. They are programs and do whatever they say; shipped and installed ones always run."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Fly; 1 where no run came to its end."""
        from twin.api import fly_campaign, forecast
        from twin.cli.output import print_json, progress, tell
        from twin.errors import UsageError

        if self.workers is not None and self.workers < 1:
            raise UsageError(f"workers is {self.workers}; give 1 or more")
        if self.cluster and (self.workers is not None or self.dry_run):
            other = "--dry-run" if self.dry_run else "--workers"
            raise UsageError(
                f"--cluster does not go with {other}; to foresee a cluster of N workers like this "
                "machine's cores, say --dry-run --workers N"
            )
        if self.folder is None and not self.dry_run:
            raise UsageError("no folder for the results is given: twin campaign SPEC.toml DIR")
        workers = self.workers or _cores()
        if self.dry_run:
            expected = forecast(self.spec, workers=workers, trust=self.trust)
            print_json(expected.document()) if self.json else print(expected)
            return 0
        assert self.folder is not None
        with progress() as say:
            runs = fly_campaign(
                self.spec,
                self.folder,
                workers=workers,
                cluster=self.cluster,
                resume=self.resume,
                trust=self.trust,
                say=say,
            )
        for note in runs.notes:
            tell(note)
        if self.json:
            print_json(
                {
                    "runs": runs.runs,
                    "flown": runs.flown,
                    "ended": runs.ended,
                    "folder": self.folder,
                    "recordings": runs.recordings,
                }
            )
        else:
            counted = ", ".join(f"{count} {end}" for end, count in runs.ended.items())
            print(f"{runs.runs} runs, {runs.flown} of them flown now: {counted}")
            if runs.recordings:
                print(f"{len(runs.recordings)} recorded in {runs.recordings[0].parent}")
            print(f"what came of it: `twin report {self.folder}`")
        return 0 if set(runs.ended) - {"failed"} else 1

    def kept(self) -> str:
        """The shards that a stopped campaign has written, and how to continue."""
        from twin.campaigns.folder import METRICS

        if self.folder is None or not (self.folder / METRICS).is_dir():
            return "nothing was flown; the same command begins anew"
        shards = len(list((self.folder / METRICS).glob("shard-*.parquet")))
        return (
            f"{shards} shards of runs are kept in {self.folder}; "
            f"`twin campaign {self.spec} {self.folder} --resume` goes on"
        )


def _cores() -> int:
    """Those that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True)
class Report:
    """Evaluate a campaign: distributions, what they depend on, worst runs, comparisons.

    Writes DIR/report.html with figures and DIR/report.md. A campaign that is still flying is
    evaluated as far as it has come.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Folder of the campaign."""
    against: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Another campaign to compare with, for the arms that both have."""
    html: Annotated[Path | None, tyro.conf.arg(metavar="F.html")] = None
    """File for the page instead, with the table next to it; existing files are overwritten."""
    figures: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Write the page's figures as SVG and PDF and its tables as CSV into a folder."""
    trust: TrustedFolders = ()
    """Run the control laws and effects that the specification names, where they lie in these
    folders. They are programs and do whatever they say; shipped and installed ones always run."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Read, compute, write."""
        from twin.api import results
        from twin.cli.output import print_json, progress
        from twin.files import check_folder, check_writable, write_whole
        from twin.report.campaign_page import write_campaign_page
        from twin.report.campaign_words import markdown
        from twin.report.results import write_figures

        page = self.html or self.folder / "report.html"
        check_writable(page, ".html")
        if self.figures is not None:
            check_folder(self.figures)
        with progress() as say:
            result = results(self.folder, self.against, trust=self.trust, say=say)
            say("drawing")
            write_campaign_page(page, result)
            write_whole(page.with_suffix(".md"), markdown(result))
            if self.figures is not None:
                write_figures(result, self.figures)
        if self.json:
            print_json({**result.document(), "report": page})
        else:
            print(f"{result}\nreport: {page}")
            if self.figures is not None:
                print(f"figures: {self.figures}")
        return 0


@dataclass(frozen=True)
class ReplayVerb:
    """Fly one run of a campaign alone, to the same bits, and record it in full."""

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Folder of the campaign."""
    run_number: Annotated[int, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Number of the run, from 0."""
    rrd: Annotated[Path | None, tyro.conf.arg(metavar="OUT.rrd")] = None
    """Record into this file; an existing file is overwritten."""
    trust: TrustedFolders = ()
    """Run the control laws and effects that the specification names, where they lie in these
    folders. They are programs and do whatever they say; shipped and installed ones always run."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Fly; 1 where it is not what the campaign wrote."""
        from twin.api import replay
        from twin.cli.output import print_json

        replayed = replay(self.folder, self.run_number, rrd=self.rrd, trust=self.trust)
        if self.json:
            print_json({**replayed.document(), "recording": self.rrd})
        else:
            print(replayed)
            if self.rrd is not None:
                print(f"recorded in {self.rrd}: look at it with `twin view {self.rrd}`")
        return 1 if replayed.differs else 0
