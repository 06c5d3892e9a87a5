"""Fig. 9: the moving averages that the paper smooths its rates and wheel speeds with."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from twin.plant.initial import hanging
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.report.style import FIGURE, INK, PALETTE, SOFT, svg
from twin.reproduce.paper_002.manoeuvre import flown, machine, wheels
from twin.reproduce.part import Computed, Ours, PaperPart, Say

Array = NDArray[np.float64]

GYRO, WHEELS = 10.0, 15.0
"""Nyquist frequency of what is averaged over the machine's natural frequency: paper."""
SEED = 2


def compute(say: Say) -> Computed:
    """Average the gyro of `whorl1` as it is, and hold that against what it should have read."""
    say("Fig. 9: moving averages")
    platform = as_measured()
    (log,) = flown(platform, wheels(), start=hanging(platform.center_of_mass_offset), seed=SEED)
    gyro = log["gyro"]
    noise = gyro.value - log["truth_rate"].interpolated_at(gyro.time)
    frequency = natural_frequency(platform)
    rate = platform.sensors["gyro"].rate
    width = samples(rate, GYRO * frequency)
    fewer = samples(rate, GYRO * 2.0 * np.pi * frequency)
    before, after, taken = (
        float(uniform_filter1d(noise, size, axis=0).std()) for size in (1, width, fewer)
    )
    note = (
        f"Its faster swing has {frequency:.3f} Hz, so {width} samples of 41 Hz are averaged. With "
        f"its rad/s taken for Hz {fewer} samples are, which leaves {taken / before:.2f}, as was "
        "published."
    )
    return Computed(
        {"002.fig9.moving_average": Ours(after / before, note=note)},
        {"Fig. 9: rate and wheel speeds, as read and smoothed": _figure(log, rate, frequency)},
    )


def as_measured() -> Platform:
    """Table 1's machine, its gyro and wheel speeds read as in the laboratory."""
    shipped = load_platform("whorl1:table1").sensors
    exact = machine()
    gyro = replace(shipped["gyro"], bias=np.zeros(3))
    sensors = {**exact.sensors, "gyro": gyro, "wheel_speed": shipped["wheel_speed"]}
    return replace(exact, sensors=sensors)


def natural_frequency(platform: Platform) -> float:
    """[Hz] of the faster of its two small swings about where it hangs."""
    moment = platform.center_of_mass_offset
    down = moment / np.linalg.norm(moment)
    stiffness = platform.gravity * np.linalg.norm(moment) * (np.eye(3) - np.outer(down, down))
    squares = np.linalg.eigvals(np.linalg.solve(platform.inertia, stiffness)).real
    return float(np.sqrt(squares.max()) / (2.0 * np.pi))


def samples(rate: float, nyquist: float) -> int:
    """To be averaged, for a Nyquist frequency of what is left [Hz]."""
    return max(round(rate / (2.0 * nyquist)), 1)


def _figure(log: Recording, rate: float, frequency: float) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 6.0))
        top, bottom = figure.subplots(2, 1, sharex=True)
        gyro = log["gyro"]
        width = samples(rate, GYRO * frequency)
        top.plot(gyro.time, gyro.value[:, 0], ".", ms=1.5, color=SOFT, label="as read")
        smooth = uniform_filter1d(gyro.value[:, 0], width)
        top.plot(gyro.time, smooth, color=PALETTE[1], label=f"mean of {width}")
        top.set_ylabel("rate about x [rad/s]")
        # the stairs are what the laboratory has at the gyro's rate
        stairs = log["wheel_speed"].held_at(gyro.time)
        width = samples(rate, WHEELS * frequency)
        for k, color in enumerate(PALETTE[:3]):
            bottom.step(gyro.time, stairs[:, k], color=SOFT, lw=0.8, where="post")
            smooth = uniform_filter1d(stairs[:, k], width)
            bottom.plot(gyro.time, smooth, color=color, label=f"wheel {k + 1}, mean of {width}")
        bottom.set(xlabel="time [s]", ylabel="wheel speed [rad/s]")
        for panel in (top, bottom):
            panel.legend(ncols=3, labelcolor=INK)
        return svg(figure)


PART = PaperPart(("002.fig9.moving_average",), compute)
