"""Fig. 7 and 8: the masses level the body and come to rest where they balance it."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.estimators import AttitudeFilter, Passthrough
from twin.reproduce.paper_001.figures import Panel, drawn, named
from twin.reproduce.paper_001.flights import STABLE, FlownRuns, astros, exact_sensors, flown, tilted
from twin.reproduce.part import Computed, Ours, Say
from twin.rotation import tilt, to_euler_zyx

Array = NDArray[np.float64]

DURATION, LAST = 200.0, 20.0
"""[s]."""
PUBLISHED = (2.3341e-4, -3.3828e-4)
"""Final positions, drawn into our figure [m]."""


def fly(gains: Mapping[str, float], *, noisy: bool = False) -> FlownRuns:
    """From rest at (1, 1) deg, as the paper's simulation; what sensors it fed its law is unsaid."""
    platform = astros() if noisy else exact_sensors(astros())
    estimator = AttitudeFilter() if noisy else Passthrough()
    return flown(platform, "mass_pid", estimator, tilted(1.0, 1.0), DURATION, gains=gains)


def tilts(run: FlownRuns) -> Array:
    """(m,) [rad]."""
    return tilt(run.true["attitude"][:, 0])


def settling(say: Say) -> Computed:
    """The run with K_I = 0.1, with exact sensors, and with those that are shipped."""
    say("200 s with the masses' law, exact sensors and noisy ones")
    run, noisy = fly(STABLE), fly(STABLE, noisy=True)
    angle, shaken = tilts(run), tilts(noisy)
    final = run.true["stage_position"][-1, 0]
    late = noisy.true["stage_position"][noisy.time >= DURATION - LAST, 0]
    mean, spread = late.mean(axis=0), late.std(axis=0)
    rows = {
        "001.fig7.settles": Ours(
            float(angle[-1] / angle[0]),
            note=f"Exact sensors; behind the noisy ones of the shipped machine the tilt stays "
            f"below {np.degrees(shaken[run.time >= DURATION - LAST].max()):.2f} deg in the last "
            f"{LAST:g} s, because K_w turns 0.14 deg/s of noise into torque.",
        )
    }
    for axis in range(2):
        rows[f"001.fig8.mass_{axis + 1}"] = Ours(
            float(final[axis]),
            note=f"Exact sensors, at {DURATION:g} s; with noisy ones {mean[axis] * 1e6:.0f} um on "
            f"average over the last {LAST:g} s, moving by {spread[axis] * 1e6:.0f} um (1 sigma). "
            "The static balance is 134 kg x 5 um over the sliding mass.",
        )
    return Computed(rows, {**_attitudes(run), **_masses(run)})


def _attitudes(run: FlownRuns) -> dict[str, str]:
    angles = np.degrees(to_euler_zyx(run.true["attitude"][:, 0])[:, ::-1])
    panels = [
        Panel("Euler angles [deg]", named(("roll", "pitch", "yaw"), angles)),
        Panel("rate, body [rad/s]", named(("x", "y", "z"), run.true["rate"][:, 0])),
    ]
    return {"Fig. 7: Euler angles and angular velocity, K_I = 0.1": drawn(run.time, panels)}


def _masses(run: FlownRuns) -> dict[str, str]:
    moment = run.true["center_of_mass_offset"][:, 0] / astros().mass
    panels = [
        Panel(
            "mass [m]",
            named(("1", "2", "3"), run.true["stage_position"][:, 0]),
            PUBLISHED,
            limit=1e-3,
        ),
        Panel("offset [m]", named(("x", "y", "z"), moment)),
    ]
    return {"Fig. 8: the masses' positions (dashed: published) and offset": drawn(run.time, panels)}
