"""The whole catalogue asked of a machine's log: whole processes, other machines, how it grows."""

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from benchmarks.machines import LAWS
from benchmarks.measure import in_turn, table, twin
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.candidates import Candidate, candidates_of
from twin.diagnosis.engine import search_from
from twin.diagnosis.explanation import Explanation
from twin.identification.identification import calibrated
from twin.platform import load_platform
from twin.recording import open_log

LONG, SHORT = 300.0, 100.0
"""Of the logs [s]; the gyro of `sads` is sampled at 100 Hz."""
HIDDEN = {"nothing": [], "a cable": ["--effects", "harness_stiffness=0.01"]}
GOAL = "<= 60"
ROUNDS = 5
MACHINES = ("astros", "cubesat", "tas2", "whorl1")
WITHIN_STOP = {"whorl1": ["--reference", "multisine:2"]}
"""What its law is usually given leans it beyond its stop after a minute."""
SHARES = (4, 2, 1)
"""What part of the catalogue is asked: one in so many."""


def run() -> None:
    """Print three tables."""
    head = ("seconds", f"median of {ROUNDS} (lowest to highest)", "target")
    with tempfile.TemporaryDirectory() as folder:
        logs = {name: _flown(folder, "sads", LONG, name) for name in HIDDEN}
        rows = in_turn(
            [
                (f"{LONG:g} s of sads, hiding {name}", partial(twin, "diagnose", str(log)), GOAL)
                for name, log in logs.items()
            ],
            ROUNDS,
        )
        table(("twin diagnose", *head), rows)
        logs = {f"sads, hiding {name}": _flown(folder, "sads", SHORT, name) for name in HIDDEN}
        short = logs["sads, hiding nothing"]
        logs |= {f"{name}, hiding nothing": _flown(folder, name, SHORT) for name in MACHINES}
        rows = in_turn(
            [
                (f"{SHORT:g} s of {words}", partial(twin, "diagnose", str(log)), "")
                for words, log in logs.items()
            ],
            1,
        )
        print()
        table(("twin diagnose", "seconds"), [row[:2] for row in rows])
        print()
        _catalogue(short)


def _flown(folder: str, platform: str, duration: float, hidden: str = "nothing") -> Path:
    """A log of a machine under one of its laws."""
    log = Path(folder) / f"{platform} {duration:g} {hidden}.rrd"
    twin("run", platform, "--controller", LAWS[platform], "--duration", str(duration),
         *WITHIN_STOP.get(platform, []), *HIDDEN[hidden], "--rrd", str(log))  # fmt: skip
    return log


def _catalogue(path: Path) -> None:
    """How long it takes to weigh causes once, by their number."""
    platform = load_platform("sads")
    plain = baseline_of([calibrated(open_log(path).without_truth(), platform)], platform)
    asked = candidates_of(plain.bodies).asked
    parts = [asked[::share] for share in SHARES]
    rows = in_turn(
        [
            (f"{len(part)} causes weighed in {SHORT:g} s", partial(_weighed, plain, part), "")
            for part in parts
        ],
        ROUNDS,
    )
    table(("within", "seconds", f"median of {ROUNDS} (lowest to highest)"), [r[:3] for r in rows])


def _weighed(plain: Explanation, part: Sequence[Candidate]) -> None:
    """Anew: an explanation remembers what was asked of it."""
    search_from(replace(plain), part)
