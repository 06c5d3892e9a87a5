"""`twin campaign`: thousands of runs that differ as a file says."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

if TYPE_CHECKING:
    from twin.campaigns.execute import Forecast, Progress
    from twin.campaigns.folder import Folder
    from twin.campaigns.spec import Spec


@dataclass(frozen=True)
class Campaign:
    """Fly thousands of closed-loop runs that differ as a file says; docs/campaigns.md has its keys.

    A shard of runs is written whole or not at all, so a campaign that was killed goes on with
    --resume and loses no run. `twin report DIR` says what came of it, `twin replay DIR RUN` flies
    one run again.
    """

    spec: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SPEC.toml")]
    """What is flown."""
    folder: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[DIR]")] = None
    """Where the results go; a --dry-run needs none."""
    resume: bool = False
    """Go on with what DIR holds; no error where it holds nothing yet, or all."""
    workers: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Processes; by default one a core. The results do not depend on it."""
    cluster: Annotated[str, tyro.conf.arg(metavar="tcp://HOST:PORT")] = ""
    """Fly on the workers of that Dask scheduler in place of this machine, to the same bytes."""
    dry_run: bool = False
    """Only say how many runs, how long and how much disk, measured on a short probe."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Fly; 1 where no run came to its end."""
        from twin.campaigns.execute import forecast
        from twin.campaigns.folder import Folder
        from twin.campaigns.read import read_spec
        from twin.campaigns.replay import record_kept
        from twin.cli.output import print_json, progress
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
        spec = read_spec(self.spec)
        if self.dry_run:
            told = forecast(spec, workers)
            if self.json:
                print_json(_document(told))
            else:
                print("\n".join(_foretold(told, spec, workers)))
            return 0
        assert self.folder is not None
        folder = Folder(self.folder)
        with progress() as say:
            done = self._flown(spec, folder, workers, say)
            recorded = record_kept(spec, folder, say)
        ends = _ends(folder, spec)
        if self.json:
            print_json(
                {
                    "runs": spec.runs,
                    "flown": done.flown,
                    "ended": ends,
                    "folder": self.folder,
                    "recordings": recorded,
                }
            )
        else:
            counted = ", ".join(f"{count} {end}" for end, count in ends.items())
            print(f"{spec.runs} runs, {done.flown} of them flown now: {counted}")
            if recorded:
                print(f"{len(recorded)} recorded in {recorded[0].parent}")
            print(f"what came of it: `twin report {self.folder}`")
        return 0 if set(ends) - {"failed"} else 1

    def kept(self) -> str:
        """What is there of a campaign that was stopped, and how it goes on."""
        from twin.campaigns.folder import METRICS

        if self.folder is None or not (self.folder / METRICS).is_dir():
            return "nothing was flown; the same command begins anew"
        shards = len(list((self.folder / METRICS).glob("shard-*.parquet")))
        return (
            f"{shards} shards of runs are kept in {self.folder}; "
            f"`twin campaign {self.spec} {self.folder} --resume` goes on"
        )

    def _flown(self, spec: "Spec", folder: "Folder", workers: int, say: Any) -> "Progress":
        from twin.campaigns.execute import execute

        if not self.cluster:
            return execute(spec, folder, workers=workers, tell=say, resume=self.resume)
        from twin.campaigns.cluster import connected
        from twin.campaigns.folder import arithmetic
        from twin.cli.output import tell

        with connected(self.cluster) as cluster:
            done = execute(spec, folder, workers=0, tell=say, resume=self.resume, cluster=cluster)
        if cluster.arithmetics - {arithmetic()}:
            tell(
                "processors of another kind than this machine's flew some of it: their last bits "
                "are their own, so these are not this machine's bytes, and `twin replay` says so"
            )
        return done


def _cores() -> int:
    """Those that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _ends(folder: "Folder", spec: "Spec") -> dict[str, int]:
    from collections import Counter

    from twin.campaigns.results import read_rows

    count: Counter[str] = Counter()
    for shard in range(spec.shards):
        count.update(read_rows(folder.shard(shard), ["ended"])["ended"].to_pylist())
    return dict(sorted(count.items()))


def _foretold(forecast: "Forecast", spec: "Spec", workers: int) -> list[str]:
    arms = ", ".join(arm.name for arm in spec.arms)
    most = "at most " if forecast.at_most else "about "
    ways = f"{forecast.points} combination{'s' * (forecast.points > 1)} ({arms})"
    lines = [
        f"{forecast.runs} runs of {spec.duration:g} s in {forecast.shards} "
        f"shards: {forecast.samples} samples "
        f"of {ways}, {spec.sampling}, seed {spec.seed}",
        *(f"  {factor}" for factor in forecast.factors),
        *(f"  {item} (the same in all runs)" for item in forecast.fixed),
        f"{most}{forecast.seconds:.3g} s on {workers} processes of this machine; "
        "processes take a few "
        "seconds to come up",
        f"about {forecast.bytes / 1e6:.3g} MB of metrics",
    ]
    if forecast.at_most:
        lines.append(
            "and what its identifications take, which no short probe shows: some ten a run, "
            "each of seconds"
        )
    if spec.keep.runs or spec.keep.worst:
        lines.append(f"and up to {len(spec.keep.runs) + spec.keep.worst} recordings")
    return lines


def _document(forecast: "Forecast") -> dict[str, Any]:
    from dataclasses import asdict

    return asdict(forecast)
