"""A diagnosis as one HTML page, its figures and its JSON document."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from twin.comparison import log_name
from twin.diagnosis import Cause, Diagnosis, Experiment, Validation
from twin.files import write_whole
from twin.identification.prediction_error import NORMAL
from twin.platform import taken_as_at_rest
from twin.report.diagnosed import (
    cause_sentences,
    common_clock_sentences,
    could_show,
    diagnosed,
    equation_sentence,
    equation_text,
    experiment_document,
    experiment_sentence,
    first_of,
    push_sentence,
    validated,
    verdict_sentence,
)
from twin.report.document import free_run_document
from twin.report.figures import BEST, BUILT, drawn_motion, drawn_residuals, run_caption, run_to_show
from twin.report.style import (
    FIGURE,
    INK,
    PALETTE,
    SOFT,
    Drawing,
    PageTable,
    Part,
    bullets,
    foot,
    opened,
    page,
    rendered,
    typeset,
)
from twin.report.words import MEANINGFUL, pair
from twin.units import three_digits

BAND = "#e3edf2"
BEFORE, AFTER = PALETTE[1], PALETTE[0]
LISTED = 18
"""Causes that are drawn, the strongest alone first."""


def prediction_figure(diagnosis: Diagnosis) -> Figure:
    """Of the first log, the measured motion, and free runs of the model without the causes and with
    them."""
    body = diagnosis.explained.bodies[0]
    run = run_to_show(diagnosis.free_runs, body)
    return drawn_motion(body.motion, run, before="before", after="after")


def residual_figure(diagnosis: Diagnosis) -> Figure:
    """Of the first log, the residual of each stream, without the causes and with them."""
    accounts = [
        (diagnosis.baseline.account, BUILT, "before"),
        (diagnosis.explained.account, BEST, "after"),
    ]
    return drawn_residuals(diagnosis.explained.bodies[0], accounts)


def before_after_figure(diagnosis: Diagnosis) -> Figure:
    """Chi-square a sample of each stream over time, without the causes and with them."""
    with mpl.rc_context(FIGURE):
        before = diagnosis.baseline.account.misfits
        after = diagnosis.explained.account.misfits
        streams = list(dict.fromkeys(part.stream for part in after))
        figure = Figure(figsize=(9.6, 0.8 + 1.8 * len(streams)))
        panels = figure.subplots(len(streams), 1, squeeze=False, sharex=True)[:, 0]
        for panel, stream in zip(panels, streams, strict=True):
            top = 1.0
            for parts, color, label in ((before, BEFORE, "before"), (after, AFTER, "after")):
                own = [part for part in parts if part.stream == stream]
                mean = np.mean([part.block_chi2 for part in own], axis=0)
                panel.plot(own[0].block_time, mean, "o-", ms=3.5, color=color, label=label)
                top = max(top, float(mean.max()))
            own = [part for part in after if part.stream == stream]
            half = (own[0].block_band - 1.0) / np.sqrt(len(own))
            panel.fill_between(
                own[0].block_time, *(1.0 + half.T), color=BAND, lw=0.0, label="a true model, 95 %"
            )
            if top > 5.0:
                panel.set_yscale("log")
            panel.set_ylabel(f"{stream}\nchi² a sample")
        panels[0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        panels[-1].set_xlabel("time [s]")
        return figure


def evidence_figure(diagnosis: Diagnosis) -> Figure:
    """What each cause explains on its own, and what it still adds beside those that were found."""
    with mpl.rc_context(FIGURE):
        rows = [(c.effect.label, c.alone, c.evidence, True) for c in diagnosis.causes]
        rows += [(t.label, t.alone, t.evidence, False) for t in diagnosis.tried]
        rows = sorted(rows, key=lambda row: -row[1])[:LISTED]
        figure = Figure(figsize=(9.6, 1.0 + 0.3 * len(rows)))
        panel = figure.subplots()
        for place, (_, alone, beside, chosen) in enumerate(rows):
            panel.barh(-place + 0.17, max(alone, 0.0), height=0.3, color=SOFT, alpha=0.45)
            color = AFTER if chosen else BEFORE
            panel.barh(-place - 0.17, max(beside, 0.0), height=0.3, color=color)
        panel.set_xscale("symlog", linthresh=10.0)
        panel.set_xlim(0.0, 1.5 * max([row[1] for row in rows] + [10.0]))
        panel.set_yticks(
            [-place for place in range(len(rows))],
            [label.replace("_", " ").replace(":", " of ") for label, *_ in rows],
            color=INK,
        )
        panel.grid(visible=False, axis="y")
        for color, label in (
            (SOFT, "on its own"),
            (AFTER, "named: what is lost without it"),
            (BEFORE, "not named: what it would add"),
        ):
            panel.plot([], [], "s", color=color, label=label)
        panel.legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        panel.set_xlabel("evidence: fall of −2 log likelihood, less the price of its numbers")
        return figure


def write_diagnosis(path: Path, diagnosis: Diagnosis, gain: Validation | None) -> None:
    """Write the page."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, diagnosis_page(diagnosis, gain))


def diagnosis_page(diagnosis: Diagnosis, gain: Validation | None = None) -> str:
    """The page as text."""
    under = foot(diagnosis.recordings, [diagnosis.platform])
    return page(_title(diagnosis), rendered([*diagnosis_parts(diagnosis, gain), under]))


def _title(diagnosis: Diagnosis) -> str:
    names = ", ".join(map(log_name, diagnosis.recordings))
    return f"Diagnosis of {names} on {diagnosis.platform.name}"


def diagnosis_parts(diagnosis: Diagnosis, gain: Validation | None = None) -> list[Part]:
    """What the page is made of."""
    length = sum(log.stop - log.start for log in diagnosis.recordings)
    verdict = verdict_sentence(diagnosis)
    own = cause_sentences(diagnosis) + common_clock_sentences(diagnosis)
    if diagnosis.equation is not None:
        own.append(equation_sentence(diagnosis.equation))
    if diagnosis.pushes:
        own.insert(0, push_sentence(diagnosis.pushes))
    told = [verdict, *own]
    if diagnosis.next_experiment is not None:
        told.append(experiment_sentence(diagnosis.next_experiment))
    sizes = could_show(diagnosis)
    rest = [said for said in diagnosed(diagnosis) if said not in (*told, *sizes)]
    first = first_of(diagnosis)
    curves = f"{first} that has it" if first else ""
    candidates = len(diagnosis.tried) + len(diagnosis.causes)
    under = f"{diagnosis.platform.title} · {length:.3g} s · {candidates} candidates"
    parts = [
        *opened(_title(diagnosis), under, verdict, own),
        "<h2>Measured and predicted</h2>",
        Drawing("free_runs", prediction_figure(diagnosis), _run_caption(diagnosis)),
        Drawing(
            "residuals",
            residual_figure(diagnosis),
            "Measured less predicted. What lies outside the frame belongs to the worst stretches.",
        ),
        "<h2>Before and after</h2>",
        Drawing(
            "before_and_after",
            before_after_figure(diagnosis),
            f"Mean squared innovation of each stream{curves}, in units of its noise, over blocks "
            "of time: the machine with its base refitted, without the causes and with them.",
        ),
        _gain_table(diagnosis),
    ]
    if gain is not None:
        parts.append(f"<p>{escape(typeset(validated(gain)))}</p>")
    parts += [
        "<h2>The causes, ranked</h2>",
        Drawing(
            "evidence",
            evidence_figure(diagnosis),
            "Causes that look alike all explain much on their own; beside the one that is named "
            "the others explain nothing more.",
        ),
    ]
    if any(cause.ties for cause in diagnosis.causes):
        parts += ["<h2>Ties</h2>", _ties_table(diagnosis)]
    if diagnosis.next_experiment is not None:
        parts += _experiment(diagnosis.next_experiment)
    parts += ["<h2>The base</h2>", _base_table(diagnosis), "<h2>Details</h2>"]
    parts.append(bullets(rest))
    if sizes:
        lines = "\n".join(escape(typeset(said)) for said in sizes)
        parts += ["<h2>Detectable sizes</h2>", f"<pre>{lines}</pre>"]
    return parts


def _run_caption(diagnosis: Diagnosis) -> str:
    return run_caption(run_to_show(diagnosis.free_runs, diagnosis.explained.bodies[0]))


def _gain_table(diagnosis: Diagnosis) -> PageTable:
    gain = diagnosis.held_out
    first = first_of(diagnosis)
    rows = [
        [
            "chi-square a sample, held-out blocks",
            f"{gain.before:.4f}",
            f"{gain.after:.4f}",
            f"{gain.low:.4f} to {gain.high:.4f}",
        ]
    ]
    if not diagnosis.explained.follows or np.isnan(gain.after):
        # each segment counts by its own scatter: no chi-square is to be expected; or none was held
        rows = []
    for horizon, run in diagnosis.free_runs.items():
        if run is not None and run.errors[1] < MEANINGFUL:
            before, after, perfect = (f"{np.degrees(error):.3g} deg" for error in run.errors)
            rows.append(
                [f"free run of {horizon:g} s{first}, typical error", before, after, perfect]
            )
    return PageTable("gain", ["", "before", "after", "a true model"], rows)


def _ties_table(diagnosis: Diagnosis) -> PageTable:
    rows = [
        [cause.effect.label, tie.label, f"{tie.behind:.1f}"]
        for cause in diagnosis.causes
        for tie in cause.ties
    ]
    return PageTable("ties", ["named", "could be instead", "evidence behind"], rows)


def _experiment(best: Experiment) -> list[Part]:
    """The command, if it is worth it, and what each tied cause would be behind after it."""
    rows = [
        [label, f"{split:.1f}", f"{best.repeated[label]:.1f}"]
        for label, split in best.splits.items()
    ]
    title = "An experiment that splits the ties" if best.enough else "What could be tried next"
    return [
        f"<h2>{title}</h2>",
        *([f"<pre>{escape(best.command)}</pre>"] if best.enough else []),
        f"<p>{escape(experiment_sentence(best))}</p>",
        PageTable(
            "next_experiment",
            ["could be instead", "behind after it", "after the same logs once more"],
            rows,
        ),
    ]


def _base_table(diagnosis: Diagnosis) -> PageTable:
    base = diagnosis.explained.base
    rows: list[Sequence[str]] = []
    sides = [
        (item.at.theta, NORMAL * np.sqrt(np.diag(item.covariance)))
        for item in (diagnosis.baseline, diagnosis.explained)
    ]
    for i, (name, unit) in enumerate(zip(base.names, base.units, strict=True)):
        cells = [f"{pair(float(theta[i]), float(half[i]))} {unit}" for theta, half in sides]
        rows.append([name, f"{three_digits(float(base.as_stated[i]))} {unit}", *cells])
    head = ["parameter", "as stated", "refitted", "refitted with the causes"]
    return PageTable("base", head, rows)


def diagnosis_document(diagnosis: Diagnosis, validation: Validation | None) -> dict[str, Any]:
    """What `twin diagnose --json` prints (docs/design.md 4.5); SI throughout."""
    explained, gain = diagnosis.explained, diagnosis.held_out
    p = len(explained.at.theta)
    covariance = explained.covariance[:p, :p]
    return {
        "verdict": diagnosis.verdict,
        "intervals_hold": diagnosis.intervals_hold,
        "sentence": verdict_sentence(diagnosis),
        "causes": [_cause(cause) for cause in diagnosis.causes],
        "wander": _wander(diagnosis),
        "base": dict(explained.base.table(explained.at.theta, covariance, NORMAL)),
        "gain": {
            "held_out": {
                "log_likelihood": gain.log_likelihood,
                "chi2_per_sample": {
                    "before": gain.before,
                    "after": gain.after,
                    "band": [gain.low, gain.high],
                },
                "free_run": free_run_document(diagnosis.free_runs),
            },
            "validation": None if validation is None else _validation(validation),
        },
        "equation": None
        if diagnosis.equation is None
        else {
            "text": equation_text(diagnosis.equation),
            "evidence": diagnosis.equation.evidence,
            "terms": [
                {
                    "what": law.what,
                    "column": law.column,
                    "factors": list(law.factors),
                    "unit": law.unit,
                    "value": value,
                    "low": value - half,
                    "high": value + half,
                }
                for law, value, half in zip(
                    diagnosis.equation.laws,
                    diagnosis.equation.coefficients.tolist(),
                    diagnosis.equation.half_widths.tolist(),
                    strict=True,
                )
            ],
        },
        "pushes": [
            {"log": push.source, "start": push.start, "stop": push.stop}
            for push in diagnosis.pushes
        ],
        "next_experiment": None
        if diagnosis.next_experiment is None
        else experiment_document(diagnosis.next_experiment),
        "remainder": {
            "chance": diagnosis.residual_test.chance,
            "torque_gain": diagnosis.residual_test.torque_gain,
            "directions": diagnosis.residual_test.freedom,
        },
        "tried": [
            {
                "label": tried.label,
                "evidence": tried.evidence,
                "alone": tried.alone,
                "detectable": dict(zip(tried.names, tried.detectable.tolist(), strict=True)),
            }
            for tried in diagnosis.tried
        ],
        "not_asked": dict(diagnosis.not_asked),
        "conventions": [finding.sentence for finding in diagnosis.conventions],
        "noise": [finding.sentence for finding in diagnosis.noise],
        "taken_as_at_rest": list(taken_as_at_rest(diagnosis.recordings, diagnosis.platform)),
        "repairs": [repair for log in diagnosis.recordings for repair in log.repairs],
    }


def _wander(diagnosis: Diagnosis) -> dict[str, Any]:
    noise = diagnosis.wander
    torque = noise.torque
    shared = bool(diagnosis.causes) and (noise.wanders or not diagnosis.explained.follows)
    return {
        "torque": None if torque is None else {"rms": torque.rms, "time": torque.time},
        "errors": {stream: {"rms": item.rms, "time": item.time} for stream, item in noise.errors},
        "white_noise": dict(noise.scales),
        "carried_by_causes": diagnosis.carried if shared else None,
    }


def _cause(cause: Cause) -> dict[str, Any]:
    parameters: dict[str, Any] = {}
    first = 0
    for known in cause.effect.parameters():
        own = slice(first, first + known.size)
        first += known.size
        value, half = cause.effect.values[own], cause.half_widths[own]
        ends = (value, value - half, value + half)
        scalar = known.size == 1 and not isinstance(known.typical, tuple)
        parameters[known.name] = {
            key: float(part[0]) if scalar else part.tolist()
            for key, part in zip(("value", "low", "high"), ends, strict=True)
        } | {"unit": known.unit}
    return {
        "name": cause.effect.name,
        "target": cause.effect.target or None,
        "evidence": cause.evidence,
        "confidence": cause.confidence,
        "parameters": parameters,
        "ties": [
            {
                "name": tie.label.partition(":")[0],
                "target": tie.label.partition(":")[2] or None,
                "behind": tie.behind,
            }
            for tie in cause.ties
        ],
    }


def _validation(gain: Validation) -> dict[str, Any]:
    return {
        "log_likelihood": gain.log_likelihood,
        "chi2_per_sample": {"before": gain.before, "after": gain.after},
        "free_run": free_run_document(gain.free_runs),
        "conventions": [finding.sentence for finding in gain.conventions],
        "repairs": list(gain.repairs),
    }
