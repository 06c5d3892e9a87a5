"""A hundred logs in a wrong convention, and right ones: which are recognised, which accused?

`python tests/conventions/panel.py FOLDER [--chunks 66]` flies and checks, one JSON a chunk of two
misread logs and a right one, and prints the table; what is in FOLDER is not done again. The slow
test runs a part of it with seeds of its own. Misread logs in which the body moves by less than its
attitude's noise are counted apart: of them no more is asked than that nothing false is said.
"""

import argparse
import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from flights import GRADES, KINDS, MOTIONS, Mistake, flights, make_mistake

from twin.conventions import ConventionFinding, check_conventions
from twin.platform import Platform, load_platform

SEED = 2000
"""Of the first chunk; the next one has the next."""
CELLS = [(grade, motion) for motion in MOTIONS for grade in GRADES]
QUIET = {("coarse", "slow"), *((grade, "still") for grade in GRADES)}
"""Where the body moves by less than a sample of its attitude scatters."""
WRONG = 2
"""Misread logs of a chunk; one more is left right."""
LAG_ERROR = 0.1
"""A clock's offset is named rightly within this: the latencies of the logs are in it [s]."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--chunks", type=int, default=66)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    sads, rows = load_platform("sads"), list[dict]()
    for chunk in range(options.chunks):
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
    number = re.search(r"([\d.]+) s ", reading) if mistake.lag else None
    return number is None or abs(float(number[1]) - abs(mistake.lag)) < LAG_ERROR


def _terms(mistake: Mistake, reading: str) -> Iterable[str]:
    return [term for term in (mistake.stream, mistake.name) if term in reading]


def table(rows: list[dict]) -> str:
    """Recognised, by kind, grade and motion; every miss and every accusation in full."""
    right = [row for row in rows if row["kind"] == "right"]
    misread = [row for row in rows if row["kind"] != "right"]
    quiet = [row for row in misread if is_quiet(row)]
    moving = [row for row in misread if not is_quiet(row)]
    lines = [
        f"misread logs: {_counts(moving)}",
        f"misread logs too quiet to tell: {_counts(quiet)}",
        f"right logs: {sum(row['verdict'] == 'accused' for row in right)} of {len(right)} accused",
    ]
    for key in ("kind", "grade", "motion"):
        for value in dict.fromkeys(row[key] for row in moving):
            lines.append(f"  {value}: {_counts([row for row in moving if row[key] == value])}")
    for row in rows:
        if row["verdict"] in ("missed", "wrong", "accused"):
            where = f"seed {row['seed']}, {row['grade']}, {row['motion']}"
            said = " ".join(row["sentences"]) or "nothing"
            lines.append(f"{row['verdict']} ({where}) {row['mistake'] or 'a right log'}: {said}")
    return "\n".join(lines)


def is_quiet(row: dict) -> bool:
    """Whether a row's log shows too little to ask anything of it."""
    return (row["grade"], row["motion"]) in QUIET


def _counts(rows: list[dict]) -> str:
    count = {v: sum(row["verdict"] == v for row in rows) for v in ("named", "tied", "wrong")}
    return (
        f"{count['named'] + count['tied']} of {len(rows)} recognised ({count['tied']} in a tie), "
        f"{count['wrong']} called something else"
    )


if __name__ == "__main__":
    sys.exit(main())
