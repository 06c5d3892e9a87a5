"""Fig. 3 and 4: thrusters turn the reference body, wheels make the machine follow it."""

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.report.style import FIGURE, PALETTE, svg
from twin.reproduce.paper_002.manoeuvre import ThrustedBody, machine, square, tracked
from twin.reproduce.part import Computed, Ours, PaperPart, Say

Array = NDArray[np.float64]


def compute(say: Say) -> Computed:
    """One flight under eq. 26."""
    say("Fig. 4: tracking")
    log = tracked()
    gyro = log["gyro"]
    wanted = ThrustedBody(np.diag(machine().inertia)).at(gyro.time).rate_body
    value = float(np.abs(gyro.value - wanted).max() / np.abs(wanted).max())
    torque = np.abs(log["command_wheel_torque"].value).max()
    note = (
        f"Largest rate {np.abs(wanted).max():.3f} rad/s, largest wheel torque {torque:.2f} N m; "
        "the machine is as simple as the body, and the law knows it."
    )
    panels = (
        (gyro.time, square(gyro.time), "thrusters' torque [N m]"),
        (gyro.time, wanted, "rate of the body [rad/s]"),
        (gyro.time, gyro.value, "rate of the gyrostat [rad/s]"),
        (gyro.time, gyro.value - wanted, "difference [rad/s]"),
        (gyro.time, log["command_wheel_torque"].value, "motors' torque [N m]"),
        (gyro.time, log["wheel_speed"].value, "wheel speed [rad/s]"),
    )
    return Computed(
        {"002.fig4.tracking": Ours(value, note=note)},
        {"Fig. 3 and 4: the reference body, and wheels that track it": _figure(panels)},
    )


def _figure(panels: tuple[tuple[Array, Array, str], ...]) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 8.0))
        places = figure.subplots(3, 2, sharex=True).ravel()
        for panel, (time, values, label) in zip(places, panels, strict=True):
            for column, name, color in zip(values.T, "xyz", PALETTE, strict=False):
                panel.plot(time, column, color=color, label=name)
            panel.set_ylabel(label)
        places[0].legend(ncols=3)
        for panel in places[-2:]:
            panel.set_xlabel("time [s]")
        return svg(figure)


PART = PaperPart(("002.fig4.tracking",), compute)
