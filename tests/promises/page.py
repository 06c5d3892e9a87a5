"""docs/diagnosis.md, from the cases that are there."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from benches import GRADES, LIBRARY
from hidden import UNSEEN
from scoring import SURE, score, single
from tables import (
    Row,
    by_others,
    gains,
    in_band,
    inside,
    members,
    reliability,
    right,
    seconds,
    share,
    table,
    worth,
)

HEAD = """# How often a hidden cause is found

Written by `make panel`, which grows it. Effects are drawn at random: the kind first, each alike
often, then a machine and a motion that show it, then target, shape, direction and sign. The size
is such that the evidence is what the table says: what a perfect method would have, the squared
length of the effect's whitened signature with the base projected out. Of what has a frequency or a
place it is met to a fifth, in a run with the effect: a law answers to what rings; likewise of what
the base does nearly all of (since 56eb588). The machine that is simulated moves on half the step,
and its J and m r are up to 5 % off what the diagnosis believes.

An answer counts in full where the cause is named alone, or in a tie of at most three in which
nobody could tell the others from it: with the true effect and no noise they would be less than 6
behind in evidence, or in likelihood alone. In any other tie it counts half. Shares come with their
95 % bounds (Wilson).

- *oracle*: knows that it is the true cause or one that nobody could tell from it
- *correlation*: names the column that the residual is most along
- *all free*: every amplitude of the catalogue fitted at once by least squares, in the linearised
  problem, which is what a solver with all parameters free comes to there; names the one that is
  most standard deviations from 0
- *commonest*: always names the kind that was drawn most often
- *members*: mean size of an answer, the named cause and its ties
- *covered*: components whose 95 % interval holds the truth, of causes named by their own name
- *gain*: those of them with at least 80 % of the held-out gain of the true effect's own fit
- *in band*: those whose held-out chi-square is what a true model leaves

Two effects of which one cause alone would be less than 6 behind in evidence, without noise, are no
pair and no case.

The other methods are given the cases where they name what nobody could tell from the truth.
"""
GRADES_IN_WORDS = ", ".join(
    f"{name}: gyro {gyro:g} rad/s, attitude {attitude:g} rad"
    for name, (gyro, attitude) in GRADES.items()
)
LISTED = 6
"""Ties that a line names."""
UNSEEN_WHY = {
    "wheel_imbalance": "no log holds the angles of wheels, so it has no signature",
    "stage_vibration": "it adds noise and changes no expected value",
}


def rows_of(path: Path) -> list[Row]:
    """Every case of a file as it was done last, the one longest ago first."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    latest: dict[tuple[str, int, int], Row] = {}
    for row in map(json.loads, lines):
        key = row["kind"], row["evidence"], row["seed"]
        latest.pop(key, None)
        latest[key] = row
    return list(latest.values())


def page(rows: list[Row]) -> str:
    """The whole of it."""
    rows = sorted(rows, key=lambda row: (row["kind"], row["evidence"], row["seed"]))
    done = [row for row in rows if "verdict" in row and "failed" not in row]
    lines = [HEAD, *_provenance(rows), "", "## One effect", "", *_singles(done), ""]
    lines += ["## Nothing, two, or what the catalogue lacks", "", *_others(done), ""]
    lines += ["## By effect", "", *_by_effect(done), "", "## Confidence", "", *_confidence(done)]
    lines += ["", "## Not fully answered", "", *([_miss(r) for r in _missed(done)] or ["none"])]
    lines += [
        "",
        "## Drawn and not hidden",
        "",
        *_not_hidden(rows),
        "",
        "## Failures",
        "",
        *_failed(rows),
    ]
    return "\n".join(lines) + "\n"


def _of(rows: Sequence[Row], kind: str) -> list[Row]:
    return [row for row in rows if row["kind"] == kind]


def _provenance(rows: Sequence[Row]) -> list[str]:
    versions = Counter(row["version"] for row in rows)
    long = sum(row["long"] for row in rows if "verdict" in row)
    return [
        f"Sensors: {GRADES_IN_WORDS}. Logs are of 120 s at 50 Hz, {long} of 300 s at 100 Hz.",
        f"Machines and motions: {'; '.join(bench.words for bench in LIBRARY)}.",
        f"Cases by version: {', '.join(f'{k}: {v}' for k, v in versions.items()) or 'none'}.",
    ]


def _singles(rows: list[Row]) -> list[str]:
    own = _of(rows, "single")
    head = ["evidence", "logs of", "answered", "oracle", "correlation", "all free", "commonest",
            "members", "covered", "gain", "in band", "s"]  # fmt: skip
    lines: list[list[str]] = []
    for evidence in sorted({row["evidence"] for row in own}):
        level = [row for row in own if row["evidence"] == evidence]
        groups = {"all": level}
        groups |= {grade: [r for r in level if r["grade"] == grade] for grade in GRADES}
        groups["300 s, 100 Hz"] = [row for row in level if row["long"]]
        lines += [_single(evidence, name, group) for name, group in groups.items() if group]
    runs = [r["free_run"] for r in own if right(r) and r["free_run"]]
    far = np.array([[best / perfect, built / perfect] for built, best, perfect in runs])
    free = (
        [f"Free runs of 60 s of rightly extended models end a median of {np.median(far[:, 0]):.2f} "
         f"times as far off as a perfect model's; as built {np.median(far[:, 1]):.2f} times."]
        if runs else []
    )  # fmt: skip
    return [*table(head, lines), "", *free]


def _single(evidence: int, name: str, rows: list[Row]) -> list[str]:
    oracle = [single(r["truth"][0], r["others"]["oracle"], r["siblings"]) for r in rows]
    others = [by_others(rows, how) for how in ("correlation", "all free", "commonest")]
    return [
        str(evidence), name, share(worth(rows)), f"{np.mean(oracle):.0%}",
        *(f"{np.mean(one):.0%}" for one in others), members(rows),
        share(inside(rows)), share(gains(rows)), share(in_band(rows)), seconds(rows),
    ]  # fmt: skip


def _others(rows: list[Row]) -> list[str]:
    lines: list[list[str]] = []
    null = _of(rows, "null")
    if null:
        alarms = [1.0 - one for one in worth(null)]
        lines.append(["nothing hidden", "false alarms", share(alarms), seconds(null)])
    for kind, words, promise in (
        ("pair", "two effects", "both named, nothing else"),
        ("outside", "a law that the catalogue lacks", f"unexplained, no name above {SURE}"),
        ("left_out", "an effect, not asked for", f"unexplained or a tie, no name above {SURE}"),
    ):
        for evidence in sorted({row["evidence"] for row in _of(rows, kind)}):
            own = [row for row in _of(rows, kind) if row["evidence"] == evidence]
            lines.append([f"{words}, {evidence}", promise, share(worth(own)), seconds(own)])
    outside = [row["gain"] for row in _of(rows, "outside") if row["equation"]]
    more: list[str] = []
    if outside:
        more = [
            "",
            f"Where a law was given as an equation ({len(outside)} logs), its held-out "
            f"log-likelihood gain was {np.median(outside):.0f} in the median, "
            f"{min(outside):.0f} at the least.",
        ]
    covered = share(inside(_of(rows, "single") + _of(rows, "pair")))
    more += ["", f"Intervals of all rightly named causes that hold the truth: {covered}."]
    return [*table(["hidden", "promise", "logs", "s"], lines), *more]


def _by_effect(rows: list[Row]) -> list[str]:
    own = _of(rows, "single")
    levels = sorted({row["evidence"] for row in own})
    kinds = sorted({row["truth"][0].partition(":")[0] for row in own})
    lines = []
    for kind in kinds:
        every = [row for row in own if row["truth"][0].partition(":")[0] == kind]
        cells = [[row for row in every if row["evidence"] == level] for level in levels]
        said = Counter(
            cause["label"].partition(":")[0]
            for row in every
            for cause in row["causes"]
            if cause["label"].partition(":")[0] != kind
        )
        wrong = ", ".join(f"{name} {count}" for name, count in said.most_common())
        counts = [f"{sum(worth(cell)):g} of {len(cell)}" if cell else "-" for cell in cells]
        lines.append([kind, *counts, wrong or "-"])
    return table(["hidden", *map(str, levels), "named first instead"], lines)


def _confidence(rows: list[Row]) -> list[str]:
    lines, error = reliability(rows)
    return [
        "Of every cause named in any log, how sure the diagnosis was and whether it was hidden "
        "there.", "", *lines, "", f"Expected calibration error: {error:.3f}.",
    ]  # fmt: skip


def _missed(rows: list[Row]) -> list[Row]:
    return [row for row in rows if score(row) < 1.0]


def _miss(row: Row) -> str:
    """What was said instead, and why that is less than could have been known."""
    said = [
        f"{c['label']} at {c['confidence']:.2f} (tied: {_some(list(c['ties']))})"
        for c in row["causes"]
    ]
    laws = f", laws {', '.join(row['equation'])}" if row["equation"] else ""
    hidden = " and ".join(row["truth"]) or "nothing"
    where = f"{row['bench']}, {row['grade']}{', long' if row['long'] else ''}"
    return (
        f"- {row['kind']} {row['evidence']}, {row['seed']} ({where}): {hidden} was "
        f"{row['verdict']}: {'; '.join(said) or 'no cause'}{laws}. {_reason(row)}"
    )


def _some(labels: Sequence[str]) -> str:
    """The nearest, and how many more."""
    more = len(labels) - LISTED
    listed = ", ".join(labels[:LISTED]) or "none"
    return f"{listed} and {more} more" if more > 0 else listed


def _reason(row: Row) -> str:
    if row["kind"] != "single":
        return ""
    truth, causes, verdict = row["truth"][0], row["causes"], row["verdict"]
    also = "" if truth in row["others"]["oracle"] else " The oracle misses it too."
    if not causes:
        return f"Nothing was named.{also}"
    if len(causes) > 1:
        return f"{len(causes)} causes were named for one.{also}"
    named = [causes[0]["label"], *causes[0]["ties"]]
    if truth not in named:
        return f"The name is wrong.{also}"
    if verdict == "unexplained":
        return f"The cause is among those named, but something more seemed to be left.{also}"
    apart = [one for one in named if one != truth and one not in row["siblings"]]
    if apart:
        return f"Without noise {', '.join(apart)} could be told from it.{also}"
    return f"A tie of {len(named)} that nobody could split."


def _not_hidden(rows: Sequence[Row]) -> list[str]:
    why = [f"- {name} is on no bench: {UNSEEN_WHY[name]}" for name in UNSEEN]
    skipped = Counter(
        f"{row['kind']}, {row['evidence']}: {row['skipped']}" for row in rows if "skipped" in row
    )
    return why + [f"- {words} ({count})" for words, count in sorted(skipped.items())]


def _failed(rows: Sequence[Row]) -> list[str]:
    failed = [row for row in rows if "failed" in row]
    if not failed:
        return ["none"]
    lines: list[str] = []
    for row in failed:
        truth = " and ".join(row["truth"]) or "nothing"
        name = f"{row['kind']}-{row['evidence']}-{row['seed']:04d}"
        last = row["failed"].strip().splitlines()[-1]
        lines.append(f"- {name} ({row.get('bench', '?')}): {truth}: {last}")
    return lines
