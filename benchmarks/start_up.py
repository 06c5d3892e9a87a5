"""Start-up: whole processes, from the shell's point of view."""

import subprocess
import sys
from functools import partial
from pathlib import Path

from benchmarks.measure import median, seconds, spread, table

ROUNDS = 9
TWIN = str(Path(sys.executable).with_name("twin"))

SUBJECTS: tuple[tuple[str, list[str], str], ...] = (
    ("python -c pass", [sys.executable, "-c", "pass"], ""),
    ("twin --help", [TWIN, "--help"], "<= 0.3"),
    ("twin run --help", [TWIN, "run", "--help"], "<= 0.6"),
    ("import twin", [sys.executable, "-c", "import twin"], ""),
    ("import twin.flight", [sys.executable, "-c", "import twin.flight"], ""),
)


def run() -> None:
    """Print the table; the processes take turns, and a first round fills the disk's cache."""
    times: dict[str, list[float]] = {name: [] for name, _, _ in SUBJECTS}
    for number in range(ROUNDS + 1):
        for name, command, _ in SUBJECTS:
            taken = seconds(partial(subprocess.run, command, check=True, capture_output=True))
            times[name] += [taken] if number else []
    rows = [
        (name, f"{median(times[name]):.3f}", spread(times[name], ".2f"), target)
        for name, _, target in SUBJECTS
    ]
    table(("process", "seconds", f"median of {ROUNDS} (lowest to highest)", "target"), rows)
