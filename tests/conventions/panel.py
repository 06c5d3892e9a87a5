"""A hundred logs in a wrong convention, and right ones: which are recognised, which accused?

`python tests/conventions/panel.py FOLDER [--count 100]` flies and checks, one JSON a chunk of two
misread logs and a right one, until there are so many misread logs that show their mistake, and
prints the table; what is in FOLDER is not done again. The slow test runs a part of it with seeds of
its own. Misread logs that show nothing are counted apart: of them no more is asked than that
nothing false is said.
"""

import argparse
import itertools
import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from flights import FREE, GRADES, KINDS, LATENCY, MOTIONS, Mistake, flights, make_mistake

from twin.conventions import ConventionFinding, check_conventions
from twin.platform import Platform, load_platform

SEED = 2000
"""Of the first chunk; the next one has the next."""
CELLS = [(grade, motion) for motion in MOTIONS for grade in GRADES]
PROMISED = 0.95
"""Share of the misread logs that is recognised."""
WRONG = 2
"""Misread logs of a chunk; one more is left right."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=100)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    sads, rows = load_platform("sads"), list[dict]()
    for chunk in itertools.count():
        if sum(misread_visibly(row) for row in rows) >= options.count:
            break
        path = options.folder / f"{chunk:03d}.json"
        if not path.exists():
            path.write_text(json.dumps(fly_and_check(sads, chunk, SEED + chunk), indent=1))
            print(path.stem, file=sys.stderr)
        rows += json.loads(path.read_text())
    print(table(rows))
    return 0


def fly_and_check(sads: Platform, chunk: int, seed: int) -> list[dict]:
    """One row a log of a machine in a grade and a motion."""
    draw = np.random.default_rng(seed)
    grade, motion = CELLS[chunk % len(CELLS)]
    rows = list[dict]()
    for index, log in enumerate(flights(sads, draw, grade, motion, WRONG + 1)):
        mistake = None
        if index < WRONG:
            mistake = make_mistake(log, draw, str(draw.choice(KINDS)))
            log = mistake.recording
        findings = check_conventions(log, sads)
        rows.append(
            {
                "seed": seed,
                "grade": grade,
                "motion": motion,
                "kind": mistake.kind if mistake else "right",
                "mistake": f"{mistake.stream} {mistake.name}" if mistake else "",
                "verdict": verdict(mistake, findings),
                "sentences": [finding.sentence for finding in findings],
            }
        )
    return rows


def verdict(mistake: Mistake | None, findings: list[ConventionFinding]) -> str:
    """`named`, `tied` (named among others that fit as well), `wrong`, `missed`; of a right log
    `accused` or `quiet`."""
    if mistake is None:
        return "accused" if findings else "quiet"
    if not findings:
        return "missed"
    first, *others = readings(findings)
    if is_true(mistake, first):
        return "tied" if others else "named"
    return "tied" if any(is_true(mistake, other) for other in others) else "wrong"


def readings(findings: list[ConventionFinding]) -> list[str]:
    """The log put right in one way or another: all that is wrong with it, in words."""
    others = dict.fromkeys(text for finding in findings for text in finding.alternatives)
    return [", and ".join(finding.correction.words for finding in findings), *others]


def is_true(mistake: Mistake, reading: str) -> bool:
    """Whether a reading tells the mistake, and nothing else."""
    if ", and " in reading or not {mistake.stream, mistake.name} <= set(_terms(mistake, reading)):
        return False
    if not mistake.lag:
        return True
    told = re.search(r"([\d.]+) \+- ([\d.]+) s ", reading)
    if told is None:
        return False
    lag, half_width = float(told[1]), float(told[2])
    # the other streams' own latencies are part of what is told
    return abs(lag - abs(mistake.lag)) <= half_width + LATENCY


def _terms(mistake: Mistake, reading: str) -> Iterable[str]:
    return [term for term in (mistake.stream, mistake.name) if term in reading]


def table(rows: list[dict]) -> str:
    """Recognised, by kind, grade and motion; every miss and every accusation in full."""
    right = [row for row in rows if row["kind"] == "right"]
    misread = [row for row in rows if row["kind"] != "right"]
    blind = [row for row in misread if not shows(row)]
    misread = [row for row in misread if shows(row)]
    lines = [
        f"misread logs: {_counts(misread)}",
        f"misread logs that do not show it: {_counts(blind)}",
        f"right logs: {sum(row['verdict'] == 'accused' for row in right)} of {len(right)} accused",
    ]
    for key in ("kind", "grade", "motion"):
        for value in dict.fromkeys(row[key] for row in misread):
            lines.append(f"  {value}: {_counts([row for row in misread if row[key] == value])}")
    for row in rows:
        if row["verdict"] in ("missed", "wrong", "accused"):
            where = f"seed {row['seed']}, {row['grade']}, {row['motion']}"
            where += "" if shows(row) else ", shows nothing"
            said = " ".join(row["sentences"]) or "nothing"
            lines.append(f"{row['verdict']} ({where}) {row['mistake'] or 'a right log'}: {said}")
    return "\n".join(lines)


def misread_visibly(row: dict) -> bool:
    """Whether a log is misread, and can show it."""
    return row["kind"] != "right" and shows(row)


def shows(row: dict) -> bool:
    """Whether a log can show its mistake at all.

    Not where the body moves by less than a sample of its attitude scatters; nor is the clock of
    wheels seen that run at constant speed, nor anything of them in the few seconds of a fall.
    """
    if row["motion"] == "still" or (row["grade"], row["motion"]) == ("coarse", "slow"):
        return False
    if row["motion"] not in FREE or not row["mistake"].startswith("wheel_speed"):
        return True
    return row["motion"] != "falling" and row["kind"] != "clock_lag"


def _counts(rows: list[dict]) -> str:
    count = {v: sum(row["verdict"] == v for row in rows) for v in ("named", "tied", "wrong")}
    return (
        f"{count['named'] + count['tied']} of {len(rows)} recognised ({count['tied']} in a tie), "
        f"{count['wrong']} called something else"
    )


if __name__ == "__main__":
    sys.exit(main())
