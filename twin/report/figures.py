"""Figures of a comparison, as SVG text to stand in a page."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin import rotation
from twin.predict.compare import Comparison, FreeRun
from twin.predict.fit import Fit
from twin.predict.laws import STANDSTILL
from twin.predict.torque import Unexplained, unexplained_torque
from twin.report.style import FIGURE, INK, svg
from twin.units import fitting

Array = NDArray[np.float64]

MEASURED, BUILT, BEST, BAND = INK, "#c2571a", "#1f6f8b", "#d9e3ea"
AXES = ("x", "y", "z")

POINTS = 1500
"""Drawn of a long stream: more cannot be told apart, and would make a page of megabytes."""


def motion_figure(comparison: Comparison) -> str:
    """Measured motion and free runs of the model as built and of the best one."""
    with mpl.rc_context(FIGURE):
        output = comparison.predictor.outputs[0]
        attitude = output.stream == "attitude"
        figure = Figure(figsize=(9.6, 1.2 + (2.4 if output.width == 1 else 1.9 * output.width)))
        panels = figure.subplots(output.width, 1, sharex=True, squeeze=False)[:, 0]
        factor, unit = fitting(1.0, "rad" if attitude else output.series.unit)
        time, measured = output.series.time, output.series.value
        if attitude:
            start = rotation.conjugate(measured[0])
            measured = rotation.to_rotation_vector(rotation.multiply(start, measured))
        run = shown_run(comparison)
        for k, panel in enumerate(panels):
            panel.plot(time, measured[:, k] / factor, color=MEASURED, label="measured", lw=2.6)
            for runs, color, label in (
                (run.as_built if run else [], BUILT, "as built"),
                (run.best if run else [], BEST, "best model"),
            ):
                for i, (when, error) in enumerate(runs):
                    at = np.searchsorted(time, when)
                    predicted = (measured[at, k] - error[:, k]) / factor
                    panel.plot(when, predicted, color=color, label=None if i else label)
            _frame(panel, measured[:, k] / factor)
            axes = AXES if attitude else output.series.columns
            panel.set_ylabel(_label(output.stream, axes, k, unit))
        panels[0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        panels[-1].set_xlabel("time [s]")
        return svg(figure)


def shown_run(comparison: Comparison) -> FreeRun | None:
    """The free runs that a figure shows: at least as long as the stretches of the fit."""
    segment = comparison.predictor.segments[0]
    runs = [run for run in comparison.free_runs.values() if run is not None]
    long = [run for run in runs if run.horizon >= segment.stop - segment.start]
    return (long or runs or [None])[0]


def residual_figure(comparison: Comparison) -> str:
    """Residuals over time, with the band in which 95 % of the sensors' noise lies."""
    with mpl.rc_context(FIGURE):
        outputs = comparison.predictor.outputs
        figure = Figure(figsize=(9.6, 1.0 + 2.0 * len(outputs)))
        panels = figure.subplots(len(outputs), 1, sharex=True, squeeze=False)[:, 0]
        for panel, output in zip(panels, outputs, strict=True):
            unit = "rad" if output.stream == "attitude" else output.series.unit
            factor, name = fitting(1.0, unit)
            heights: list[float] = []
            for found, color, label in _both(comparison):
                time, error = _joined(comparison, found, output.stream)
                thin = slice(None, None, max(len(time) // POINTS, 1))
                panel.plot(time[thin], error[thin] / factor, ".", ms=2.0, color=color)
                panel.plot([], [], "o", ms=4, color=color, label=label)
                heights.append(float(np.quantile(np.abs(error), 0.99)) / factor)
            band = 1.96 * float(np.max(output.noise)) / factor
            panel.axhspan(-band, band, color=BAND, zorder=0, label="95 % of the noise")
            panel.set_ylim(*(np.array([-1.25, 1.25]) * max(*heights, band)))
            panel.set_ylabel(f"{output.stream}\nresidual [{name}]")
        panels[0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        panels[-1].set_xlabel("time [s]")
        return svg(figure)


def torque_figure(comparison: Comparison) -> str:
    """Unexplained torque over rate with the friction that the fit found drawn through it."""
    with mpl.rc_context(FIGURE):
        account = comparison.best
        found = account.explanation.fit
        if not account.explanation.laws:
            account, found = comparison.as_built, comparison.as_built.explanation.fit
        torque = unexplained_torque(comparison.predictor, comparison.base.model(found.theta))
        width = torque.rate.shape[1]
        figure = Figure(figsize=(9.6, 3.6))
        panels = figure.subplots(1, width, squeeze=False)[0]
        rate_factor, rate_name = fitting(1.0, "rad/s")
        for k, panel in enumerate(panels):
            limit = 1.6 * float(np.quantile(np.abs(torque.torque[:, k]), 0.97))
            factor, name = fitting(limit, "N m")
            thin = slice(None, None, max(len(torque.time) // POINTS, 1))
            panel.plot(
                torque.rate[thin, k] / rate_factor,
                torque.torque[thin, k] / factor,
                ".",
                ms=2.0,
                color=MEASURED,
                alpha=0.25,
            )
            _draw_friction(panel, comparison, torque, k, rate_factor, factor)
            panel.set_ylim(-limit / factor, limit / factor)
            axis = f" {AXES[k]}" if width > 1 else ""
            panel.set_xlabel(f"rate{axis} [{rate_name}]")
            panel.set_ylabel(f"unexplained torque{axis} [{name}]")
        return svg(figure)


def _draw_friction(
    panel: Axes,
    comparison: Comparison,
    torque: Unexplained,
    k: int,
    rate_factor: float,
    factor: float,
) -> None:
    account = comparison.best if comparison.best.explanation.laws else comparison.as_built
    top = float(np.max(np.abs(torque.rate[:, k])))
    rate = np.linspace(-top, top, 801)
    slow = STANDSTILL * float(np.quantile(np.abs(torque.rate[:, k]), 0.95))
    curve = np.zeros_like(rate)
    for strength in account.explanation.laws:
        shape = {
            "bearing_coulomb_friction": -rate / np.sqrt(np.square(rate) + slow**2),
            "bearing_viscous_friction": -rate,
            "aerodynamic_drag": -np.abs(rate) * rate,
        }.get(strength.law.name)
        if shape is not None:
            curve = curve + strength.value * shape
    if np.any(curve):
        panel.plot(rate / rate_factor, curve / factor, color=BEST, lw=2.0, label="fitted friction")
        panel.legend(loc="upper right")


def _frame(panel: Axes, values: Array) -> None:
    margin = 0.15 * max(float(np.ptp(values)), 1e-9)
    panel.set_ylim(float(values.min()) - margin, float(values.max()) + margin)


def _both(comparison: Comparison) -> list[tuple[Fit, str, str]]:
    label = "best model" if comparison.best.explanation.laws else "base refitted"
    pairs = [(comparison.as_built.plain, BUILT, "as built")]
    if comparison.best.explanation.laws or comparison.refitted is not None:
        pairs.append((comparison.best.explanation.fit, BEST, label))
    return pairs


def _joined(comparison: Comparison, found: Fit, stream: str) -> tuple[Array, Array]:
    parts = [comparison.predictor.split(s, flat)[stream] for s, flat in enumerate(found.residual)]
    return np.concatenate([t for t, _ in parts]), np.concatenate([e for _, e in parts])


def _label(stream: str, columns: tuple[str, ...], k: int, unit: str) -> str:
    name = stream if len(columns) == 1 else f"{stream} {columns[k]}"
    return f"{name} [{unit}]"
