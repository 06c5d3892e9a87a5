"""Table 1 and Fig. 5: recursion and Levenberg-Marquardt on the paper's own simulation."""

from contextlib import suppress

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.errors import PlatformError
from twin.identification import identify
from twin.platform import Platform
from twin.recording import Recording, Series
from twin.report.style import FIGURE, INK, PALETTE, svg
from twin.reproduce.inertia import entries_of
from twin.reproduce.paper_004.manoeuvre import as_guessed, flown, machine, resimulated
from twin.reproduce.paper_004.table1_ours import DURATION, MOTION, TORQUE
from twin.reproduce.part import Computed, Ours, PaperPart, Say

Array = NDArray[np.float64]

SEEDS = 20
SEED = 40
RECURSIVE, TRAJECTORY = "recursive", "levenberg-marquardt"


def compute(say: Say) -> Computed:
    """Twenty runs with their own noise and disturbance, both methods."""
    say("Table 1: flights")
    platform = machine("sads:table1_noise")
    logs = flown(platform, MOTION, duration=DURATION, runs=SEEDS, seed=SEED, torque=TORQUE)
    result: dict[str, list[Array]] = {RECURSIVE: [], TRAJECTORY: []}
    for run, log in enumerate(logs):
        say(f"Table 1: run {run}")
        for method, thetas in result.items():
            identification = identify([log.without_truth()], as_guessed(platform), method)
            thetas.append(identification.theta[:9])
    truth, mean_moment = entries_of(platform), float(np.trace(platform.inertia)) / 3.0
    worst = {m: np.abs(np.array(thetas) - truth) for m, thetas in result.items()}
    inertia = {m: float(np.median(e[:, :6].max(axis=1))) / mean_moment for m, e in worst.items()}
    offset = float(np.median(worst[TRAJECTORY][:, 6:].max(axis=1))) / platform.mass
    note = f"About the hanging attitude, {DURATION:g} s, median of {SEEDS} runs."
    return Computed(
        {
            "004.table1.rls": Ours(
                inertia[RECURSIVE],
                note=f"{note} Forgetting 0.99 a step; noise in the columns makes moments small.",
            ),
            "004.table1.clm": Ours(inertia[TRAJECTORY], note=note),
            "004.table1.clm_offset": Ours(offset, note=note),
        },
        {
            "Fig. 5: rates, true and simulated with what was found, where that is a body": _figure(
                platform, logs[0], {m: thetas[0] for m, thetas in result.items()}
            )
        },
    )


def _figure(platform: Platform, log: Recording, result: dict[str, Array]) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 6.0))
        panels = figure.subplots(3, 1, sharex=True)
        true = log["truth_rate"]
        paths: dict[str, Series] = {}
        for method, theta in result.items():
            # recursion may end at a J that no body has
            with suppress(PlatformError):
                paths[method] = resimulated(platform, theta, log)
        for k, panel in enumerate(panels):
            panel.plot(true.time, np.degrees(true.value[:, k]), color=INK, lw=2.4, label="true")
            for (method, rate), color in zip(paths.items(), PALETTE, strict=False):
                panel.plot(rate.time, np.degrees(rate.value[:, k]), color=color, label=method)
            panel.set_ylabel(f"rate about {'xyz'[k]} [deg/s]")
        panels[0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
        panels[-1].set_xlabel("time [s]")
        return svg(figure)


PART = PaperPart(("004.table1.rls", "004.table1.clm", "004.table1.clm_offset"), compute)
