"""What recording costs a run: in the loop, until the file is complete, in the writer's process."""

import resource
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.measure import median, spread, table
from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import Observer, fly
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.reference import Multisine
from twin.stream.provenance import provenance
from twin.stream.recorder import FileRecorder

DURATION = 300.0
"""Of a run [s]."""
PAIRS = 4


@dataclass(frozen=True)
class Cost:
    """Of one run [s]."""

    loop: float
    """All phases of the loop."""
    record: float
    """Its recording phase."""
    whole: float
    """From before the machine is compiled until the file is complete."""
    writer: float
    """Processor time of the writer's process, its imports included."""
    size: int
    """Bytes of the file."""


def run() -> None:
    """Print the table."""
    pairs = [(_flight(recorded=False), _flight(recorded=True)) for _ in range(PAIRS)]
    plain, recorded = zip(*pairs, strict=True)
    slower = [(b.loop - a.loop) / a.loop for a, b in pairs]
    later = [(b.whole - a.whole) / a.whole for a, b in pairs]
    fast = f"of a run as fast as it goes ({DURATION / median([a.loop for a in plain]):.0f} x real)"
    wall = "of a run in real time"
    phase = "the loop's recording phase"
    rows = [
        (phase, wall, [b.record / DURATION for b in recorded], "<= 2 %"),
        ("the writer's process", wall, [b.writer / DURATION for b in recorded], ""),
        (phase, fast, [b.record / b.loop for b in recorded], "<= 2 %"),
        ("the loop with, less without", fast, slower, ""),
        ("start to complete file, less without", fast, later, ""),
    ]
    table(
        ("cost of recording", "share", f"median of {PAIRS} (lowest to highest)", "target"),
        [(what, of, _percent(shares), target) for what, of, shares, target in rows],
    )
    size = median([b.size for b in recorded]) / DURATION
    ticks = DURATION * load_platform("sads").control_rate
    each = median([b.record for b in recorded]) / ticks * 1e6
    print(
        f"\nsads, n = 1, {DURATION:.0f} s, attitude filter, {PAIRS} pairs in turns; "
        f"{each:.0f} us a tick, {size / 1e3:.1f} kB a recorded second"
    )


def _flight(*, recorded: bool) -> Cost:
    writer = _writer_time()
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.rrd"
        recorder = FileRecorder(path) if recorded else None
        platform = load_platform("sads")
        observers: Sequence[Observer] = ()
        if recorder is not None:
            recorder.start(platform, provenance(platform, seed=0))
            observers = (recorder,)
        with SimulatedPlant(platform) as plant:
            outcome = fly(
                plant,
                load_estimator("filter"),
                load_controller("quaternion_pd"),
                Multisine(),
                SimulatedClock(),
                duration=DURATION,
                observers=observers,
            )
        if recorder is not None:
            recorder.close()
        whole = time.perf_counter() - start
        size = path.stat().st_size if recorded else 0
    seconds = outcome.timing.seconds
    return Cost(sum(seconds.values()), seconds["record"], whole, _writer_time() - writer, size)


def _writer_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _percent(shares: list[float]) -> str:
    return spread([100.0 * share for share in shares], ".2g") + " %"
