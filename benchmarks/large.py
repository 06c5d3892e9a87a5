"""A hundred thousand runs of 6 s beside ten thousand: time, disk, and the most memory they took.

Both are flown by `twin campaign` in processes of its own, on every core that this one may use, and
watched from outside. What 60 s would take follows from shards of 6 s and of 60 s, in turns.
"""

import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pyarrow.parquet as pq

from benchmarks.measure import median, seconds, table
from benchmarks.scale import SPEC
from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.read import read_spec
from twin.campaigns.spec import Spec

SIZES = (10_000, 100_000)
DURATION, LONGER = 6.0, 60.0
"""[s]."""
ROUNDS = 3
LOOK = 0.2
"""Between two looks at the processes [s]; each tells the most it ever took."""


@dataclass(frozen=True)
class Flown:
    """What a campaign took."""

    seconds: float
    client: int
    """Most memory of the process that was started [B]."""
    worker: int
    """And of any that it started; 0 where it flew alone."""
    bytes: int
    """Of metrics."""
    files: int
    rows: int
    failed: int


def run() -> None:
    """Fly both; print what they took, and what longer runs would."""
    cores = len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        told = [_flown(folder, size) for size in SIZES]
        ratio, spent = _longer(_spec(folder, 256, DURATION), _spec(folder, 256, LONGER))
    table(
        ("runs of 6 s", "seconds", "runs per s", "metrics", "files", "client, at most",
         "a worker, at most", "rows", "failed"),
        [
            (
                f"{size:,}",
                f"{item.seconds:.0f}",
                f"{size / item.seconds:.0f}",
                f"{item.bytes / 1e6:.1f} MB",
                item.files,
                _mb(item.client),
                _mb(item.worker) if item.worker else "(there was none)",
                f"{item.rows:,}",
                item.failed,
            )
            for size, item in zip(SIZES, told, strict=True)
        ],
    )  # fmt: skip
    many = told[-1]
    largest = [max(item.client, item.worker) for item in told]
    print(
        f"\n{cores} cores. Memory of the largest process, {SIZES[1]:,} runs over {SIZES[0]:,}: "
        f"{largest[1] / largest[0]:.3f}.\n"
        f"A shard of 256 runs of {LONGER:g} s takes {ratio:.2f} times one of {DURATION:g} s "
        f"({spent[0]:.1f} s and {spent[1]:.1f} s of one core, medians of {ROUNDS} turns):\n"
        f"{SIZES[1]:,} runs of {LONGER:g} s would take {ratio * many.seconds / 3600.0:.2f} h on "
        f"these cores, and the same {many.bytes / 1e6:.1f} MB."
    )


def _mb(size: int) -> str:
    return f"{size / 1e6:.0f} MB"


def _spec(folder: Path, runs: int, duration: float) -> Spec:
    return read_spec(_file(folder, runs, duration))


def _file(folder: Path, runs: int, duration: float) -> Path:
    path = folder / f"spec-{runs}-{duration:g}.toml"
    text = SPEC.format(duration=duration).replace("runs = 1000000", f"runs = {runs}")
    path.write_text(text, encoding="utf-8")
    return path


def _flown(folder: Path, runs: int) -> Flown:
    into = folder / str(runs)
    command = [
        sys.executable,
        "-m",
        "twin",
        "campaign",
        str(_file(folder, runs, DURATION)),
        str(into),
    ]
    most: dict[int, int] = {}
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    watcher = threading.Thread(target=_watch, args=(process, most))
    watcher.start()
    code = process.wait()
    took = time.perf_counter() - start
    watcher.join()
    if code:
        raise SystemExit(f"{' '.join(command)} ended with {code}")
    files = sorted((into / "metrics").glob("*.parquet"))
    ends = pq.read_table(into / "metrics", columns=["run", "ended"])
    return Flown(
        seconds=took,
        client=most.pop(process.pid),
        worker=max(most.values(), default=0),
        bytes=sum(path.stat().st_size for path in files),
        files=len(files),
        rows=len(set(ends["run"].to_pylist())),
        failed=ends["ended"].to_pylist().count("failed"),
    )


def _watch(process: subprocess.Popen[bytes], most: dict[int, int]) -> None:
    """Note the peak memory of a process and of its workers, until it ends."""
    while process.poll() is None:
        for pid in (process.pid, *_children(process.pid)):
            peak = _peak(pid)
            most[pid] = max(most.get(pid, 0), peak)
        time.sleep(LOOK)


def _children(parent: int) -> list[int]:
    """Its workers, and not what it asks for the machine's name."""
    try:
        told = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
        return [pid for pid in map(int, told) if "spawn_main" in _command(pid)]
    except OSError:
        return []


def _command(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_text()


def _peak(pid: int) -> int:
    """Most memory that a process has had [B]; 0 if it is gone."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0
    _, result, rest = status.partition("VmHWM:")
    return int(rest.split()[0]) * 1024 if result else 0


def _longer(short: Spec, long: Spec) -> tuple[float, tuple[float, float]]:
    """How much more the longer runs cost: ratio, and seconds of a shard of each."""
    took: list[list[float]] = []
    for turn in range(ROUNDS + 1):
        pair = [seconds(partial(flown, s, draw(s, range(s.runs)))) for s in (short, long)]
        if turn:
            took.append(pair)
    item, other = (median(side) for side in zip(*took, strict=True))
    return median([pair[1] / pair[0] for pair in took]), (item, other)
