"""One self-contained HTML page about a diagnosis: verdict, before and after, causes, what next."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from twin.comparison import log_name
from twin.diagnosis import Diagnosis, Experiment, Validation
from twin.identification.prediction_error import NORMAL
from twin.report.diagnosed import (
    cause_sentences,
    could_show,
    diagnosed,
    equation_sentence,
    first_of,
    push_sentence,
    validated,
    verdict_sentence,
)
from twin.report.diagnosis_figures import (
    before_after_figure,
    evidence_figure,
    left_figure,
    prediction_figure,
)
from twin.report.figures import run_caption, run_to_show
from twin.report.foot import foot
from twin.report.next_experiment import experiment_sentence
from twin.report.one_clock import one_clock_sentences
from twin.report.style import bullets, framed, page, table, typeset
from twin.report.words import MEANINGFUL, pair
from twin.units import three_digits
from twin.whole_file import write_whole


def write_diagnosis(path: Path, found: Diagnosis, gain: Validation | None) -> None:
    """Write the page."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, diagnosis_page(found, gain))


def diagnosis_page(found: Diagnosis, gain: Validation | None = None) -> str:
    """The page as text."""
    names = ", ".join(map(log_name, found.recordings))
    title = f"Diagnosis of {names} on {found.platform.name}"
    parts = [*_parts(found, gain, title), foot(found.recordings, found.platform)]
    return page(title, "\n".join(parts))


def _parts(found: Diagnosis, gain: Validation | None, title: str) -> list[str]:
    length = sum(log.stop - log.start for log in found.recordings)
    verdict = verdict_sentence(found)
    own = cause_sentences(found) + one_clock_sentences(found)
    if found.equation is not None:
        own.append(equation_sentence(found.equation))
    if found.pushes:
        own.insert(0, push_sentence(found.pushes))
    told = [verdict, *own]
    if found.next_experiment is not None:
        told.append(experiment_sentence(found.next_experiment))
    sizes = could_show(found)
    rest = [said for said in diagnosed(found) if said not in (*told, *sizes)]
    first = first_of(found)
    curves = f"{first} that has it" if first else ""
    parts = [
        f"<h1>{escape(title)}</h1>",
        f"<p class='under'>{escape(found.platform.title)} · {length:.3g} s · "
        f"{len(found.tried) + len(found.causes)} causes asked for</p>",
        f"<p class='verdict'>{escape(typeset(verdict))}</p>",
        bullets(own),
        "<h2>Measured and predicted</h2>",
        framed(prediction_figure(found), _run_caption(found)),
        framed(
            left_figure(found),
            "Measured less predicted. What lies outside the frame belongs to the worst stretches.",
        ),
        "<h2>Before and after</h2>",
        framed(
            before_after_figure(found),
            f"Mean squared innovation of each stream{curves}, in units of its noise, over blocks "
            "of time: the machine with its base refitted, without the causes and with them.",
        ),
        _gain_table(found),
    ]
    if gain is not None:
        parts.append(f"<p>{escape(typeset(validated(gain)))}</p>")
    parts += [
        "<h2>The causes, ranked</h2>",
        framed(
            evidence_figure(found),
            "Causes that look alike are long together on their own; beside the one that is named "
            "the others have nothing left to explain.",
        ),
    ]
    if any(cause.ties for cause in found.causes):
        parts += ["<h2>What these logs cannot tell apart</h2>", _ties_table(found)]
    if found.next_experiment is not None:
        parts += _experiment(found.next_experiment)
    parts += ["<h2>The base</h2>", _base_table(found), "<h2>All that is to be said</h2>"]
    parts.append(bullets(rest))
    if sizes:
        lines = "\n".join(escape(typeset(said)) for said in sizes)
        parts += ["<h2>What would have been found</h2>", f"<pre>{lines}</pre>"]
    return parts


def _run_caption(found: Diagnosis) -> str:
    return run_caption(run_to_show(found.free_runs, found.explained.bodies[0]))


def _gain_table(found: Diagnosis) -> str:
    gain = found.held_out
    first = first_of(found)
    rows = [
        [
            "chi-square a sample, held-out blocks",
            f"{gain.before:.4f}",
            f"{gain.after:.4f}",
            f"{gain.low:.4f} to {gain.high:.4f}",
        ]
    ]
    if not found.explained.follows or np.isnan(gain.after):
        # each segment counts by its own scatter: no chi-square is to be expected; or none was held
        rows = []
    for horizon, run in found.free_runs.items():
        if run is not None and run.errors[1] < MEANINGFUL:
            before, after, perfect = (f"{np.degrees(error):.3g} deg" for error in run.errors)
            rows.append(
                [f"free run of {horizon:g} s{first}, typical error", before, after, perfect]
            )
    return table(["", "before", "after", "a true model"], rows)


def _ties_table(found: Diagnosis) -> str:
    rows = [
        [cause.effect.label, tie.label, f"{tie.behind:.1f}"]
        for cause in found.causes
        for tie in cause.ties
    ]
    return table(["named", "could be instead", "evidence behind"], rows)


def _experiment(best: Experiment) -> list[str]:
    """The command, if it is worth it, and what each tied cause would be behind after it."""
    rows = [
        [label, f"{split:.1f}", f"{best.repeated[label]:.1f}"]
        for label, split in best.splits.items()
    ]
    return [
        f"<h2>{'What would tell them apart' if best.enough else 'What could be tried next'}</h2>",
        *([f"<pre>{escape(best.command)}</pre>"] if best.enough else []),
        f"<p>{escape(experiment_sentence(best))}</p>",
        table(["could be instead", "behind after it", "after the same logs once more"], rows),
    ]


def _base_table(found: Diagnosis) -> str:
    base = found.explained.base
    rows: list[Sequence[str]] = []
    sides = [
        (one.at.theta, NORMAL * np.sqrt(np.diag(one.covariance)))
        for one in (found.baseline, found.explained)
    ]
    for i, (name, unit) in enumerate(zip(base.names, base.units, strict=True)):
        cells = [f"{pair(float(theta[i]), float(half[i]))} {unit}" for theta, half in sides]
        rows.append([name, f"{three_digits(float(base.as_stated[i]))} {unit}", *cells])
    return table(["parameter", "as stated", "refitted", "refitted with the causes"], rows)
