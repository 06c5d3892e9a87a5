"""Tables 1 and 2: masses alone against masses and magnetorquers, from -0.5 and from +0.5 mm.

Fig. 3 to 5 show the first of those tests.
"""

from collections.abc import Callable
from dataclasses import replace

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.platform import Platform
from twin.report.style import FIGURE, PALETTE, svg
from twin.reproduce.flown import Flown
from twin.reproduce.paper_003.bench import (
    ALL_MOTORS,
    PAPER_LENGTH,
    Tests,
    fly_tests,
    mechanical,
    mixed,
    ratio,
    table,
)
from twin.reproduce.part import Computed, Ours, PaperPart, Say
from twin.rotation import vertical_body

Array = NDArray[np.float64]


def first(say: Say) -> Computed:
    """Table 1 and Fig. 3 to 5."""
    alone, both = _flown(-1.0, say)
    dipole = np.abs(both.run.applied["command_dipole"])
    steps = np.ptp(both.mass_x, axis=0), np.ptp(alone.mass_x, axis=0)
    spread = both.mass_x.std(axis=0), alone.mass_x.std(axis=0)
    say("with twice the IMU's noise")
    noisy = _with_imu_noise(alone.run.platform, 2.0)
    twice = [fly_tests(noisy, law).in_plane for law in (mixed(), mechanical())]
    told = f" With twice that noise, which the paper does not print, it is {ratio(*twice)[0]:.2f}."
    in_plane = _in_plane(alone, both)
    rows = {
        "003.table1.in_plane": replace(in_plane, note=in_plane.note + told),
        "003.table1.peak_to_peak": _compared(*steps, 1e6, "um"),
        "003.table1.deviation": _compared(*spread, 1e6, "um"),
        "003.table1.torque": _torque(alone, both),
        "003.fig3.smoother": _compared(both.path, alone.path, 1e3, "mm"),
        "003.fig5.dipole": Ours(
            float(dipole.max()), note="At the start; the coils are never at their limit."
        ),
    }
    figures = {
        "Fig. 3: positions of the masses, by masses alone (lines) and mixed (dashes)": _drawn(
            alone, both, lambda run: 1e3 * run.true["stage_position"][:, 0, :2], "[mm]", ("x", "y")
        ),
        "Fig. 4: gravity in the plane, by masses alone (lines) and mixed (dashes)": _drawn(
            alone, both, lambda run: -vertical_body(run.seen["attitude"])[:, 0, :2], "[-]",
            ("x", "y"),
        ),
        "Fig. 5: dipole of the magnetorquers, mixed": _dipoles(both),
    }  # fmt: skip
    return Computed(rows, figures)


def second(say: Say) -> Computed:
    """Table 2."""
    alone, both = _flown(1.0, say)
    rows = {
        "003.table2.in_plane": _in_plane(alone, both),
        "003.table2.torque": _torque(alone, both),
    }
    return Computed(rows)


def _flown(side: float, say: Say) -> tuple[Tests, Tests]:
    machine = table(side, ALL_MOTORS)
    say("masses alone")
    alone = fly_tests(machine, mechanical())
    say("masses and magnetorquers")
    return alone, fly_tests(machine, mixed())


def _with_imu_noise(machine: Platform, factor: float) -> Platform:
    """The table with that many times the noise of its attitude."""
    sensor = machine.sensors["attitude"]
    sensor = replace(sensor, noise=factor * sensor.noise)
    return replace(machine, sensors={**machine.sensors, "attitude": sensor})


def _in_plane(alone: Tests, both: Tests) -> Ours:
    value, low, high = ratio(both.in_plane, alone.in_plane)
    early, *_ = ratio(both.in_plane_as_in_paper, alone.in_plane_as_in_paper)
    noise = float(np.linalg.norm(both.run.platform.sensors["attitude"].noise[:2]))
    note = (
        f"{both.in_plane.mean():.2g} over {alone.in_plane.mean():.2g}, the last 100 s of 1200 s: "
        "masses alone keep a limit cycle in their play, which the coils' damping takes away; the "
        f"IMU's noise is {noise:.2g}. After the paper's 300 s the ratio is {early:.2f}: "
        "the integral of both is still on its way."
    )
    return Ours(value, low, high, note)


def _torque(alone: Tests, both: Tests) -> Ours:
    value, low, high = ratio(both.torque, alone.torque)
    note = (
        f"{1e6 * both.torque.mean():.3g} over {1e6 * alone.torque.mean():.3g} uN m, of which "
        "the gyro's noise is the larger part."
    )
    return Ours(value, low, high, note)


def _compared(both: Array, alone: Array, factor: float, unit: str) -> Ours:
    note = f"{factor * both.mean():.3g} over {factor * alone.mean():.3g} {unit}."
    return Ours(float(both.mean() / alone.mean()), note=note)


def _drawn(
    alone: Tests, both: Tests, what: Callable[[Flown], Array], unit: str, names: tuple[str, ...]
) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 4.8))
        panels = figure.subplots(len(names), 1, sharex=True)
        for column, (panel, name) in enumerate(zip(panels, names, strict=True)):
            for tests, style in ((alone, "-"), (both, "--")):
                run = tests.run.between(0.0, PAPER_LENGTH)
                panel.plot(run.time, what(run)[:, column], style, color=PALETTE[column], lw=0.9)
            panel.set_ylabel(f"{name} {unit}")
        panels[-1].set_xlabel("time [s]")
        return svg(figure)


def _dipoles(both: Tests) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.4))
        panel = figure.subplots()
        run: Flown = both.run.between(0.0, PAPER_LENGTH)
        for column, name in enumerate("xyz"):
            dipole = run.applied["command_dipole"][:, 0, column]
            panel.plot(run.time, dipole, color=PALETTE[column], lw=0.8, label=name)
        panel.set_xlabel("time [s]")
        panel.set_ylabel("dipole [A m²]")
        panel.legend(ncols=3)
        return svg(figure)


PARTS = (
    PaperPart(
        (
            "003.table1.in_plane",
            "003.table1.peak_to_peak",
            "003.table1.deviation",
            "003.table1.torque",
            "003.fig3.smoother",
            "003.fig5.dipole",
        ),
        first,
    ),
    PaperPart(("003.table2.in_plane", "003.table2.torque"), second),
)
