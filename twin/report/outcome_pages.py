"""Pages of runs, identifications and balancings: the answer, its figures and its tables."""

from collections.abc import Sequence
from html import escape
from itertools import groupby
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from twin import rotation
from twin.comparison import log_name
from twin.comparison.account import Account
from twin.errors import UsageError
from twin.flight import Run
from twin.identification import Identification
from twin.procedures.session import Balanced
from twin.recording import Recording
from twin.report.contents import contents_of
from twin.report.figures import BEST, drawn_residuals
from twin.report.outcomes import balanced, flown, identified, torque_words
from twin.report.picture import contents_figure
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
from twin.report.words import pair
from twin.units import fitting, listed, printed, three_digits

POINTS = 2000
"""Drawn of a long stream."""


def run_page(run: Run) -> str:
    """The page as text."""
    title = f"A run of {run.platform.name}"
    return page(title, rendered([*run_parts(run), foot([run.recording], [run.platform])]))


def run_parts(run: Run) -> list[Part]:
    """How the body followed its target, and all streams that changed."""
    end, *lines = flown(run.platform, run.outcome, run.metrics, run.settle)
    facts = run.recording.provenance
    under = (
        f"{run.platform.title} · {run.outcome.duration:g} s at {run.platform.control_rate:g} Hz"
        + (f" · seed {facts['seed']}" if facts.get("seed") is not None else "")
    )
    warned = [f"Warning: {warning}." for warning in run.warnings]
    answer = f"{end[0].upper()}{end[1:]}" + (f": {lines[0]}." if lines else ".")
    names = {wheel.name for wheel in run.platform.wheels}
    rest = [f"{_sentence(line, names)}." for line in lines[1:]]
    parts = opened(f"A run of {run.platform.name}", under, answer, [*warned, *rest])
    tracked = tracking_figure(run.recording)
    if tracked is not None:
        parts += [
            "<h2>Target and motion</h2>",
            Drawing("tracking", tracked, "Euler angles z-y-x, and the turn from target to body."),
        ]
    contents = contents_of(run.recording.source, run.recording.without_truth(), run.platform)
    parts += ["<h2>All that changed</h2>", Drawing("streams", contents_figure(contents))]
    still = [stream.name for stream in contents.streams if len(stream.series) and stream.still]
    return [*parts, bullets([f"Constant: {listed(still)}."])] if still else parts


def _sentence(line: str, names: set[str]) -> str:
    """With a capital, unless it begins with the name of a part."""
    return line if line.split()[0] in names else f"{line[0].upper()}{line[1:]}"


def tracking_figure(recording: Recording) -> Figure | None:
    """Attitude beside its target, and the angle between them; None of a hinge."""
    names = [n for n in ("estimate_attitude", "attitude", "truth_attitude") if n in recording]
    if not names or "reference_attitude" not in recording or not len(recording[names[0]]):
        return None
    body, target = recording[names[0]], recording["reference_attitude"]
    thin = slice(None, None, max(len(body) // POINTS, 1))
    time, quat = body.time[thin], body.value[thin]
    at = np.maximum(np.searchsorted(target.time, time, side="right") - 1, 0)
    wanted = target.value[at]
    angles, aims = (np.degrees(np.unwrap(rotation.to_euler_zyx(q), axis=0)) for q in (quat, wanted))
    error = rotation.to_rotation_vector(rotation.multiply(rotation.conjugate(wanted), quat))
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 4.6))
        above, below = figure.subplots(2, 1, sharex=True)
        for k, name in enumerate(("yaw", "pitch", "roll")):
            above.plot(time, aims[:, k], color=PALETTE[k], lw=3.0, alpha=0.3)
            above.plot(time, angles[:, k], color=PALETTE[k], label=name)
            below.plot(time, np.degrees(error[:, k]), color=PALETTE[k], label=f"about {'xyz'[k]}")
        above.plot([], [], color=SOFT, lw=3.0, alpha=0.3, label="target")
        for panel, name in ((above, "attitude [deg]"), (below, "error [deg]")):
            panel.set_ylabel(name)
            panel.legend(ncols=4, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
        below.set_xlabel("time [s]")
        return figure


def identification_page(result: Identification) -> str:
    """The page as text."""
    under = foot(result.recordings, [result.platform])
    return page(_title(result), rendered([*identification_parts(result), under]))


def _title(result: Identification) -> str:
    names = ", ".join(map(log_name, result.recordings))
    return f"Mass properties of {result.platform.name} from {names}"


def identification_parts(result: Identification) -> list[Part]:
    """The parameters beside those stated, and what the fit leaves."""
    length = sum(log.stop - log.start for log in result.recordings)
    under = f"{result.platform.title} · {length:.3g} s of log · {result.method}"
    # after two lines that the page says otherwise, and one an entry, which the table has
    lines = [line.strip() for line in identified(result)[2:] if not line.startswith("    ")]
    rest = [line if line.endswith((".", ":")) else f"{line}." for line in lines]
    parts = [
        *opened(_title(result), under, identification_answer(result), rest),
        "<h2>Identified and stated</h2>",
        Drawing(
            "parameters", parameters_figure(result), "Identified less stated, and its interval."
        ),
        PageTable(
            "parameters", ["parameter", "stated", "identified", "change"], _parameters(result)
        ),
    ]
    drawn = residuals_of(result)
    if drawn is not None:
        caption = (
            "Measured less predicted of the first log, with what was identified. `twin compare` "
            "draws the prediction of the machine as stated beside it."
        )
        parts += ["<h2>Residuals</h2>", Drawing("residuals", drawn, caption)]
    if result.misfit:
        rows = [
            [m.name, three_digits(m.chi2_per_sample), f"{m.low:.3f} to {m.high:.3f}"]
            for m in result.misfit
        ]
        parts.append(PageTable("misfit", ["stream", "chi² a sample", "a true model"], rows))
    return parts


def identification_answer(result: Identification) -> str:
    """J and m r in a sentence, each with the half of its interval."""
    base = result.base
    shown = [
        f"{name} = {_pair(float(value), float(half), unit)}"
        for name, unit, value, half in zip(
            base.names, base.units, result.theta, result.half_widths, strict=True
        )
    ]
    kind = "with 95 % intervals" if not result.doubt else "with intervals that do not hold"
    said = f"{listed(shown)}, {kind}."
    return said if not result.doubt else f"{said[:-1]}, for {result.doubt}."


def _pair(value: float, half: float, unit: str) -> str:
    factor, name = fitting(max(abs(value), half), unit)
    return f"{pair(value / factor, half / factor)} {name}"


def _parameters(result: Identification) -> list[list[str]]:
    base = result.base
    rows: list[list[str]] = []
    for name, unit, stated, value, half in zip(
        base.names,
        base.units,
        base.as_stated.tolist(),
        result.theta.tolist(),
        result.half_widths.tolist(),
        strict=True,
    ):
        by = f"{100.0 * (value / stated - 1.0):+.2g} %" if abs(stated) > half else ""
        inside = "within the interval" if abs(value - stated) <= half else by
        rows.append([name, printed(stated, unit), _pair(value, half, unit), inside])
    return rows


def parameters_figure(result: Identification) -> Figure:
    """Each parameter's change with its interval, a panel a unit."""
    base = result.base
    places = [list(group) for _, group in groupby(range(len(base.names)), lambda i: base.units[i])]
    with mpl.rc_context(FIGURE):
        heights = [0.5 + 0.32 * len(group) for group in places]
        figure = Figure(figsize=(9.6, 0.4 + sum(heights) + 0.25 * len(places)))
        panels = figure.subplots(len(places), 1, squeeze=False, height_ratios=heights)[:, 0]
        for panel, group in zip(panels, places, strict=True):
            off = (result.theta - base.as_stated)[group]
            half = result.half_widths[group]
            factor, unit = fitting(float(np.max(np.abs(off) + half)), base.units[group[0]])
            rows = -np.arange(len(group))
            panel.errorbar(
                off / factor, rows, xerr=half / factor, fmt="o", color=PALETTE[0], capsize=4
            )
            panel.axvline(0.0, color=INK, lw=0.8)
            panel.set_ylim(-len(group) + 0.4, 0.6)
            panel.set_yticks(rows, [base.names[i] for i in group])
            panel.set_xlabel(f"identified less stated [{typeset(unit)}]")
            panel.grid(visible=False, axis="y")
        return figure


def residuals_of(result: Identification) -> Figure | None:
    """Residuals of the first log over time; None of a method that has none."""
    if result.fit is None or result.problem is None:
        return None
    account = Account(result.problem, (), result.fit.innovations, (), follows=True)
    return drawn_residuals(result.problem.bodies[0], [(account, BEST, "identified")])


def balance_page(result: Balanced) -> str:
    """The page as text."""
    title = f"Balancing of {result.platform.name}"
    return page(title, rendered([*balance_parts(result), foot([], [result.platform])]))


def balance_parts(result: Balanced) -> list[Part]:
    """What is left of each run, and where its masses stand."""
    session = result.session
    under = (
        f"{result.platform.title} · {session.procedure} · "
        f"{session.runs} run{'s' * (session.runs > 1)} · seed {session.seed}"
    )
    stated = [s for s in result.statements if s is not None]
    rest: list[str] = []
    if session.runs == 1 and stated:
        rest = [line.strip() for line in balanced(stated[0], result.platform, result.target)[1:]]
        rest = [line if line.endswith(".") else f"{line[0].upper()}{line[1:]}." for line in rest]
    if result.rrd is not None:
        rest.append(f"Recorded in {Path(result.rrd).name}.")
    parts = opened(f"Balancing of {result.platform.name}", under, balance_answer(result), rest)
    if stated:
        caption = "Gravity's torque at the worst attitude, with 95 % intervals, and the target."
        parts += [
            "<h2>Residual torque</h2>",
            Drawing("residual_torque", residual_torque_figure(result), caption),
        ]
    stages = [stage.name for stage in result.platform.stages]
    head = ["run", "ended", "after", "CM from CR x, y, z", "torque at worst", *stages]
    return [*parts, PageTable("runs", head, [_run_row(result, run) for run in range(session.runs)])]


def balance_answer(result: Balanced) -> str:
    """Whether the target is kept, and by how much."""
    target = printed(result.target, "N m")
    known = [s.residual_torque for s in result.statements if s is not None]
    kept = sum(torque.high <= result.target for torque in known)
    runs = result.session.runs
    if runs > 1:
        worst = max((torque.high for torque in known), default=np.nan)
        upper = f"; none leaves more than {printed(worst, 'N m')}" if kept == runs else ""
        return f"{kept} of {runs} runs are balanced to the target of {target}{upper}."
    told = result.run(0)
    after = f"after {told['duration']:.0f} s"
    if not known:
        reason = str(told["reason"])
        begins = reason.startswith("not balanced")
        return f"N{reason[1:]}." if begins else f"Not balanced {after}: {reason}."
    word = "within" if kept else "beyond"
    done = "Balanced" if told["ended"] == "done" else "Not balanced"
    return (
        f"{done} {after}: gravity's torque at the worst attitude is {torque_words(known[0])}, "
        f"{word} the target of {target}."
    )


def _run_row(result: Balanced, run: int) -> list[str]:
    told, statement = result.run(run), result.statements[run]
    row = [f"{run}", str(told["ended"]), f"{told['duration']:.0f} s"]
    if statement is None:
        return [*row, "", "", *("" for _ in result.platform.stages)]
    per_um = 1e6 / result.platform.mass
    offset = ", ".join(
        pair(axis.value * per_um, 0.5 * (axis.high - axis.low) * per_um)
        for axis in statement.center_of_mass_offset
    )
    places = [f"{1e3 * position:.4g} mm" for position in statement.stage_position]
    return [*row, f"{offset} um", torque_words(statement.residual_torque), *places]


def residual_torque_figure(result: Balanced) -> Figure:
    """Gravity's torque that is left of each run, with its interval, and the target.

    Raises:
        UsageError: nothing was stated of it.
    """
    stated = [
        (run, statement) for run, statement in enumerate(result.statements) if statement is not None
    ]
    if not stated:
        raise UsageError("no residual torque was stated, so there is nothing to draw")
    left = [item.residual_torque for _, item in stated]
    factor, unit = fitting(max(item.high for item in left), "N m")
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 1.2 + 0.35 * len(left)))
        panel: Axes = figure.subplots()
        for (run, _), item in zip(stated, left, strict=True):
            ends = [[(item.value - item.low) / factor], [(item.high - item.value) / factor]]
            panel.errorbar(
                item.value / factor, -run, xerr=ends, fmt="o", color=PALETTE[0], capsize=4
            )
        panel.axvline(result.target / factor, color=PALETTE[1], lw=1.4, label="target")
        panel.set_yticks([-run for run, _ in stated], [f"run {run}" for run, _ in stated])
        panel.set_xlim(left=0.0)
        panel.set_xlabel(f"gravity's torque at the worst attitude [{unit}]")
        panel.grid(visible=False, axis="y")
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    return figure


def sentences_page(title: str, lines: Sequence[str], figure: Figure | None) -> str:
    """The page of a result that has sentences and at most one figure."""
    drawn = [] if figure is None else [Drawing("figure", figure)]
    return page(
        title, rendered([f"<h1>{escape(title)}</h1>", *drawn, bullets(lines), foot([], [])])
    )
