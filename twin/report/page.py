"""One self-contained HTML page about a comparison: sentences, figures, tables."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

from twin.comparison import Comparison, Transfer, name_of
from twin.comparison.account import Account, stream_errors
from twin.report.figures import (
    balance_figure,
    misfit_figure,
    motion_figure,
    residual_figure,
    run_caption,
    shown_run,
    symptom_figure,
    torque_figure,
)
from twin.report.foot import foot
from twin.report.style import bullets, framed, page, table, typeset
from twin.report.words import (
    base_rows,
    headline,
    interval,
    sentences,
    strength_words,
    transfer_sentences,
)
from twin.units import printed
from twin.whole_file import write_whole


def write_page(
    path: Path, comparisons: Sequence[Comparison], transfers: Sequence[Transfer]
) -> None:
    """Write the page; the first comparison is the one that the transfers come from."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, comparison_page(comparisons, transfers))


def comparison_page(comparisons: Sequence[Comparison], transfers: Sequence[Transfer] = ()) -> str:
    """The page as text."""
    parts = [_section(comparison) for comparison in comparisons]
    parts += [_transfer(transfer, comparisons[0]) for transfer in transfers]
    title = "What the model gets wrong: " + ", ".join(map(name_of, comparisons))
    parts.append(foot([one.recording for one in comparisons], comparisons[0].platform))
    return page(title, "\n".join(parts))


def _section(comparison: Comparison) -> str:
    verdict = headline(comparison)
    rest = [sentence for sentence in sentences(comparison) if sentence != verdict]
    recording, grid = comparison.recording, comparison.body.grid
    under = (
        f"{comparison.platform.title} · {recording.stop - recording.start:.3g} s · "
        f"{grid.segments} stretches of {grid.length:.3g} s"
    )
    parts = [
        f"<h1>{escape(name_of(comparison))} on {escape(comparison.platform.name)}</h1>",
        f"<p class='under'>{escape(under)}</p>",
        f"<p class='verdict'>{escape(typeset(verdict))}</p>",
        bullets(rest),
        "<h2>Measured and predicted</h2>",
        framed(motion_figure(comparison), run_caption(shown_run(comparison))),
        "<h2>What is left</h2>",
        framed(
            residual_figure(comparison),
            "Measured less predicted. What lies outside the frame belongs to the worst stretches.",
        ),
        framed(
            misfit_figure(comparison),
            "Of the best model: mean squared residual in units of the noise, over blocks of time, "
            "and how it goes with itself some samples later. A true model stays inside the bands "
            "95 times in 100.",
        ),
        _streams_table(comparison),
        "<h2>Symptoms</h2>",
        framed(
            symptom_figure(comparison),
            "Each departure asked on its own, beside base and states. What stands beyond its mark "
            "stands out; what stands out together may be one cause seen twice.",
        ),
        _laws_table(comparison),
    ]
    if not comparison.healthy:
        parts += [
            "<h2>The torque that nobody accounts for</h2>",
            framed(
                torque_figure(comparison),
                "A white torque beside the model, smoothed by a Kalman filter and averaged over "
                "0.25 s, with the base of the best model. A friction falls from upper left to "
                "lower right.",
            ),
        ]
    parts += _balance(comparison)
    parts += ["<h2>The base</h2>", _base_table(comparison)]
    return "\n".join(parts)


def _balance(comparison: Comparison) -> list[str]:
    drawn = balance_figure(comparison)
    if drawn is None:
        return []
    caption = (
        "Change since the start, of the smoothed motion. Momentum about the vertical changes by "
        "an external torque only, whatever the parts exchange; energy less the work of the motors "
        "falls where something brakes."
    )
    return ["<h2>Two balances</h2>", framed(drawn, caption)]


def _transfer(transfer: Transfer, source: Comparison) -> str:
    other = transfer.comparison
    title = f"Fitted on {name_of(source)}, held against {name_of(other)}"
    return f"<h2>{escape(title)}</h2>\n{bullets(transfer_sentences(transfer, source))}"


def _streams_table(comparison: Comparison) -> str:
    rows: list[list[str]] = []
    for label, account in _accounts(comparison):
        for error in stream_errors(account):
            rows.append(
                [
                    label,
                    error.stream,
                    printed(error.rms, error.unit),
                    printed(error.typical, error.unit),
                    f"{printed(error.noise, error.unit)}"
                    + ("" if error.noise_stated else " (from the data)"),
                    f"{error.typical / error.noise:.2g}",
                    f"{printed(error.worst, error.unit)} at {error.worst_time:.2f} s",
                ]
            )
    head = ["model", "stream", "rms", "typical", "noise", "typical / noise", "worst"]
    return table(head, rows)


def _laws_table(comparison: Comparison) -> str:
    rows = [
        [
            label,
            strength.symptom.name,
            strength_words(strength),
            f"{strength.imitated:.0%}",
            ", ".join(tie.name for tie in strength.ties) or "none",
        ]
        for label, side in (
            ("as built", comparison.as_built),
            ("base refitted", comparison.refitted),
        )
        if side is not None
        for strength in side.strengths
    ]
    if not rows:
        return "<p>No law was asked for.</p>"
    return table(["base", "law", "strength (95 %)", "could be the base", "could be instead"], rows)


def _base_table(comparison: Comparison) -> str:
    rows: list[list[str]] = []
    for row in base_rows(comparison):
        unit = row["unit"]
        cells = [row["name"], f"{row['stated']:.3g} {unit}"]
        for key in ("plain", "laws"):
            if key in row:
                value, half = row[key]
                cells.append(interval(value, half, unit))
        rows.append(cells)
    head = ["parameter", "as built"]
    if comparison.refitted is not None:
        head += ["refitted", "refitted with the laws"]
    hidden = comparison.base.not_excited
    note = f"<p class='under'>Not seen by this joint: {escape(', '.join(hidden))}.</p>"
    return table(head, rows) + (note if hidden else "")


def _accounts(comparison: Comparison) -> list[tuple[str, Account]]:
    accounts = [("as built", comparison.as_built.plain)]
    if comparison.refitted is not None:
        accounts.append(("base refitted", comparison.refitted.plain))
    if comparison.best.strengths:
        accounts.append(("with the laws", comparison.best.explained))
    return accounts
