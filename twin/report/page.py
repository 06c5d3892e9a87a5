"""A comparison as one HTML page; a table of several methods of identification."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TypeGuard

from twin.comparison import Comparison, Transfer, name_of
from twin.comparison.account import Account, stream_errors
from twin.errors import TwinError
from twin.files import write_whole
from twin.identification import Identification
from twin.platform import taken_as_at_rest
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
from twin.report.style import Drawing, PageTable, Part, bullets, foot, opened, page, rendered
from twin.report.words import (
    base_rows,
    headline,
    interval,
    pair,
    sentences,
    strength_words,
    transfer_sentences,
)
from twin.units import printed, unit_of


def write_page(
    path: Path, comparisons: Sequence[Comparison], transfers: Sequence[Transfer]
) -> None:
    """Write the page; the first comparison is the one that the transfers come from."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, comparison_page(comparisons, transfers))


def comparison_page(comparisons: Sequence[Comparison], transfers: Sequence[Transfer] = ()) -> str:
    """The page as text."""
    title = "What the model gets wrong: " + ", ".join(map(name_of, comparisons))
    under = foot([item.recording for item in comparisons], [comparisons[0].platform])
    return page(title, rendered([*comparison_parts(comparisons, transfers), under]))


def comparison_parts(
    comparisons: Sequence[Comparison], transfers: Sequence[Transfer] = ()
) -> list[Part]:
    """What the page is made of; of several logs names of files begin with the log's."""
    several = len(comparisons) > 1
    parts: list[Part] = []
    for comparison in comparisons:
        parts += _section(comparison, f"{name_of(comparison)}_" if several else "")
    for transfer in transfers:
        first, other = comparisons[0], transfer.comparison
        title = f"Fitted on {name_of(first)}, compared with {name_of(other)}"
        parts += [f"<h2>{escape(title)}</h2>", bullets(transfer_sentences(transfer, first))]
    return parts


def _section(comparison: Comparison, prefix: str) -> list[Part]:
    verdict = headline(comparison)
    rest = [sentence for sentence in sentences(comparison) if sentence != verdict]
    recording, grid = comparison.recording, comparison.body.grid
    under = (
        f"{comparison.platform.title} · {recording.stop - recording.start:.3g} s · "
        f"{grid.segments} stretches of {grid.length:.3g} s"
    )
    title = f"{name_of(comparison)} on {comparison.platform.name}"
    parts = [
        *opened(title, under, verdict, rest),
        "<h2>Measured and predicted</h2>",
        Drawing(
            f"{prefix}free_runs", motion_figure(comparison), run_caption(shown_run(comparison))
        ),
        "<h2>Residuals</h2>",
        Drawing(
            f"{prefix}residuals",
            residual_figure(comparison),
            "Measured less predicted. What lies outside the frame belongs to the worst stretches.",
        ),
        Drawing(
            f"{prefix}misfit",
            misfit_figure(comparison),
            "Of the best model: mean squared residual in units of the noise, over blocks of time, "
            "and its autocorrelation. A true model stays inside the bands 95 times in 100.",
        ),
        _streams_table(comparison, prefix),
        "<h2>Symptoms</h2>",
        Drawing(
            f"{prefix}symptoms",
            symptom_figure(comparison),
            "Each departure alone, fitted with base and states. Beyond its mark a departure is "
            "significant; several may have one common cause.",
        ),
        *_laws_table(comparison, prefix),
    ]
    if not comparison.healthy:
        parts += [
            "<h2>Unexplained torque</h2>",
            Drawing(
                f"{prefix}unexplained_torque",
                torque_figure(comparison),
                "A white torque beside the model, smoothed by a Kalman filter and averaged over "
                "0.25 s, with the base of the best model. A friction falls from upper left to "
                "lower right.",
            ),
        ]
    drawn = balance_figure(comparison)
    if drawn is not None:
        caption = (
            "Change since the start, of the smoothed motion. Only an external torque changes the "
            "momentum about the vertical, whatever the parts exchange; energy less the work of the "
            "motors falls where something brakes."
        )
        parts += ["<h2>Momentum and energy</h2>", Drawing(f"{prefix}balances", drawn, caption)]
    return [*parts, "<h2>The base</h2>", *_base_table(comparison, prefix)]


def _streams_table(comparison: Comparison, prefix: str) -> PageTable:
    rows: list[list[str]] = []
    for label, account in _accounts(comparison):
        for error in stream_errors(account):
            unit = unit_of(error.stream, error.unit)
            rows.append(
                [
                    label,
                    error.stream,
                    printed(error.rms, unit),
                    printed(error.typical, unit),
                    f"{printed(error.noise, unit)}"
                    + ("" if error.noise_stated else " (from the data)"),
                    f"{error.typical / error.noise:.2g}",
                    f"{printed(error.worst, unit)} at {error.worst_time:.2f} s",
                ]
            )
    head = ["model", "stream", "rms", "typical", "noise", "typical / noise", "worst"]
    return PageTable(f"{prefix}streams", head, rows)


def _laws_table(comparison: Comparison, prefix: str) -> list[Part]:
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
        return ["<p>No law is a candidate.</p>"]
    head = ["base", "law", "strength (95 %)", "could be the base", "could be instead"]
    return [PageTable(f"{prefix}laws", head, rows)]


def _base_table(comparison: Comparison, prefix: str) -> list[Part]:
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
    return [PageTable(f"{prefix}base", head, rows), *([note] if hidden else [])]


def _accounts(comparison: Comparison) -> list[tuple[str, Account]]:
    accounts = [("as built", comparison.as_built.plain)]
    if comparison.refitted is not None:
        accounts.append(("base refitted", comparison.refitted.plain))
    if comparison.best.strengths:
        accounts.append(("with the laws", comparison.best.explained))
    return accounts


GAP = "  "


def compared(result: Mapping[str, Identification | TwinError]) -> list[str]:
    """A row a method, a column a parameter, values with half their 95 % intervals.

    Args:
        result: by what each is called; the first one has found something.
    """
    first = next(item for item in result.values() if isinstance(item, Identification))
    count = len(first.base.names) - len(first.base.joints)
    names, units = first.base.names[:count], first.base.units[:count]
    heads = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
    rows = [
        [name, *_cells(item, count)]
        for name, item in result.items()
        if isinstance(item, Identification)
    ]
    stated = ["as stated", *(f"{value:.4g}" for value in first.base.as_stated[:count])]
    doubt = next((item.doubt for item in result.values() if _doubted(item)), "")
    ours = "hold" if not doubt else f"are not 95 % intervals, for {doubt}"
    lines = [
        f"{first.platform.title} ({first.platform.name}): values +- half of "
        f"{'95 % intervals' if not doubt else 'intervals that do not hold'}",
        *_table([["method", *heads], stated, *rows]),
        f"The intervals of prediction-error {ours}. Those of the other methods include the scatter "
        "of the residual, not the bias by noise in rates and wheel speeds.",
    ]
    lines += taken_as_at_rest(first.recordings, first.platform)
    lines += _failed(result)
    return lines + [f"Not identifiable: {sentence}." for sentence in first.not_excited]


def _doubted(identification: Identification | TwinError) -> TypeGuard[Identification]:
    return isinstance(identification, Identification) and bool(identification.doubt)


def _failed(result: Mapping[str, Identification | TwinError]) -> list[str]:
    """Each sentence once, after the names of all methods that it is of."""
    told: dict[str, list[str]] = {}
    for name, problem in result.items():
        if isinstance(problem, TwinError):
            told.setdefault(str(problem), []).append(name)
    return [f"{', '.join(names)}: {sentence}." for sentence, names in told.items()]


def _cells(identification: Identification, count: int) -> list[str]:
    values, half = (
        identification.theta[:count].tolist(),
        identification.half_widths[:count].tolist(),
    )
    return [pair(v, h) for v, h in zip(values, half, strict=True)]


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        GAP.join(
            cell.ljust(width) if place == 0 else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
