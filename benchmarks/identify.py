"""A measured machine's base from a log of five minutes: whole processes, and the loading alone."""

import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.measure import median, seconds, spread, table
from twin.recording import open_log

DURATION = 300.0
"""Of the log [s]; the gyro of `sads` is sampled at 100 Hz."""
ROUNDS = 3
TWIN = str(Path(sys.executable).with_name("twin"))


def run() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        log, tables = Path(folder) / "sads.rrd", Path(folder) / "tables"
        _twin("run", "sads", "--controller", "quaternion_pd", "--reference", "multisine:5",
              "--duration", str(DURATION), "--rrd", str(log))  # fmt: skip
        _twin("export", str(log), str(tables))
        subjects = (
            ("twin identify", partial(_twin, "identify", str(log)), "<= 25"),
            ("  by momentum", partial(_twin, "identify", str(log), "--method", "momentum"), ""),
            ("open_log, .rrd", partial(open_log, log), "<= 1"),
            ("open_log, folder of CSV", partial(open_log, tables), "<= 1"),
        )
        times: dict[str, list[float]] = {name: [] for name, _, _ in subjects}
        for _ in range(ROUNDS):
            for name, work, _ in subjects:
                times[name].append(seconds(work))
    rows = [
        (name, f"{median(times[name]):.2f}", spread(times[name], ".2f"), target)
        for name, _, target in subjects
    ]
    head = (f"{DURATION:g} s of sads", "seconds", f"median of {ROUNDS} (lowest to highest)")
    table((*head, "target"), rows)


def _twin(*words: str) -> None:
    subprocess.run([TWIN, *words], check=True, capture_output=True)
