"""How things are measured here: interleaved pairs, medians, and tables in plain text.

The machine is noisy and others use it: A and B take turns, each pair gives a ratio, and what is
printed is the median of the ratios with the lowest and the highest.
"""

import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

_TWIN = str(Path(sys.executable).with_name("twin"))
Row = tuple[str, str, str, str]


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call [s]."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def twin(*words: str) -> None:
    """Run `twin` in a process of its own.

    Raises:
        CalledProcessError: it failed.
    """
    subprocess.run([_TWIN, *words], check=True, capture_output=True)


def in_turn(subjects: Sequence[tuple[str, Callable[[], object], str]], rounds: int) -> list[Row]:
    """Time subjects (name, work, target), one after the other and again.

    Returns:
        Rows of name, median [s], spread and target.
    """
    times: dict[str, list[float]] = {name: [] for name, _, _ in subjects}
    for _ in range(rounds):
        for name, work, _ in subjects:
            times[name].append(seconds(work))
    return [
        (name, f"{median(times[name]):.2f}", spread(times[name], ".2f"), target)
        for name, _, target in subjects
    ]


def spread(values: Sequence[float], form: str = ".3g") -> str:
    """Median (lowest to highest)."""
    low, middle, high = np.percentile(values, [0.0, 50.0, 100.0])
    return f"{middle:{form}} ({low:{form}} to {high:{form}})"


def median(values: Sequence[float]) -> float:
    """Median."""
    return float(np.median(values))


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a Markdown table with aligned columns."""
    cells = [[str(cell) for cell in row] for row in (head, *rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    cells.insert(1, ["-" * width for width in widths])
    for row in cells:
        print("| " + " | ".join(map(str.ljust, row, widths)) + " |", flush=True)


def machine() -> str:
    """What this was measured on, and how busy it was."""
    versions = " ".join(f"{name} {version(name)}" for name in ("mujoco", "numpy", "rerun-sdk"))
    cores, load = os.cpu_count() or 1, os.getloadavg()[0]
    busy = " (others are at work: measure again when it is quiet)" if load > 0.5 * cores else ""
    return (
        f"{cores} cores ({_processor()}), load {load:.1f} at the start{busy}, "
        f"Python {platform.python_version()}, {versions}"
    )


def _processor() -> str:
    try:
        with open("/proc/cpuinfo") as file:
            names = [line.split(":", 1)[1].strip() for line in file if line[:10] == "model name"]
    except OSError:
        names = []
    return names[0] if names else platform.machine()
