"""`python -m benchmarks.faults`: sessions under random faults, and how each of them ended.

Writes docs/faults.md from docs/faults.jsonl, a session a line. What is there is not done again: it
grows with each call. All that is random comes from the seed in the line.
"""

import argparse
import json
import signal
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from benchmarks import fault_devices, fault_table

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "faults.md"
ROWS = PAGE.with_suffix(".jsonl")
SESSIONS = {"cubesat": 350, "imu": 50, "tilt": 50, "stages": 50}
LONGEST = 180
"""After which a session hangs [s]."""

PASSED = {"cubesat": 65536, **fault_devices.PASSED}
ENDS = ("continued", "degraded", "safe_stop", "refused", "failed")


def flown(name: str, seed: int) -> dict[str, Any]:
    """One session; one that raises or hangs is a problem of its own."""
    fly: Callable[[int], dict[str, Any]] = (
        fault_table.session if name == "cubesat" else partial(fault_devices.session, name)
    )

    def hangs(number: int, frame: FrameType | None) -> NoReturn:
        raise TimeoutError(f"it hangs: not over after {LONGEST} s")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(LONGEST)
    try:
        return fly(seed)
    except Exception as error:
        trace = traceback.format_exc(limit=-1).splitlines()[-2].strip()
        problem = f"{type(error).__name__}: {error} ({trace})"
        row = {"machine": name, "seed": seed, "faults": [], "ended": "failed", "reason": ""}
        return row | {"damaged": 0, "undetected": 0, "problems": [problem]}
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def kept(name: str) -> list[dict[str, Any]]:
    """The sessions of a machine that were flown."""
    lines = ROWS.read_text(encoding="utf-8").splitlines() if ROWS.is_file() else []
    rows = [row for row in map(json.loads, lines) if row["machine"] == name]
    return sorted(rows, key=lambda row: row["seed"])


def grow(name: str, count: int) -> None:
    """Fly the sessions of a machine that are missing."""
    there = {row["seed"] for row in kept(name)}
    for seed in range(count):
        if seed not in there:
            row = flown(name, seed)
            with ROWS.open("a", encoding="utf-8") as rows:
                rows.write(json.dumps(row) + "\n")
            print(f"{name} {seed}: {row['ended']}, {row['problems'] or 'no problem'}", flush=True)


def line(name: str, rows: Sequence[dict[str, Any]]) -> str:
    """A machine's row of the table."""
    ends = Counter(row["ended"] for row in rows)
    damaged = sum(row["damaged"] for row in rows)
    believed = sum(row["undetected"] for row in rows)
    passed = PASSED[name]
    expected = f"{damaged / passed:.2g}" if passed > 1 else "no check in the protocol"
    return (
        f"| {name} | {len(rows)} | {' | '.join(str(ends[end]) for end in ENDS)} | {damaged} | "
        f"{expected} | {believed} |"
    )


def page(results: dict[str, list[dict[str, Any]]]) -> str:
    """All of it, and what must not be."""
    again = Counter(
        "armed" if came == "armed" else "refused with a sentence"
        for row in results["cubesat"]
        for came in row.get("again", ())
    )
    hit = Counter(
        item.rpartition(" ")[0]
        for rows in results.values()
        for row in rows
        for item in row["faults"]
    )
    lines = [
        "# Sessions under random faults",
        "",
        "`python -m benchmarks.faults` flies them and writes this page; docs/faults.jsonl has each",
        "with its seed, its faults and when they came, how it ended and why. `cubesat`: the whole",
        "loop with guard, law and recorder, over our own link, in lockstep, for 5 s, every fifth",
        "with the first use of each actuator, every 25th recorded in a file that is read back. The",
        "others: a maker's device on its line at its rate, by the wall's clock, for 4 s, connected",
        "anew whenever it falls.",
        "",
        "A session continues, degrades (samples were lost and counted), stops safely or is refused",
        "before it begins, each with a sentence. Counted as a problem: no sentence, a hang, an",
        "exception, a set-point beyond the limits that reached the board or left for a stage, a",
        "tick or a row that is missing in the recording; of `cubesat` also each value that was",
        "believed and never said. Damaged messages fail a check; of those that are damaged at",
        "random the check lets pass as many as stand beside them. `believed` passed all of check,",
        "counter, range and largest step.",
        "",
        f"| machine | sessions | {' | '.join(ENDS)} | damaged messages | the check lets pass |"
        " believed |",
        "|---|---|" + "---|" * (len(ENDS) + 3),
        *(line(name, rows) for name, rows in results.items() if rows),
        "",
        f"After each safe stop of `cubesat` it was connected and armed anew, twice: "
        f"{', '.join(f'{count} times {what}' for what, count in sorted(again.items()))}.",
        "",
        "Faults that came: " + ", ".join(f"{kind} {hit[kind]}" for kind in sorted(hit)) + ".",
        "",
        "## Problems",
        "",
    ]
    problems = [
        f"- {name}, seed {row['seed']}: {problem}"
        for name, rows in results.items()
        for row in rows
        for problem in row["problems"]
    ]
    return "\n".join([*lines, *(problems or ["None."]), ""])


def main() -> None:
    """Fly what is missing; write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machines", nargs="*", default=list(SESSIONS))
    parser.add_argument("--sessions", type=int, help="of each machine; 0 only writes the page")
    arguments = parser.parse_args()
    try:
        for name in arguments.machines:
            grow(name, SESSIONS[name] if arguments.sessions is None else arguments.sessions)
    finally:
        PAGE.write_text(page({name: kept(name) for name in SESSIONS}), encoding="utf-8")


if __name__ == "__main__":
    main()
