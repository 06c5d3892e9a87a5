"""What an answer is worth, beside what any method could have known."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from benches import Yardstick, machine

from twin.diagnosis import Diagnosis
from twin.diagnosis.screen import TIED, LinearScreen, Search, price
from twin.effects import Effect
from twin.effects.body import LiquidSlosh
from twin.effects.effect import EffectError
from twin.platform import Platform
from twin.predict.columns import amplitudes

SURE = 0.9
"""Confidence beyond which a wrong name is worse than none."""


def behind(measure: Yardstick, truth: Effect) -> dict[str, float]:
    """How far behind the truth each cause would be, by label, were there no noise at all.

    In evidence, with the price that the search takes, or in likelihood alone if that is less: what
    only its freedom speaks against could be it. A cause that has a frequency at that of the truth
    too.
    """
    platform = machine(measure.bench)
    frequency = _frequency(truth, platform.gravity)
    if frequency is None:
        own = measure.labels.index(truth.label)
        return _behind(measure.screen, own, truth)
    shapes = [
        shape for effect in measure.effects for shape in shapes_at(effect, frequency, platform)
    ]
    screen, every = measure.beside(*shapes, truth)
    return _behind(screen, len(every) - 1, truth)


def shapes_at(effect: Effect, hertz: float, platform: Platform) -> tuple[Effect, ...]:
    """In which it rings or pushes at a frequency, if it can, on a machine that can have them."""
    try:
        shapes = effect.at_frequency(hertz, platform.gravity)
    except EffectError:
        return ()
    return tuple(shape for shape in shapes if not shape.unfit(platform))


def _frequency(effect: Effect, gravity: float) -> float | None:
    """At which it rings or pushes [Hz]."""
    if isinstance(effect, LiquidSlosh):
        return float(np.sqrt(gravity / effect.length)) / (2.0 * np.pi)
    return getattr(effect, "frequency", None)


def _behind(screen: LinearScreen, own: int, truth: Effect) -> dict[str, float]:
    values = truth.values[amplitudes(truth)]
    traces = screen.traces
    silent = screen.showing(screen.signature(own, values))
    best: dict[str, float] = {}
    top, most = _evidence(silent, own), silent.weigh((own,)).gain
    for index, trace in enumerate(traces):
        if screen.identifiable(index) and trace.label != truth.label:
            far = min(top - _evidence(silent, index), most - silent.weigh((index,)).gain)
            best[trace.label] = min(far, best.get(trace.label, np.inf))
    return best


def _evidence(screen: LinearScreen, index: int) -> float:
    gain = max(screen.weigh((index,)).gain, 0.0)
    return gain - price(gain, screen.information(index))


def siblings(behind: dict[str, float]) -> list[str]:
    """Those that no method could tell from the truth in this log."""
    return sorted(label for label, far in behind.items() if far < TIED)


def stand_ins(measure: Yardstick, truths: Sequence[Effect]) -> list[str]:
    """Causes, by label, that alone would be next to nothing behind these together in evidence, were
    there no noise at all. What has a frequency is taken at its usual one."""
    own = tuple(measure.labels.index(truth.label) for truth in truths)
    does = [
        measure.screen.signature(index, truth.values[amplitudes(truth)])
        for index, truth in zip(own, truths, strict=True)
    ]
    search = Search(measure.screen.showing(np.sum(does, axis=0)), ())
    whole = search.evidence(own)
    return [
        label
        for index, label in enumerate(measure.labels)
        if whole - search.evidence((index,)) < TIED
    ]


def single(truth: str, members: list[str], alike: Sequence[str]) -> float:
    """1 where the truth is named alone, or in a tie of at most three that nobody could split; half
    in another tie; 0 where it is in none."""
    if truth not in members:
        return 0.0
    honest = all(one == truth or one in alike for one in members)
    return 1.0 if len(members) == 1 or (len(members) <= 3 and honest) else 0.5


def answers(found: Diagnosis) -> list[list[str]]:
    """Of each cause, its label and those of its ties."""
    return [[one.effect.label, *(tie.label for tie in one.ties)] for one in found.causes]


def facts(found: Diagnosis) -> dict[str, Any]:
    """A diagnosis as a case keeps it."""
    minute = found.free_runs.get(60.0)
    return {
        "verdict": found.verdict,
        "causes": [
            {
                "label": cause.effect.label,
                "names": cause.effect.names,
                "values": cause.effect.values.tolist(),
                "half": [float(x) if np.isfinite(x) else None for x in cause.half_widths],
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
        "remainder": [found.residual_test.torque_chance, found.residual_test.noise_chance],
        "follows": found.explained.follows,
        "conventions": [str(finding.kind) for finding in found.conventions],
        "gain": found.held_out.log_likelihood,
        "chi2": [found.held_out.before, found.held_out.after],
        "band": [found.held_out.low, found.held_out.high],
        "free_run": None if minute is None else list(minute.errors),
        "settled": found.explained.converged,
    }


def score(row: dict[str, Any]) -> float:
    """Of a case, by what is hidden in it."""
    members = [[one["label"], *one["ties"]] for one in row["causes"]]
    sure = any(one["confidence"] > SURE for one in row["causes"])
    match row["kind"]:
        case "null":
            return float(row["verdict"] == "healthy")
        case "single":
            if len(members) != 1 or row["verdict"] == "unexplained":
                return 0.0
            return single(row["truth"][0], members[0], row["siblings"])
        case "pair":
            named = all(any(truth in one for one in members) for truth in row["truth"])
            return float(named and len(members) == 2)
        case "outside":
            return float(row["verdict"] == "unexplained" and not sure)
        case _:  # left out
            return float(row["verdict"] in ("unexplained", "ambiguous") and not sure)
