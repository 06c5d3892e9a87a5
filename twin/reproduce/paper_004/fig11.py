"""Fig. 11: identify, move the masses by what was found, again: what gravity still asks."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.identification import identify
from twin.plant.initial import InitialState
from twin.reference import Multisine
from twin.report.style import FIGURE, PALETTE, SOFT, svg
from twin.reproduce.paper_004.manoeuvre import as_guessed, flown, machine
from twin.reproduce.part import Computed, Ours, PaperPart, Say

Array = NDArray[np.float64]

ITERATIONS = 3
SEED = 80
DURATION = 60.0
"""[s] of each manoeuvre, ASSUMED."""
MOTION = Multisine(np.radians(10.0), 0.02)
LIMIT = 0.01
"""[N m]: paper."""


def compute(say: Say) -> Computed:
    """From the offset of Table 3, by Levenberg-Marquardt; eq. 18 and 19."""
    platform = machine("sads:table3")
    pull = np.array([stage.mass * stage.axis for stage in platform.stages])
    place, torques = np.zeros(len(pull)), list[float]()
    for number in range(ITERATIONS + 1):
        left = platform.center_of_mass_offset + place @ pull
        torques.append(platform.gravity * float(np.linalg.norm(left)))
        if number == ITERATIONS:
            break
        say(f"Fig. 11: iteration {number + 1}, {torques[-1]:.2g} N m left")
        # it swings about where it hangs until it is balanced, then about level
        start = InitialState(stage_position=place) if number else None
        (log,) = flown(platform, MOTION, duration=DURATION, runs=1, seed=SEED + number, start=start)
        told = as_guessed(platform)
        moment = identify([log.without_truth()], told, "levenberg-marquardt").theta[6:9]
        step = np.array([stage.resolution for stage in platform.stages])
        place = np.rint(-np.linalg.solve(pull.T, moment) / step) * step
    shown = ", ".join(f"{1e3 * torque:.3g}" for torque in torques)
    note = f"Largest torque of gravity, from start to end: {shown} mN m."
    return Computed(
        {"004.fig11.torque": Ours(torques[-1], note=note)},
        {"Fig. 11: largest torque of gravity over the iterations": _figure(torques)},
    )


def _figure(torques: list[float]) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.6))
        panel = figure.subplots()
        panel.semilogy(range(len(torques)), torques, "o-", color=PALETTE[0])
        panel.axhline(LIMIT, color=SOFT, ls="--")
        panel.set_xticks(range(len(torques)))
        panel.set(xlabel="iteration", ylabel="gravity torque [N m]")
        return svg(figure)


PART = PaperPart(("004.fig11.torque",), compute)
