"""How things are measured here: interleaved pairs, medians, and tables in plain text.

The machine is noisy and others use it: A and B take turns, each pair gives a ratio, and what is
printed is the median of the ratios with the lowest and the highest.
"""

import os
import platform
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version

import numpy as np


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call [s]."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


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
