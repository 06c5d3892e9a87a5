"""What a million and a thousand million runs would take, from what a few runs and shards take here.

A plan on paper: nothing of that size is flown. Each figure is measured on one shard or some, and
multiplied; what does not grow with the number of runs is named in docs/campaigns.md.
"""

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.measure import median, seconds, table
from twin.campaigns.cluster import AHEAD, packed
from twin.campaigns.distribution import Sampling
from twin.campaigns.draw import draw
from twin.campaigns.execute import forecast
from twin.campaigns.folder import Folder
from twin.campaigns.read import read_spec
from twin.campaigns.results import write_rows
from twin.campaigns.spec import Spec
from twin.campaigns.worker import rows_of_shard

SIZES = (10**5, 10**6, 10**9)
SHARDS = (256, 4096)
DURATIONS = (6.0, 60.0)
"""[s]."""
CORES = 1000
FILES = 20_000
"""Of an imitated folder of metrics."""
TASKS = 60
"""Shards handed to a worker that does nothing."""
REPORTED = 40_000
"""Runs of an imitated campaign that is reported on."""
ROUNDS = 9

SPEC = """
platform = "sads"
controller = "quaternion_pd"
runs = 1000000
duration = {duration}
seed = 1
sampling = "sobol"

[gains]
derivative = {{ uniform = [6.0, 10.0] }}

[initial]
center_of_mass_offset = {{ uniform = [[-1e-3, -1e-3, -2.85e-2], [1e-3, 1e-3, -2.8e-2]] }}

[effects.gyro_bias]
"""

REPORT = """
import sys
from pathlib import Path
from twin.campaigns.answers import answers
from twin.campaigns.results import read_results
def largest():
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0])
before = largest()
answers(read_results(Path(sys.argv[1])))
print(before, largest())
"""


@dataclass(frozen=True)
class Shard:
    """What one costs beside its flight."""

    rows: pa.Table
    campaign: int
    """Bytes that go to a worker with it."""
    handed: float
    """To a worker and back [s]."""
    written: float
    """[s]."""
    read: float
    """To count how its runs ended [s]."""
    listed: float
    """Its file, when a campaign is gone on with [s]."""


def run() -> None:
    """Print what is measured, then the plan."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        spec = _spec(place, 60.0)
        shards = {runs: _shard(replace(spec, shard=runs), place / str(runs)) for runs in SHARDS}
        print("a shard beside its flight:\n")
        names = ("runs", "campaign, to a worker", "rows, back", "handed over and back by Dask",
                 "written", "read for the last word", "its file listed")  # fmt: skip
        table(names, [_beside(runs, shard) for runs, shard in shards.items()])
        print("\nthe values of a campaign's last shard drawn, ms:\n")
        table(("sampling", *map(_number, SIZES)), [_drawn(spec, how) for how in _SAMPLINGS])
        took, memory = _reported(spec, shards[spec.shard], place)
        print(f"\na report of {REPORTED} runs: {took:.0f} s, {memory:.0f} B of memory a run\n")
        print(f"campaigns on {CORES} cores like this one, one client:\n")
        table(
            ("runs", "of", "a shard", "core hours", f"h on {CORES}", "metrics", "files",
             "client busy", "cores that it feeds", "last word", "memory of a report"),
            [row for duration in DURATIONS for row in _plan(place, duration, shards, memory)],
        )  # fmt: skip


def _beside(runs: int, shard: Shard) -> list[str]:
    return [
        str(runs),
        f"{shard.campaign / 1e3:.0f} kB",
        f"{shard.rows.nbytes / 1e3:.0f} kB",
        f"{shard.handed * 1e3:.1f} ms",
        f"{shard.written * 1e3:.1f} ms",
        f"{shard.read * 1e3:.1f} ms",
        f"{shard.listed * 1e6:.1f} us",
    ]


_SAMPLINGS: tuple[Sampling, ...] = ("random", "latin_hypercube", "sobol")


def _spec(folder: Path, duration: float) -> Spec:
    path = folder / "spec.toml"
    path.write_text(SPEC.format(duration=duration), encoding="utf-8")
    return read_spec(path)


def _shard(spec: Spec, folder: Path) -> Shard:
    _, rows = rows_of_shard(replace(spec, duration=1.0, steady=1.0), 0)
    campaign = packed(spec)
    metrics = Folder(folder)
    (metrics.path / "metrics").mkdir(parents=True)
    for number in range(FILES):
        metrics.shard(number).touch()
    many = replace(spec, runs=FILES * spec.shard)
    written = [seconds(partial(write_rows, rows, metrics.shard(FILES))) for _ in range(ROUNDS)]
    last = metrics.shard(FILES)
    ends = partial(pq.read_table, last, columns=["ended"])
    return Shard(
        rows=rows,
        campaign=len(campaign),
        handed=_handed(campaign, rows),
        written=median(written),
        read=median([seconds(ends) for _ in range(ROUNDS)]),
        listed=seconds(partial(metrics.missing, many)) / FILES,
    )


def _handed(campaign: bytes, rows: pa.Table) -> float:
    """Of a worker that has the rows at hand, in another process, as many ahead as in a campaign."""
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0") as local,
        Client(local) as client,
    ):
        client.submit(_nothing, campaign, -1).result()

        def hand_over() -> None:
            asked = [client.submit(_rows, campaign, n, rows) for n in range(AHEAD)]
            for number in range(AHEAD, TASKS):
                asked.pop(0).result()
                asked.append(client.submit(_rows, campaign, number, rows))
            for future in asked:
                future.result()

        return seconds(hand_over) / TASKS


def _nothing(campaign: bytes, shard: int) -> int:
    del campaign
    return shard


def _rows(campaign: bytes, shard: int, rows: pa.Table) -> pa.Table:
    del campaign, shard
    return rows


def _drawn(spec: Spec, sampling: Sampling) -> list[str]:
    cells = [sampling]
    for size in SIZES:
        item = replace(spec, runs=size, sampling=sampling)
        last = item.runs_of(item.shards - 1)
        cells.append(f"{seconds(partial(draw, item, last)) * 1e3:.0f}")
    return cells


def _reported(spec: Spec, shard: Shard, folder: Path) -> tuple[float, float]:
    """Seconds, and bytes a run, of a report in a process of its own."""
    few = replace(
        spec,
        runs=REPORTED,
        text=spec.text.replace("runs = 1000000", f"runs = {REPORTED}"),
    )
    imitated = Folder(folder / "reported")
    imitated.path.mkdir()
    imitated.begin(few, resume=False)
    for number in range(few.shards):
        runs = few.runs_of(number)
        rows = shard.rows.slice(0, len(runs)).set_column(
            0, shard.rows.schema.field(0), pa.array(runs, pa.int64())
        )
        write_rows(rows, imitated.shard(number))
    command = [sys.executable, "-c", REPORT, str(imitated.path)]
    told: list[str] = []

    def report() -> None:
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        told.extend(done.stdout.split())

    took = seconds(report)
    before, after = (int(number) * 1024 for number in told)
    return took, (after - before) / REPORTED


def _plan(
    folder: Path, duration: float, shards: Mapping[int, Shard], report: float
) -> list[list[str]]:
    """Rows of runs of one duration; what a run takes is the median over all of them."""
    spec = _spec(folder, duration)
    cases = [
        replace(spec, runs=size, shard=runs)
        for size in SIZES
        for runs in shards
        if runs == spec.shard or size > 10**6
    ]
    foretold = [forecast(case, 1) for case in cases]
    a_run = median([told.seconds / told.runs for told in foretold])
    rows: list[list[str]] = []
    for case, told in zip(cases, foretold, strict=True):
        shard = shards[case.shard]
        flown, client = a_run * told.runs, shard.handed + shard.written
        rows.append(
            [
                _number(told.runs),
                f"{duration:g} s",
                str(case.shard),
                f"{flown / 3600.0:.3g}",
                f"{flown / 3600.0 / min(CORES, told.shards):.2g}",
                f"{told.bytes / 1e9:.3g} GB",
                _number(told.shards),
                f"{client * told.shards / 3600.0:.2g} h",
                f"{a_run * case.shard / client:.0f}",
                f"{shard.read * told.shards / 3600.0:.2g} h",
                f"{report * told.runs / 1e9:.3g} GB",
            ]
        )
    return rows


def _number(value: int) -> str:
    return f"{value:,}"
