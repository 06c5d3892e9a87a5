"""Figures of a comparison."""

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin import rotation
from twin.comparison import Comparison
from twin.comparison.account import Account
from twin.comparison.comparison import missing_torque
from twin.comparison.explanation import FreeRun
from twin.comparison.symptoms import SymptomDomain, standstill
from twin.predict.body import Body
from twin.predict.innovations import Unexplained
from twin.predict.logs import Motion
from twin.report.style import FIGURE, INK, PALETTE, SOFT
from twin.units import fitting, unit_of

Array = NDArray[np.float64]

MEASURED, BUILT, BEST, BAND = INK, "#c2571a", "#1f6f8b", "#d9e3ea"
AXES = ("x", "y", "z")
DOMAINS = dict(zip(SymptomDomain, (PALETTE[0], PALETTE[1], PALETTE[2], PALETTE[3]), strict=True))

POINTS = 1500
"""Drawn of a long stream: more cannot be told apart, and would make a page of megabytes."""
MEAN = 0.25
"""Of the unexplained torque, over which it is averaged for the eye [s]."""
LISTED = 14
"""Symptoms drawn."""


def motion_figure(comparison: Comparison) -> Figure:
    """Turn from the first position, measured, and in free runs as built and of the best model."""
    return drawn_motion(
        comparison.body.motion, shown_run(comparison), before="as built", after="best model"
    )


def drawn_motion(motion: Motion, run: FreeRun | None, *, before: str, after: str) -> Figure:
    """Turn from the first position, measured, and in free runs of two models."""
    with mpl.rc_context(FIGURE):
        width = motion.rate.shape[1]
        figure = Figure(figsize=(9.6, 1.2 + (2.4 if width == 1 else 1.9 * width)))
        panels = figure.subplots(width, 1, sharex=True, squeeze=False)[:, 0]
        factor, unit = fitting(1.0, "rad")
        first = motion.position[0]
        measured = _turned(motion.position, first)
        drawn = [] if run is None else [(run.as_built, BUILT, before), (run.best, BEST, after)]
        names = ["turn" if width == 1 else f"turn about {axis}" for axis in "xyz"]
        units, factors = [unit] * 3, [factor] * 3
        if motion.position.shape[1] == 3:
            names, units, factors = ["x", "y", "heading"], ["m", "m", unit], [1.0, 1.0, factor]
        for k, panel in enumerate(panels):
            factor = factors[k]
            panel.plot(
                motion.time, measured[:, k] / factor, color=MEASURED, label="measured", lw=2.6
            )
            for runs, color, label in drawn:
                assert run is not None
                for i, path in enumerate(runs):
                    panel.plot(
                        run.time[i],
                        _turned(path, first)[:, k] / factor,
                        color=color,
                        label=None if i else label,
                    )
            _frame(panel, measured[:, k] / factor)
            panel.set_ylabel(f"{names[k]} [{units[k]}]")
        panels[0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        panels[-1].set_xlabel("time [s]")
        return figure


def shown_run(comparison: Comparison) -> FreeRun | None:
    """The free runs that a figure shows."""
    return run_to_show(comparison.free_runs, comparison.body)


def run_to_show(free_runs: Mapping[float, FreeRun | None], body: Body) -> FreeRun | None:
    """Of free runs by horizon, the longest that do not overlap in a figure."""
    runs = [run for run in free_runs.values() if run is not None]
    short = [run for run in runs if run.horizon <= max(2.0 * body.grid.length, 1.0)]
    return (short[-1:] or runs[:1] or [None])[0]


def run_caption(run: FreeRun | None) -> str:
    """What stands under a figure with free runs."""
    if run is None:
        return "The log is too short for a free run."
    return (
        f"Free runs of {run.horizon:g} s under the recorded commands, each started from what was "
        "measured before; nothing is fitted to them."
    )


def residual_figure(comparison: Comparison) -> Figure:
    """Residuals over time, as built and of the best model."""
    return drawn_residuals(comparison.body, _both(comparison))


def drawn_residuals(body: Body, accounts: Sequence[tuple[Account, str, str]]) -> Figure:
    """Residuals of a log over time, with the band in which 95 % of the sensors' noise lies.

    Args:
        body: the log, the first of each account.
        accounts: fits, each with its colour and its label.
    """
    with mpl.rc_context(FIGURE):
        outputs = body.outputs
        figure = Figure(figsize=(9.6, 1.0 + 2.0 * len(outputs)))
        panels = figure.subplots(len(outputs), 1, sharex=True, squeeze=False)[:, 0]
        for index, (panel, output) in enumerate(zip(panels, outputs, strict=True)):
            factor, name = fitting(float(output.noise.max()), unit_of(output.stream, output.unit))
            heights: list[float] = []
            for account, color, label in accounts:
                error = account.left[0][index] * output.noise
                thin = slice(None, None, max(error.size // POINTS, 1))
                panel.plot(output.time[thin], error[thin] / factor, ".", ms=2.0, color=color)
                panel.plot([], [], "o", ms=4, color=color, label=label)
                heights.append(float(np.quantile(np.abs(error), 0.99)) / factor)
            band = 1.96 * float(np.max(output.noise)) / factor
            panel.axhspan(-band, band, color=BAND, zorder=0, label="95 % of the noise")
            panel.set_ylim(*(np.array([-1.25, 1.25]) * max(*heights, band)))
            panel.set_ylabel(f"{output.stream}\nresidual [{name}]")
        panels[0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        panels[-1].set_xlabel("time [s]")
        return figure


def misfit_figure(comparison: Comparison) -> Figure:
    """Chi-square of each stream over time, and autocorrelations, with the bands of a true model."""
    with mpl.rc_context(FIGURE):
        result = comparison.best.explained.misfits
        streams = list(dict.fromkeys(part.stream for part in result))
        figure = Figure(figsize=(9.6, 0.8 + 1.9 * len(streams)))
        panels = figure.subplots(len(streams), 2, squeeze=False)
        for (left, right), stream in zip(panels, streams, strict=True):
            parts = [part for part in result if part.stream == stream]
            band = parts[0].block_band
            left.fill_between(
                parts[0].block_time, band[:, 0], band[:, 1], color=BAND, lw=0.0, step="mid"
            )
            right.axhspan(
                -parts[0].correlation_band, parts[0].correlation_band, color=BAND, zorder=0
            )
            for part, color in zip(parts, PALETTE, strict=False):
                left.plot(part.block_time, part.block_chi2, "o-", ms=3.5, color=color)
                lags = np.arange(1, len(part.correlation) + 1)
                right.plot(lags, part.correlation, "o-", ms=3, color=color, label=part.column)
            if max(part.block_chi2.max() for part in parts) > 5.0:
                left.set_yscale("log")
            left.set_ylabel(f"{stream}\nchi² per sample")
            right.set_ylabel("autocorrelation")
            if len(parts) > 1:
                right.legend(ncols=len(parts), loc="upper right")
        panels[-1, 0].set_xlabel("time [s]")
        panels[-1, 1].set_xlabel("lag [samples]")
        return figure


def symptom_figure(comparison: Comparison) -> Figure:
    """Evidence for each departure where the best model has none yet, and what chance gives."""
    with mpl.rc_context(FIGURE):
        scores = comparison.best.scores[:LISTED]
        figure = Figure(figsize=(9.6, 1.0 + 0.27 * len(scores)))
        panel = figure.subplots()
        for place, score in enumerate(scores):
            panel.barh(
                -place,
                max(score.evidence, 0.1),
                left=0.0,
                height=0.65,
                color=DOMAINS[score.symptom.domain],
                alpha=1.0 if score.stands_out else 0.35,
            )
            panel.plot([score.needed] * 2, [-place - 0.42, -place + 0.42], color=INK, lw=1.6)
        panel.set_xscale("log")
        panel.set_xlim(0.5, 2.0 * max([s.evidence for s in scores] + [s.needed for s in scores]))
        panel.set_yticks(
            [-place for place in range(len(scores))],
            [s.symptom.name.replace("_", " ").replace(":", " of ") for s in scores],
        )
        panel.grid(visible=False, axis="y")
        for domain, color in DOMAINS.items():
            panel.plot([], [], "s", color=color, label=domain.value)
        panel.plot([], [], color=INK, lw=1.6, label="by chance once in 100 logs")
        panel.legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        panel.set_xlabel("evidence: fall of −2 log likelihood, independent samples")
        return figure


def torque_figure(comparison: Comparison) -> Figure:
    """Smoothed unexplained torque over time and rate, with the friction found drawn through it."""
    with mpl.rc_context(FIGURE):
        torque = missing_torque(comparison, MEAN)
        width = torque.rate.shape[1]
        figure = Figure(figsize=(9.6, 2.6 * width + 0.4))
        panels = figure.subplots(width, 2, squeeze=False, width_ratios=(3, 2))
        rate_factor, rate_name = fitting(1.0, "rad/s")
        for k, (over_time, panel) in enumerate(panels):
            limit = max(1.6 * float(np.quantile(np.abs(torque.torque[:, k]), 0.97)), 1e-9)
            factor, name = fitting(limit, "N m")
            thin = slice(None, None, max(len(torque.time) // POINTS, 1))
            over_time.plot(torque.time[thin], torque.torque[thin, k] / factor, color=MEASURED)
            panel.plot(
                torque.rate[thin, k] / rate_factor,
                torque.torque[thin, k] / factor,
                ".",
                ms=3.0,
                color=MEASURED,
                alpha=0.5,
            )
            _draw_friction(panel, comparison, torque, k, rate_factor, factor)
            axis = f" {AXES[k]}" if width > 1 else ""
            for item in (over_time, panel):
                item.set_ylim(-limit / factor, limit / factor)
            over_time.set_ylabel(f"unexplained torque{axis} [{name}]")
            panel.set_xlabel(f"rate{axis} [{rate_name}]")
        panels[-1, 0].set_xlabel("time [s]")
        return figure


def balance_figure(comparison: Comparison) -> Figure | None:
    """Angular momentum about the vertical, and energy less the work of the motors; None where the
    log shows neither."""
    with mpl.rc_context(FIGURE):
        result = comparison.balance
        curves = [
            (values, name, unit)
            for values, name, unit in (
                (result.momentum, "momentum about\nthe vertical", "N m s"),
                (result.energy, "energy less the\nmotors' work", "J"),
            )
            if values is not None
        ]
        if not curves:
            return None
        figure = Figure(figsize=(9.6, 0.6 + 1.9 * len(curves)))
        panels = figure.subplots(len(curves), 1, sharex=True, squeeze=False)[:, 0]
        for panel, (values, name, unit) in zip(panels, curves, strict=True):
            change = values - values[0]
            factor, shown = fitting(float(np.abs(change).max()), unit)
            thin = slice(None, None, max(len(change) // POINTS, 1))
            panel.plot(result.time[thin], change[thin] / factor, color=MEASURED)
            panel.axhline(0.0, color=SOFT, lw=0.8)
            panel.set_ylabel(f"{name} [{shown}]")
        panels[-1].set_xlabel("time [s]")
        return figure


def _draw_friction(
    panel: Axes,
    comparison: Comparison,
    torque: Unexplained,
    k: int,
    rate_factor: float,
    factor: float,
) -> None:
    side = comparison.best if comparison.best.strengths else comparison.as_built
    top = float(np.max(np.abs(torque.rate[:, k])))
    rate = np.linspace(-top, top, 801)
    slow = standstill(comparison.body.motion)
    curve = np.zeros_like(rate)
    for strength in side.strengths:
        shape = {
            "bearing_coulomb_friction": -rate / np.sqrt(np.square(rate) + slow**2),
            "bearing_viscous_friction": -rate,
            "aerodynamic_drag": -np.abs(rate) * rate,
        }.get(strength.symptom.name)
        if shape is not None:
            curve = curve + float(strength.values[0]) * shape
    if np.any(curve):
        panel.plot(rate / rate_factor, curve / factor, color=BEST, lw=2.0, label="fitted friction")
        panel.legend(loc="upper right")


def _turned(position: Array, first: Array) -> Array:
    """(m, k) angle, or rotation vector from the first attitude [rad]."""
    if position.shape[-1] != 4:
        return position
    return rotation.to_rotation_vector(rotation.multiply(rotation.conjugate(first), position))


def _frame(panel: Axes, values: Array) -> None:
    margin = 0.15 * max(float(np.ptp(values)), 1e-9)
    panel.set_ylim(float(values.min()) - margin, float(values.max()) + margin)


def _both(comparison: Comparison) -> list[tuple[Account, str, str]]:
    best = comparison.best
    label = "best model" if best.strengths else "base refitted"
    pairs = [(comparison.as_built.plain, BUILT, "as built")]
    if best.strengths or comparison.refitted is not None:
        pairs.append((best.explained, BEST, label))
    return pairs
