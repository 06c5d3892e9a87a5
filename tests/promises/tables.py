"""Counts of a panel's cases, each with what chance leaves open."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scoring import score

Row = dict[str, Any]

UP_TO_A_FACTOR = {"flexible_appendage": ("axis",), "room_draft": ("point", "force", "phase")}
"""Components that no log shows by themselves: the length of an axis, p and F of a p x F."""
BINS = 10
GAINED = 0.8
"""Share of the oracle's held-out gain that counts as all of it."""


def wilson(right: float, count: int) -> tuple[float, float]:
    """95 % bounds of a share."""
    z = 1.96
    middle = (right + z**2 / 2.0) / (count + z**2)
    half = z * np.sqrt(max(right * (count - right), 0.0) / count + z**2 / 4.0) / (count + z**2)
    return middle - half, middle + half


def share(values: Iterable[float]) -> str:
    """`17.5 of 20, 69% to 97%`."""
    every = list(values)
    if not every:
        return "-"
    low, high = wilson(sum(every), len(every))
    return f"{sum(every):g} of {len(every)}, {low:.0%} to {high:.0%}"


def table(head: Sequence[str], lines: Iterable[Sequence[Any]]) -> list[str]:
    """In Markdown."""
    rows = [head, ["---"] * len(head), *lines]
    return ["| " + " | ".join(map(str, row)) + " |" for row in rows]


def right(row: Row) -> list[dict[str, Any]]:
    """The causes that were named by their own names."""
    return [cause for cause in row["causes"] if cause["label"] in row["truth"]]


def inside(rows: Iterable[Row]) -> list[float]:
    """Of each component of a rightly named cause: whether its interval holds the truth."""
    found: list[float] = []
    for row in rows:
        for cause in right(row):
            truth = row["values"][row["truth"].index(cause["label"])]
            skipped = UP_TO_A_FACTOR.get(cause["label"], ())
            for name, value, half, true in zip(
                cause["names"], cause["values"], cause["half"], truth, strict=True
            ):
                if half is not None and not name.startswith(skipped or "-"):
                    found.append(float(abs(value - true) <= half))
    return found


def gains(rows: Iterable[Row]) -> list[float]:
    """Of each rightly named cause: whether it gained what the oracle did on held-out time."""
    return [
        float(row["gain"] >= GAINED * row["oracle_gain"])
        for row in rows
        if right(row) and row.get("oracle_gain")
    ]


def in_band(rows: Iterable[Row]) -> list[float]:
    """Of each rightly named cause: whether what it leaves is what a true model leaves."""
    return [float(row["band"][0] <= row["chi2"][1] <= row["band"][1]) for row in rows if right(row)]


def by_others(rows: Sequence[Row], how: str) -> list[float]:
    """Whether another method names the truth, or what nobody could tell from it."""
    if how == "commonest":
        labels = Counter(row["truth"][0].partition(":")[0] for row in rows)
        most = labels.most_common(1)[0][0] if labels else ""
        return [float(row["truth"][0].partition(":")[0] == most) for row in rows]
    return [float(row["others"][how] in (row["truth"][0], *row["siblings"])) for row in rows]


def members(rows: Iterable[Row]) -> str:
    """Mean size of an answer."""
    sizes = [1 + len(cause["ties"]) for row in rows for cause in row["causes"]]
    return f"{np.mean(sizes):.1f}" if sizes else "-"


def reliability(rows: Iterable[Row]) -> tuple[list[str], float]:
    """Confidence against how often it was deserved, and the expected calibration error."""
    told = [
        (cause["confidence"], float(cause["label"] in row["truth"] and row["kind"] != "left_out"))
        for row in rows
        for cause in row["causes"]
    ]
    if not told:
        return ["no cause was named"], 0.0
    confidence, true = np.array(told).T
    place = np.minimum((confidence * BINS).astype(int), BINS - 1)
    lines, error = [], 0.0
    for index in range(BINS):
        own = place == index
        if own.any():
            error += abs(float(np.sum(confidence[own] - true[own]))) / len(told)
            ends = f"{index / BINS:.1f} to {(index + 1) / BINS:.1f}"
            lines.append([ends, own.sum(), f"{confidence[own].mean():.3f}", share(true[own])])
    return table(["confidence", "causes", "mean", "were right"], lines), error


def worth(rows: Iterable[Row]) -> list[float]:
    """Scores."""
    return [score(row) for row in rows]


def seconds(rows: Sequence[Row]) -> str:
    """Median."""
    return f"{np.median([row['seconds'] for row in rows]):.0f}"
