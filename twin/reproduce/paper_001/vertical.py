"""Fig. 9 and 10: the printed filter for the vertical offset, on a machine that swings freely."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.estimators import Estimator, VerticalOffsetFilter
from twin.platform import Platform
from twin.reproduce.paper_001.figures import Panel, drawn, named
from twin.reproduce.paper_001.flights import FlownRuns, astros, flown, tilted
from twin.reproduce.part import Computed, Ours, Say

Array = NDArray[np.float64]

BELOW = 4.959e-5
"""The CM below the CR, as the paper states the truth [m]."""
IN_PLANE = 2.6e-6
"""The unmodelled offset along x and along y [m]."""
START = tilted(0.0, 10.0)
DURATION, BEGIN, SETTLED = 400.0, 200.0, 10.0
"""[s]: of a run; from when the offset is averaged, over two swings, for what lies in the
plane makes it swing with the body; from when the rate's error counts."""
SEEDS = 20
FAST = 1000.0
"""[Hz]: what the gyro's rate might have been."""


def machine(x: float, y: float) -> Platform:
    """With the CM at (x, y) [m] in the plane, and as far below the CR as in the paper."""
    platform = astros()
    return replace(platform, center_of_mass_offset=platform.mass * np.array([x, y, -BELOW]))


def swing(
    platform: Platform,
    estimator: Estimator,
    duration: float = DURATION,
    seeds: int = SEEDS,
    believed: Sequence[str] = ("center_of_mass_offset", "rate_body"),
) -> FlownRuns:
    """From rest at a pitch of 10 deg, nothing driven."""
    return flown(platform, "free_float", estimator, START, duration, seeds=seeds, believed=believed)


def below(run: FlownRuns) -> Array:
    """(m, n) how far the filter takes the CM to be below the CR [m]."""
    return -run.believed["center_of_mass_offset"][..., 2] / astros().mass


def averaged(run: FlownRuns) -> Ours:
    """Mean over time and seeds; the interval is that of the mean over seeds."""
    each = below(run)[run.time >= BEGIN].mean(axis=0)
    half = 1.96 * float(each.std(ddof=1)) / np.sqrt(len(each))
    mean = float(each.mean())
    spread = each.std(ddof=1) / mean
    return Ours(mean, mean - half, mean + half, _averaged_words(spread))


def _averaged_words(spread: float) -> str:
    return f"Mean from {BEGIN:g} to {DURATION:g} s; seeds differ by {spread:.1%} (1 sigma). "


def rate_error(run: FlownRuns) -> Array:
    """(m, n, 3) of the filtered rate, once it has settled [rad/s]."""
    return (run.believed["rate_body"] - run.true["rate"])[run.time >= SETTLED]


def as_printed(say: Say) -> Computed:
    """No offset in the plane, as the filter takes it."""
    say(f"{DURATION:g} s of free swing, {SEEDS} seeds, with the printed filter")
    run = swing(machine(0.0, 0.0), VerticalOffsetFilter())
    say(f"the same with a gyro at {FAST:g} Hz")
    quick = rate_error(swing(_faster(machine(0.0, 0.0)), VerticalOffsetFilter(), 60.0, 1))
    result, error = averaged(run), rate_error(run)
    item = float(np.abs(error[:, 0]).max())
    gyro = astros().sensors["gyro"]
    rows = {
        "001.fig10.offset_as_printed": replace(
            result, note=result.note + f"The truth is {BELOW * 1e6:.2f} um."
        ),
        "001.fig9.rate_error": Ours(
            item,
            note=f"One run of {DURATION:g} s; rms {np.sqrt(np.mean(error**2)):.2g}. At the "
            f"{gyro.rate:g} Hz that are ASSUMED of the IMU, {gyro.noise[0]:.2g} rad/s of white "
            "noise a sample leave no less under the printed Q and R. The paper does not print the "
            f"IMU's rate: at {FAST:g} Hz the largest error in 60 s is {np.abs(quick).max():.2g}, "
            f"rms {np.sqrt(np.mean(quick**2)):.2g}.",
        ),
    }
    return Computed(rows, _figures(run))


def with_imbalance(say: Say) -> Computed:
    """The filter does not know of what is left in the plane."""
    say(f"{DURATION:g} s of free swing, {SEEDS} seeds, {IN_PLANE * 1e6:g} um in plane")
    result = averaged(swing(machine(-IN_PLANE, IN_PLANE), VerticalOffsetFilter()))
    say("and 5 um")
    five = averaged(swing(machine(-5e-6, 5e-6), VerticalOffsetFilter(), seeds=2))
    note = (
        f"In plane (-{IN_PLANE * 1e6:g}, {IN_PLANE * 1e6:g}) um, signs as in eq. 38; "
        f"(-5, 5) um, which eq. 38 has before balancing, make it {five.value * 1e6:.1f} um."
    )
    return Computed({"001.fig10.offset_with_imbalance": replace(result, note=result.note + note)})


def _faster(platform: Platform) -> Platform:
    gyro = replace(platform.sensors["gyro"], rate=FAST)
    return replace(platform, step=1.0 / FAST, sensors={**platform.sensors, "gyro": gyro})


def _figures(run: FlownRuns) -> dict[str, str]:
    estimate, truth = run.believed["rate_body"][:, 0], run.true["rate"][:, 0]
    height = np.stack([-below(run)[:, 0], np.full(len(run.time), -BELOW)], axis=-1)
    error = Panel("error [rad/s]", named(("x", "y", "z"), estimate - truth), (-1e-3, 1e-3))
    rates = [
        Panel(f"rate {axis} [rad/s]", {"estimated": estimate[:, i], "true": truth[:, i]})
        for i, axis in enumerate("xyz")
    ]
    offsets = [
        Panel("offset z [m]", named(("estimated", "true"), height), (-4.461e-5,), limit=1e-4),
        Panel("error [m]", {"": height[:, 0] - height[:, 1]}, limit=5e-5),
    ]
    return {
        "Fig. 9: estimated and true angular velocity, and the error": drawn(
            run.time, [*rates, error]
        ),
        "Fig. 10: estimated and true vertical offset (dashed: published), and the error": drawn(
            run.time, offsets
        ),
    }
