"""Hidden effects, many times: how often is the cause named, and sized as it should be?

`make panel` hides, diagnoses, writes one JSON a case into runs/panel and then docs/diagnosis.md;
what is there is not done again, so it grows with each run and can be interrupted. Called by itself:
`python tests/promises/panel.py FOLDER [--cases 10] [--evidence 0,60,600,6000] [--grades middle]`.
"""

import argparse
import json
import sys
import time
import traceback
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from hidden import GRADES, SHAPED, Bench, Hidden, drawn, hide, yardstick  # noqa: E402

from twin.diagnose import Diagnosis, diagnose  # noqa: E402

PAGE = Path(__file__).parents[2] / "docs" / "diagnosis.md"
HEAD = """# How often a hidden cause is found

Written by `make panel`. Each log of `sads` under `quaternion_pd` hides one effect, drawn at random
in kind, target, direction and sign, and as large as the evidence in the table: what a perfect
method would have, the squared length of the effect's whitened signature with the base projected
out. The machine that is simulated moves on half the step, and its J and m r are up to 5 % off what
the diagnosis believes. An answer counts in full where the cause is named alone or in a tie of at
most three, and half in a larger tie. Effects that have a frequency are not in it, nor are those
that this motion does not show.

- *members*: mean size of an answer, the named cause and its ties
- *covered*: components whose 95 % interval holds the truth, of causes that were named themselves
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--evidence", default="0,60,600,6000")
    parser.add_argument("--grades", default="middle")
    parser.add_argument("--duration", type=float, default=120.0)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for seed in range(options.first, options.first + options.cases):
        for grade in options.grades.split(","):
            for evidence in map(int, options.evidence.split(",")):
                bench = Bench(grade=grade, duration=options.duration)
                path = options.folder / f"{grade}-{options.duration:g}-{evidence}-{seed:04d}.json"
                if not path.exists():
                    path.write_text(json.dumps(case(bench, evidence, seed)))
    rows = [json.loads(path.read_text()) for path in sorted(options.folder.glob("*.json"))]
    PAGE.write_text(page(rows), encoding="utf-8")
    print(page(rows))
    return 0


def case(bench: Bench, evidence: int, seed: int) -> dict[str, Any]:
    """One log, hidden and diagnosed; which effect is drawn by the seed."""
    rng = np.random.default_rng([seed, evidence, len(bench.grade)])
    row: dict[str, Any] = {"grade": bench.grade, "evidence": evidence, "seed": seed, "truth": []}
    effects = ()
    if evidence:
        weighing, asked = yardstick(bench)
        names = [c.label for i, c in enumerate(asked) if weighing.shown(i)]
        names = [n for n in names if not n.startswith(SHAPED)]
        kinds = sorted({name.partition(":")[0] for name in names})
        kind = rng.choice(kinds)
        label = rng.choice([name for name in names if name.partition(":")[0] == kind])
        effect = drawn(bench, label, evidence, rng)
        if effect is None:
            return row | {"truth": [label], "skipped": "beyond its bounds"}
        effects = (effect,)
    hidden = hide(bench, effects, seed + 1000)
    if hidden is None:
        return row | {"skipped": "the machine cannot have it"}
    begin = time.perf_counter()
    try:
        found = diagnose([hidden.log], hidden.believed)
    except Exception:
        return row | {"truth": [e.label for e in effects], "failed": traceback.format_exc()}
    return row | facts(hidden, found) | {"seconds": time.perf_counter() - begin}


def facts(hidden: Hidden, found: Diagnosis) -> dict[str, Any]:
    return {
        "truth": [effect.label for effect in hidden.effects],
        "values": [effect.values.tolist() for effect in hidden.effects],
        "verdict": found.verdict,
        "causes": [
            {
                "label": cause.effect.label,
                "values": cause.effect.values.tolist(),
                "half": cause.half_widths.tolist(),
                "evidence": cause.evidence,
                "confidence": cause.confidence,
                "ties": {tie.label: tie.behind for tie in cause.ties},
            }
            for cause in found.causes
        ],
        "equation": None
        if found.equation is None
        else {
            law.label: v
            for law, v in zip(found.equation.laws, found.equation.coefficients, strict=True)
        },
        "remainder": [found.remainder.torque_chance, found.remainder.noise_chance],
        "gain": [found.held_out.log_likelihood, found.held_out.before, found.held_out.after],
        "band": [found.held_out.low, found.held_out.high],
        "settled": found.explained.converged,
    }


def page(rows: list[dict[str, Any]]) -> str:
    """docs/diagnosis.md."""
    lines = [HEAD, "| grade | evidence | logs | answered | Wilson 95 % | members | covered | s |"]
    lines.append("| --- | --- | --- | --- | --- | --- | --- | --- |")
    misses: list[str] = []
    for grade in GRADES:
        for evidence in sorted({row["evidence"] for row in rows}):
            own = [r for r in rows if r["grade"] == grade and r["evidence"] == evidence]
            done = [row for row in own if "verdict" in row]
            if done:
                lines.append(line(grade, evidence, done))
                misses += [miss(row) for row in done if score(row) < 1.0]
            misses += [f"- {grade}, {evidence}, seed {row['seed']}: failed" for row in own
                       if "failed" in row]  # fmt: skip
            away = [row for row in own if "skipped" in row]
            if away:
                labels = ", ".join(str(row["truth"][0]) for row in away)
                misses.append(f"- {grade}, {evidence}: not detectable here: {labels}")
    return "\n".join([*lines, "", "## Not fully answered", "", *(misses or ["none"]), ""])


def line(grade: str, evidence: int, rows: list[dict[str, Any]]) -> str:
    """One of the table."""
    right = [score(row) for row in rows]
    low, high = wilson(sum(right), len(rows))
    members = [1 + len(cause["ties"]) for row in rows for cause in row["causes"]]
    inside, count = 0, 0
    for row in rows:
        for cause in row["causes"]:
            if [cause["label"]] == row["truth"]:
                half = np.array(cause["half"], dtype=float)
                error = np.abs(np.array(cause["values"]) - row["values"][0])
                inside += int(np.sum(error <= half))
                count += int(np.sum(np.isfinite(half)))
    what = "nothing hidden" if not evidence else str(evidence)
    return (
        f"| {grade} | {what} | {len(rows)} | {sum(right):g} | {low:.0%} to {high:.0%} | "
        f"{np.mean(members) if members else 0:.1f} | {inside} of {count} | "
        f"{np.median([row['seconds'] for row in rows]):.0f} |"
    )


def score(row: dict[str, Any]) -> float:
    """1 for the right answer: nothing, the cause, or a tie of at most three that holds it; half for
    a larger one."""
    if not row["truth"]:
        return float(row["verdict"] == "healthy")
    if len(row["causes"]) != 1 or row["verdict"] == "unexplained":
        return 0.0
    (cause,) = row["causes"]
    members = {cause["label"], *cause["ties"]}
    if row["truth"][0] not in members:
        return 0.0
    return 1.0 if len(members) <= 3 else 0.5


def miss(row: dict[str, Any]) -> str:
    """What was said instead."""
    said = [f"{c['label']} (tied: {', '.join(c['ties']) or 'none'})" for c in row["causes"]]
    laws = f", laws {', '.join(row['equation'])}" if row["equation"] else ""
    hidden = row["truth"][0] if row["truth"] else "nothing"
    return (
        f"- {row['grade']}, {row['evidence']}, seed {row['seed']}: {hidden} was {row['verdict']}: "
        f"{'; '.join(said) or 'no cause'}{laws}"
    )


def wilson(right: float, count: int) -> tuple[float, float]:
    """95 % bounds of a share."""
    z = 1.96
    middle = (right + z**2 / 2.0) / (count + z**2)
    half = z * np.sqrt(right * (count - right) / count + z**2 / 4.0) / (count + z**2)
    return middle - half, middle + half


if __name__ == "__main__":
    raise SystemExit(main())
