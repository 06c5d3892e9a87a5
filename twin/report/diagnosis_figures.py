"""Figures of a diagnosis: what each stream left over time, and what every cause would explain."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from twin.diagnosis import Diagnosis
from twin.report.figures import BEST, BUILT, drawn_motion, drawn_residuals, run_to_show
from twin.report.style import FIGURE, INK, PALETTE, SOFT

BAND = "#e3edf2"
BEFORE, AFTER = PALETTE[1], PALETTE[0]
LISTED = 18
"""Causes that are drawn, the strongest alone first."""


def prediction_figure(found: Diagnosis) -> Figure:
    """Of the first log, the measured motion, and free runs of the model without the causes and with
    them."""
    body = found.explained.bodies[0]
    run = run_to_show(found.free_runs, body)
    return drawn_motion(body.motion, run, before="before", after="after")


def left_figure(found: Diagnosis) -> Figure:
    """Of the first log, the residual of each stream, without the causes and with them."""
    accounts = [(found.baseline.account, BUILT, "before"), (found.explained.account, BEST, "after")]
    return drawn_residuals(found.explained.bodies[0], accounts)


def before_after_figure(found: Diagnosis) -> Figure:
    """Chi-square a sample of each stream over time, without the causes and with them."""
    with mpl.rc_context(FIGURE):
        before = found.baseline.account.misfits
        after = found.explained.account.misfits
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


def evidence_figure(found: Diagnosis) -> Figure:
    """What each cause explains on its own, and what it still adds beside those that were found."""
    with mpl.rc_context(FIGURE):
        rows = [(c.effect.label, c.alone, c.evidence, True) for c in found.causes]
        rows += [(t.label, t.alone, t.evidence, False) for t in found.tried]
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
