"""A campaign flown shard by shard in worker processes, and its forecast from a short probe."""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.campaigns.distribution import Fixed
from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.folder import Folder, arithmetic
from twin.campaigns.replay import record_kept
from twin.campaigns.results import read_rows, size_of, table_of
from twin.campaigns.spec import Spec
from twin.campaigns.worker import Done, begin, fly, fly_shard, written_shard
from twin.errors import TwinError
from twin.files import trusted_folders
from twin.processes import Pool, first_completed
from twin.stop import check, listening
from twin.units import span

if TYPE_CHECKING:
    from twin.campaigns.cluster import Cluster


ATTEMPTS = 3
"""Times that processes may die before one shard is done."""


OTHER_PROCESSORS = (
    "processors of another kind than this machine's flew some of it: their last bits "
    "are their own, so these are not this machine's bytes, and `twin replay` says so"
)


class LostWorkers(TwinError):
    """Processes that died again and again."""


@dataclass
class Progress:
    """How far it is."""

    total: int
    """Runs of the campaign."""
    before: int
    """Of these, flown before this process began."""
    flown: int = 0
    failed: int = 0
    started: float = 0.0

    def words(self, instant: float) -> str:
        """Runs, rate, time left."""
        done = self.before + self.flown
        text = f"{done} of {self.total} runs"
        if self.flown:
            rate = self.flown / max(instant - self.started, 1e-9)
            text += f", {rate:.3g} runs/s, {span((self.total - done) / rate)} left"
        return text + (f", {self.failed} failed" if self.failed else "")


def execute(
    spec: Spec,
    folder: Folder,
    *,
    workers: int,
    tell: Callable[[str], None],
    resume: bool = False,
    cluster: "Cluster | None" = None,
) -> Progress:
    """Fly what is missing; returns when all of it is written.

    Args:
        spec: the campaign.
        folder: of its results.
        workers: processes; 1 flies in this one.
        tell: takes each state of progress.
        resume: whether the folder may hold part of it, or all.
        cluster: flies in place of processes of this machine.

    Raises:
        CampaignError: the folder holds something else, somebody flies there, or its disk is full.
        LostWorkers: processes died again and again.
        ClusterError: as `Cluster.fly`.
        Stopped: a stop was requested; every shard that is written is whole.
    """
    with folder.owned(), listening():
        folder.begin(spec, resume=resume)
        missing = folder.missing(spec)
        missing_runs = sum(len(spec.runs_of(shard)) for shard in missing)
        progress = Progress(spec.runs, spec.runs - missing_runs, started=time.monotonic())
        tell(progress.words(time.monotonic()))
        if cluster is not None:
            shards = cluster.fly(spec, folder, missing, tell)
        elif workers <= 1 or len(missing) <= 1:
            shards = (fly_shard(spec, folder, shard) for shard in missing)
        else:
            shards = _by_processes(folder, missing, min(workers, len(missing)))
        for done in shards:
            progress.flown += done.runs
            progress.failed += done.failed
            tell(progress.words(time.monotonic()))
            check()
    return progress


@dataclass(frozen=True)
class CampaignRuns:
    """What became of a campaign's runs."""

    runs: int
    """Of the campaign."""
    flown: int
    """Of these, by the call that returned this."""
    ended: Mapping[str, int]
    """How they ended -> how many of all."""
    folder: Path
    recordings: tuple[Path, ...]
    """Of the runs that `[keep]` names."""
    notes: tuple[str, ...] = ()
    """What its user should know of the results, a sentence each."""


def fly_spec(
    spec: Spec,
    folder: Folder,
    *,
    workers: int,
    cluster: str = "",
    resume: bool = False,
    tell: Callable[[str], None],
) -> CampaignRuns:
    """Fly what is missing of a campaign, and record the runs that it keeps.

    Args:
        spec: the campaign.
        folder: of its results.
        workers: processes of this machine.
        cluster: address of a Dask scheduler, whose workers fly instead.
        resume: whether the folder may hold part of it, or all.
        tell: takes each state of progress.

    Raises:
        TwinError: as `execute`, or a cluster that cannot be reached.
    """
    if cluster:
        from twin.campaigns.cluster import connected  # Dask is an extra

        with connected(cluster) as workplace:
            done = execute(spec, folder, workers=0, tell=tell, resume=resume, cluster=workplace)
        notes = (OTHER_PROCESSORS,) if workplace.arithmetics - {arithmetic()} else ()
    else:
        done = execute(spec, folder, workers=workers, tell=tell, resume=resume)
        notes = ()
    recorded = record_kept(spec, folder, tell)
    ended: Counter[str] = Counter()
    for shard in range(spec.shards):
        ended.update(read_rows(folder.shard(shard), ["ended"])["ended"].to_pylist())
    return CampaignRuns(
        spec.runs, done.flown, dict(sorted(ended.items())), folder.path, tuple(recorded), notes
    )


def _by_processes(folder: Folder, shards: Iterable[int], workers: int) -> Iterable[Done]:
    """Shards as they are done; at most one more than there are processes is submitted at a time."""
    waiting = list(shards)
    waiting.reverse()
    died = 0
    while waiting:
        folder.sweep()
        pool = Pool(workers, begin, (str(folder.path), trusted_folders()))
        submitted: dict[Future[Done], int] = {}
        try:
            while waiting or submitted:
                while waiting and len(submitted) < workers + 1:
                    # a pool that is broken takes none: the shard must still be waiting then
                    submitted[pool.submit(fly, waiting[-1])] = waiting[-1]
                    waiting.pop()
                for future in first_completed(submitted):
                    done = future.result()
                    del submitted[future]
                    died = 0
                    yield done
        except BrokenProcessPool:
            # one that was written before the process died is not flown twice, but told
            written = {shard for shard in submitted.values() if folder.shard(shard).is_file()}
            lost = sorted(set(submitted.values()) - written)
            died = 1 if written else died + 1
            if died >= ATTEMPTS:
                raise LostWorkers(
                    f"processes died {died} times over shards {lost}: is there memory "
                    "enough? Fewer workers need less; --resume goes on"
                ) from None
            waiting += reversed(lost)
            yield from (written_shard(folder, shard) for shard in sorted(written))
        finally:
            pool.end()
            folder.sweep()  # of what a worker had begun to write


PROBE = 64
"""Runs of a probe."""
SHORT, LONG = 0.5, 2.5
"""Of its two flights, whose difference is the cost of flying [s]."""


@dataclass(frozen=True)
class Forecast:
    """What a campaign will take."""

    runs: int
    shards: int
    arms: int
    points: int
    """Combinations of arms and grids."""
    samples: int
    """Of each combination."""
    factors: tuple[str, ...]
    """With their distributions, in words."""
    fixed: tuple[str, ...]
    """What is the same in all runs, of what the specification gives."""
    seconds: float
    """On all workers together; of a balancing at most, and without its identifications."""
    at_most: bool
    bytes: int
    """Of the metrics. Recordings come on top."""

    spec: Spec = field(repr=False)
    workers: int

    def document(self) -> dict[str, Any]:
        """What `twin campaign --dry-run --json` prints."""
        hidden = ("spec", "workers")
        return {
            item.name: getattr(self, item.name) for item in fields(self) if item.name not in hidden
        }

    def __str__(self) -> str:
        """What `twin campaign --dry-run` prints."""
        spec = self.spec
        arms = ", ".join(arm.name for arm in spec.arms)
        bound = "at most " if self.at_most else "about "
        ways = f"{self.points} combination{'s' * (self.points > 1)} ({arms})"
        lines = [
            f"{self.runs} runs of {spec.duration:g} s in {self.shards} shards: {self.samples} "
            f"samples of {ways}, {spec.sampling}, seed {spec.seed}",
            *(f"  {factor}" for factor in self.factors),
            *(f"  {item} (the same in all runs)" for item in self.fixed),
            f"{bound}{self.seconds:.3g} s on {self.workers} processes of this machine; "
            "processes take a few seconds to come up",
            f"about {self.bytes / 1e6:.3g} MB of metrics",
        ]
        if self.at_most:
            lines.append(
                "and what its identifications take, which no short probe shows: some ten a run, "
                "each of seconds"
            )
        if spec.keep.runs or spec.keep.worst:
            lines.append(f"and up to {len(spec.keep.runs) + spec.keep.worst} recordings")
        return "\n".join(lines)


def forecast(spec: Spec, workers: int) -> Forecast:
    """Measure on this machine, in this process."""
    drawn = draw(spec, range(min(PROBE, spec.runs)))
    short, long = (replace(spec, duration=length, steady=length) for length in (SHORT, LONG))
    flown(short, drawn)  # compiled and imported
    took: list[float] = []
    for probe in (short, long):
        started = time.perf_counter()
        came = flown(probe, drawn)
        took.append(time.perf_counter() - started)
    a_second = max(took[1] - took[0], 0.0) / (LONG - SHORT)
    begin = max(took[0] - SHORT * a_second, 0.0)
    each = (begin + spec.duration * a_second) / len(drawn.runs)
    empty = size_of(table_of(spec, drawn.at([]), {}))
    size = size_of(table_of(spec, drawn, came)) - empty
    return Forecast(
        runs=spec.runs,
        shards=spec.shards,
        arms=len(spec.arms),
        points=spec.points,
        samples=spec.samples,
        factors=tuple(f"{f.name} [{f.unit}]: {f.distribution.words()}" for f in spec.factors),
        fixed=tuple(_fixed(spec)),
        seconds=each * spec.runs / min(workers, spec.shards),
        at_most=spec.procedure == "balance",
        bytes=round(size * spec.runs / len(drawn.runs)) + empty * spec.shards,
        spec=spec,
        workers=workers,
    )


def _fixed(spec: Spec) -> Iterator[str]:
    effects = [factor for effect in spec.arms[0].effects for factor in effect.factors]
    start = [factor for of in spec.initial.factors.values() for factor in of]
    for factor in (*spec.gains, *effects, *start):
        if isinstance(factor.distribution, Fixed):
            yield f"{factor.name} [{factor.unit}]: {factor.distribution.value:g}"
    for arm in spec.arms:
        if arm.reference:
            yield f"reference of {arm.name}, in degrees: {arm.reference}"
