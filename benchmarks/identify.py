"""A measured machine's base from a log of five minutes: whole processes, and the loading alone."""

import tempfile
from functools import partial
from pathlib import Path

from benchmarks.measure import in_turn, table, twin
from twin.recording import open_log

DURATION = 300.0
"""Of the log [s]; the gyro of `sads` is sampled at 100 Hz."""
ROUNDS = 3


def run() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        log, tables = Path(folder) / "sads.rrd", Path(folder) / "tables"
        twin("run", "sads", "--controller", "quaternion_pd", "--reference", "multisine:5",
              "--duration", str(DURATION), "--rrd", str(log))  # fmt: skip
        twin("export", str(log), str(tables))
        subjects = (
            ("twin identify", partial(twin, "identify", str(log)), "<= 25"),
            ("  by momentum", partial(twin, "identify", str(log), "--method", "momentum"), ""),
            ("open_log, .rrd", partial(open_log, log), "<= 1"),
            ("open_log, folder of CSV", partial(open_log, tables), "<= 1"),
        )
        rows = in_turn(subjects, ROUNDS)
    head = (f"{DURATION:g} s of sads", "seconds", f"median of {ROUNDS} (lowest to highest)")
    table((*head, "target"), rows)
