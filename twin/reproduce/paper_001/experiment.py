"""Fig. 16 and 17: the experiment, with an inclinometer and rates by its differences."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.estimators import InclinometerDifferences
from twin.reproduce.paper_001.figures import Panel, drawn, named
from twin.reproduce.paper_001.flights import STABLE, FlownRuns, astros, flown, tilted
from twin.reproduce.part import Computed, Ours, Say
from twin.rotation import to_euler_zyx, vertical_body

Array = NDArray[np.float64]

START = tilted(-1.61, -2.93, (0.06, 0.0, 0.0))
"""Section 4.2."""
FINAL = (-1.1e-3, 1.5e-3)
"""Where the masses of Fig. 17 come to rest [m]: its offset is not printed."""
DURATION = 200.0
"""[s]."""
FILTERED = 2.0
"""[Hz], second order, ASSUMED."""
SETTLED = np.radians(0.05)
"""[rad]."""


def run_from(moment: Array, cutoff: float = np.inf) -> FlownRuns:
    """The experiment with another m r [kg m], and a low-pass in its inclinometer [Hz]."""
    platform = astros(moment)
    sensors = dict(platform.sensors)
    sensors["inclinometer"] = replace(sensors["inclinometer"], cutoff=cutoff, order=2)
    return flown(
        replace(platform, sensors=sensors),
        "mass_pid",
        InclinometerDifferences(),
        START,
        DURATION,
        gains=STABLE,
    )


def balanced_by(final: tuple[float, float]) -> Array:
    """m r that the first two masses take away at these positions [kg m], z as in eq. 38."""
    platform = astros()
    taken = sum(
        stage.mass * place * stage.axis
        for stage, place in zip(platform.stages[:2], final, strict=True)
    )
    return np.array([0.0, 0.0, platform.center_of_mass_offset[2]]) - taken


def hanging() -> Array:
    """m r of a machine that hangs at rest at the printed start [kg m], z as in eq. 38."""
    up = vertical_body(START.attitude)
    return astros().center_of_mass_offset[2] * up / up[2]


def settled_at(run: FlownRuns) -> float:
    """When roll and pitch stay within `SETTLED` from then on [s]; inf: not at the end."""
    angles = np.abs(to_euler_zyx(run.true["attitude"][:, 0]))[:, 1:]
    outside = np.flatnonzero(angles.max(axis=1) > SETTLED)
    if outside.size and outside[-1] == len(run.time) - 1:
        return np.inf
    return float(run.time[outside[-1] + 1]) if outside.size else 0.0


def final(run: FlownRuns) -> Array:
    """(stages,) over the last 20 s [m]."""
    return run.true["stage_position"][run.time >= DURATION - 20.0, 0].mean(axis=0)


def hardware(say: Say) -> Computed:
    """Two offsets: that of Fig. 17, and that with which the machine would hang as it started."""
    say("200 s from the printed start, with two offsets, and behind a low-pass")
    printed, hung = run_from(balanced_by(FINAL)), run_from(hanging())
    filtered = run_from(balanced_by(FINAL), FILTERED)
    place = final(hung)
    chatter = printed.true["stage_position"][printed.time >= DURATION - 20.0, 0].std(axis=0).max()
    rows = {
        "001.fig16.settled_at": Ours(
            settled_at(printed),
            note="The inclinometer, whose bandwidth is not printed and which here has none, feels "
            "each move of the masses as a tilt; differences of that, rounded to 0.001 deg, make "
            f"them chatter by {chatter * 1e3:.2f} mm and the tilt wander about 0.05 deg. Behind a "
            f"low-pass of {FILTERED:g} Hz it settles at {settled_at(filtered):.0f} s; with the "
            f"offset of a machine that hangs as it started, at {settled_at(hung):.0f} s.",
        ),
        "001.fig17.masses": Ours(
            float(np.abs(place[:2]).max()),
            note="The machine is taken to hang at rest where it started, so that nothing of "
            f"Fig. 17 goes in: masses at {place[0] * 1e3:.2f} and {place[1] * 1e3:.2f} mm "
            "(published -1.1 and 1.5 mm).",
        ),
    }
    return Computed(rows, {**_attitudes(printed), **_masses(printed, hung)})


def _attitudes(run: FlownRuns) -> dict[str, str]:
    angles = np.degrees(to_euler_zyx(run.true["attitude"][:, 0])[:, ::-1])
    panels = [
        Panel("Euler angles [deg]", named(("roll", "pitch"), angles[:, :2])),
        Panel("rate, body [rad/s]", named(("x", "y", "z"), run.true["rate"][:, 0])),
    ]
    return {"Fig. 16: Euler angles and angular velocity, K_I = 0.1": drawn(run.time, panels)}


def _masses(printed: FlownRuns, hung: FlownRuns) -> dict[str, str]:
    in_mm = [1e3 * place for place in FINAL]
    panels = [
        Panel(label, named(("1", "2", "3"), run.true["stage_position"][:, 0] * 1e3), in_mm)
        for label, run in (("mass [mm], its offset", printed), ("mass [mm], hanging", hung))
    ]
    return {"Fig. 17: the masses' positions (dashed: published)": drawn(printed.time, panels)}
