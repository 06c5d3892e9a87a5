"""A campaign flown shard by shard in worker processes, and its forecast from a short probe."""

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from twin.campaigns.distribution import Fixed
from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.folder import Folder
from twin.campaigns.results import size_of, table_of
from twin.campaigns.spec import Spec
from twin.campaigns.worker import Done, begin, fly, fly_shard, written_shard
from twin.errors import TwinError
from twin.processes import Pool, first_completed
from twin.stop import check, listening

if TYPE_CHECKING:
    from twin.campaigns.cluster import Cluster


ATTEMPTS = 3
"""Times that processes may die before one shard is done."""


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

    def words(self, now: float) -> str:
        """Runs, rate, time left."""
        done = self.before + self.flown
        told = f"{done} of {self.total} runs"
        if self.flown:
            rate = self.flown / max(now - self.started, 1e-9)
            told += f", {rate:.3g} runs/s, {_span((self.total - done) / rate)} left"
        return told + (f", {self.failed} failed" if self.failed else "")


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
        ClusterError: as `Cluster.fly` tells.
        Stopped: a stop was requested; every shard that is written is whole.
    """
    with folder.owned(), listening():
        folder.begin(spec, resume=resume)
        missing = folder.missing(spec)
        left = sum(len(spec.runs_of(shard)) for shard in missing)
        progress = Progress(spec.runs, spec.runs - left, started=time.monotonic())
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


def _by_processes(folder: Folder, shards: Iterable[int], workers: int) -> Iterable[Done]:
    """As they are done; no more are asked for than there are processes, however many there are."""
    waiting = list(shards)
    waiting.reverse()
    died = 0
    while waiting:
        folder.sweep()
        pool = Pool(workers, begin, (str(folder.path),))
        asked: dict[Future[Done], int] = {}
        try:
            while waiting or asked:
                while waiting and len(asked) < workers + 1:
                    # a pool that is broken takes none: the shard must still be waiting then
                    asked[pool.submit(fly, waiting[-1])] = waiting[-1]
                    waiting.pop()
                for future in first_completed(asked):
                    done = future.result()
                    del asked[future]
                    died = 0
                    yield done
        except BrokenProcessPool:
            # one that was written before the process died is not flown twice, but told
            written = {shard for shard in asked.values() if folder.shard(shard).is_file()}
            lost = sorted(set(asked.values()) - written)
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


def _span(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    if seconds < 5400.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"


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
