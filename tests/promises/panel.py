"""Hidden effects, many times: how often is the cause named, sized and worth what it should be?

`python tests/promises/panel.py FOLDER [--cases 10] [--evidence 60,600,6000] [--grades middle]
[--only none,...]` hides, diagnoses and writes one JSON a case into FOLDER; what is there is not
done again, so it grows and can be interrupted. Then it prints the table.
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
from hidden import SHAPED, Bench, Hidden, drawn, hide, yardstick  # noqa: E402

from twin.diagnose import Diagnosis, diagnose  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--evidence", default="0,60,600,6000")
    parser.add_argument("--grades", default="middle")
    parser.add_argument("--duration", type=float, default=120.0)
    parser.add_argument("--table", action="store_true", help="print the table only")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for seed in range(options.first, options.first + options.cases):
        for grade in options.grades.split(","):
            for evidence in map(int, options.evidence.split(",")):
                bench = Bench(grade=grade, duration=options.duration)
                path = options.folder / f"{grade}-{options.duration:g}-{evidence}-{seed:04d}.json"
                if not options.table and not path.exists():
                    path.write_text(json.dumps(case(bench, evidence, seed)))
    print(table([json.loads(p.read_text()) for p in sorted(options.folder.glob("*.json"))]))
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


def table(rows: list[dict[str, Any]]) -> str:
    lines: list[str] = []
    for grade in sorted({row["grade"] for row in rows}):
        for evidence in sorted({row["evidence"] for row in rows}):
            own = [r for r in rows if r["grade"] == grade and r["evidence"] == evidence]
            if own:
                lines += line(grade, evidence, own)
    return "\n".join(lines)


def line(grade: str, evidence: int, rows: list[dict[str, Any]]) -> list[str]:
    failed = [row for row in rows if "failed" in row]
    done = [row for row in rows if "verdict" in row]
    head = f"{grade} at {evidence}: {len(done)} of {len(rows)} done, {len(failed)} failed"
    said = [f"   failed seed {r['seed']} {r['truth']}: {r['failed'][-200:]}" for r in failed]
    if not done:
        return [head, *said]
    seconds = np.median([row["seconds"] for row in done])
    if not evidence:
        wrong = [row for row in done if row["verdict"] != "healthy"]
        said += [
            f"   seed {r['seed']}: {r['verdict']} {[c['label'] for c in r['causes']]} "
            f"{r['equation']} {r['remainder']}"
            for r in wrong
        ]
        return [f"{head}; {len(wrong)} false alarms; {seconds:.1f} s", *said]
    scores, inside, count = [], 0, 0
    for row in done:
        truth = row["truth"][0]
        labels = [cause["label"] for cause in row["causes"]]
        score = 0.0
        if len(labels) == 1 and row["verdict"] != "unexplained":
            cause = row["causes"][0]
            members = {labels[0], *cause["ties"]}
            if labels[0] == truth and not cause["ties"]:
                score = 1.0
            elif truth in members:
                score = 1.0 if len(members) <= 3 else 0.5
        scores.append(score)
        if score < 1.0:
            named = [(c["label"], round(c["evidence"]), list(c["ties"])) for c in row["causes"]]
            said.append(
                f"   seed {row['seed']} {truth}: {row['verdict']} {named} "
                f"{row['equation']} p {row['remainder']}"
            )
        for cause in row["causes"]:
            if cause["label"] == truth:
                error = np.abs(np.array(cause["values"]) - row["values"][0])
                half = np.array(cause["half"], dtype=float)
                inside += int(np.sum(error <= half))
                count += int(np.sum(np.isfinite(half)))
    return [
        f"{head}; named {np.mean(scores):.3f}, covered {inside}/{count}; {seconds:.1f} s",
        *said,
    ]


if __name__ == "__main__":
    raise SystemExit(main())
