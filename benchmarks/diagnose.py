"""The whole catalogue asked of five minutes of a machine: whole processes, and how it grows."""

import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.measure import median, seconds, spread, table

LONG, SHORT = 300.0, 100.0
"""Of the logs [s]; the gyro of `sads` is sampled at 100 Hz."""
HIDDEN = {"nothing": [], "a cable": ["--effects", "harness_stiffness=0.01"]}
ROUNDS = 3
TWIN = str(Path(sys.executable).with_name("twin"))


def run() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        subjects: list[tuple[str, partial[None], str]] = []
        for duration in (SHORT, LONG):
            for name, effects in HIDDEN.items():
                log = Path(folder) / f"{duration:g} {name}.rrd"
                _twin("run", "sads", "--controller", "quaternion_pd", "--duration", str(duration),
                      *effects, "--rrd", str(log))  # fmt: skip
                goal = "<= 60" if duration == LONG else ""
                words = f"{duration:g} s of sads, hiding {name}"
                subjects.append((words, partial(_twin, "diagnose", str(log)), goal))
        times: dict[str, list[float]] = {name: [] for name, _, _ in subjects}
        for _ in range(ROUNDS):
            for name, work, _ in subjects:
                times[name].append(seconds(work))
    rows = [
        (name, f"{median(times[name]):.1f}", spread(times[name], ".1f"), goal)
        for name, _, goal in subjects
    ]
    table(("twin diagnose", "seconds", f"median of {ROUNDS} (lowest to highest)", "target"), rows)


def _twin(*words: str) -> None:
    subprocess.run([TWIN, *words], check=True, capture_output=True)
