"""The whole catalogue asked of five minutes of a machine: whole processes, and how it grows."""

import tempfile
from functools import partial
from pathlib import Path

from benchmarks.measure import in_turn, table, twin

LONG, SHORT = 300.0, 100.0
"""Of the logs [s]; the gyro of `sads` is sampled at 100 Hz."""
HIDDEN = {"nothing": [], "a cable": ["--effects", "harness_stiffness=0.01"]}
ROUNDS = 3


def run() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        subjects: list[tuple[str, partial[None], str]] = []
        for duration in (SHORT, LONG):
            for name, effects in HIDDEN.items():
                log = Path(folder) / f"{duration:g} {name}.rrd"
                twin("run", "sads", "--controller", "quaternion_pd", "--duration", str(duration),
                      *effects, "--rrd", str(log))  # fmt: skip
                goal = "<= 60" if duration == LONG else ""
                words = f"{duration:g} s of sads, hiding {name}"
                subjects.append((words, partial(twin, "diagnose", str(log)), goal))
        rows = in_turn(subjects, ROUNDS)
    table(("twin diagnose", "seconds", f"median of {ROUNDS} (lowest to highest)", "target"), rows)
