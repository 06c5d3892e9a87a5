"""Fig. 10: rates as measured beside those simulated with what Levenberg-Marquardt found."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.identification import identify
from twin.recording import Series
from twin.reference import Multisine
from twin.report.style import FIGURE, PALETTE, SOFT, svg
from twin.reproduce.paper_004.manoeuvre import as_guessed, flown, machine, resimulated
from twin.reproduce.part import Computed, Ours, PaperPart, Say

Array = NDArray[np.float64]

SEED = 70
DURATION = 60.0
"""[s], ASSUMED."""


def compute(say: Say) -> Computed:
    """One log of the machine of Table 3 with the AHRS that `sads` has."""
    say("Fig. 10: a manoeuvre, and its simulation")
    platform = machine("sads:table3")
    motion = Multisine(np.radians(15.0), 0.02)
    (log,) = flown(platform, motion, duration=DURATION, runs=1, seed=SEED)
    told = as_guessed(platform)
    theta = identify([log.without_truth()], told, "levenberg-marquardt").theta
    simulated = resimulated(platform, theta, log)
    gyro = log["gyro"]
    again = simulated.interpolated_at(gyro.time)
    off = gyro.value - again
    value = float(np.sqrt(np.mean(off**2) / np.mean(gyro.value**2)))
    scatter = float(np.sqrt(np.mean((off - off.mean(axis=0)) ** 2)))
    note = (
        "From where what was found hangs, under the wheels' torques alone; what is left is "
        f"{1e3 * scatter:.2f} mrad/s of noise and the gyro's bias."
    )
    return Computed(
        {"004.fig10.rates": Ours(value, note=note)},
        {"Fig. 10: rates measured, and simulated with what was found": _figure(gyro, again)},
    )


def _figure(gyro: Series, again: Array) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 6.0))
        panels = figure.subplots(3, 1, sharex=True)
        for k, panel in enumerate(panels):
            panel.plot(gyro.time, np.degrees(gyro.value[:, k]), color=SOFT, label="measured")
            panel.plot(gyro.time, np.degrees(again[:, k]), color=PALETTE[1], label="simulated")
            panel.set_ylabel(f"rate about {'xyz'[k]} [deg/s]")
        panels[0].legend(ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0))
        panels[-1].set_xlabel("time [s]")
        return svg(figure)


PART = PaperPart(("004.fig10.rates",), compute)
