"""Fig. 5 to 7: what a shift and a turn of the wheels' data do to the momentum integral (1)."""

from collections.abc import Callable
from dataclasses import replace

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.identification import identify
from twin.predict.base import NAMES
from twin.recording import Recording, Series
from twin.report.style import FIGURE, PALETTE, SOFT, svg
from twin.reproduce.inertia import entries_of
from twin.reproduce.paper_002.manoeuvre import DURATION, NOISE, ideal, machine, measured
from twin.reproduce.paper_002.methods import METHODS
from twin.reproduce.part import Computed, Ours, PaperPart, Say

Array = NDArray[np.float64]

SHIFTS = np.linspace(-1.5, 1.5, 61)
"""[s], as far as the paper goes."""
TURNS = np.radians(np.linspace(-3.6, 3.6, 9))
"""[rad] about z: paper, from CAD."""
EDGE = 2.0
"""[s] left out at either end, where a shifted stream has nothing."""
SEED = 6


def compute(say: Say) -> Computed:
    """61 shifts without noise and with it, 9 turns."""
    say("Fig. 5: shifts")
    log = ideal().without_truth()
    shifted_log = _estimates(log, SHIFTS, shifted)
    say("Fig. 6: shifts under noise")
    noisy = measured(log, NOISE, np.random.default_rng(SEED))
    under_noise = _estimates(noisy, SHIFTS, shifted)
    say("Fig. 7: turns")
    turned_log = _estimates(log, TURNS, turned)
    places = [p for p in map(turn_nearest_sync, shifted_log.T) if p is not None]
    bent = np.array([bend(TURNS, column) for column in turned_log.T])
    change = np.ptp(turned_log, axis=0) / np.abs(entries_of(machine()))
    plain = change > 0.01
    large = f"{bent[plain].max():.3f}" if plain.any() else "none"
    figures = {
        "Fig. 5: effect of time synchronisation, perfect data": _figure(
            SHIFTS, shifted_log, "shift of the wheels' data [s]"
        ),
        "Fig. 6: effect of time synchronisation, with noise": _figure(
            SHIFTS, under_noise, "shift of the wheels' data [s]"
        ),
        "Fig. 7: effect of angular alignment, perfect data": _figure(
            np.degrees(TURNS), turned_log, "turn of the wheels [deg]"
        ),
    }
    return Computed(
        {
            "002.fig5.extremum": Ours(
                float(np.median(places)),
                note=f"Median of the {len(places)} parameters, of nine, that turn.",
            ),
            "002.fig7.linear": Ours(
                float(bent.max()),
                note=f"{NAMES[int(np.argmax(bent))]}, which changes by "
                f"{change[np.argmax(bent)]:.1%} in all, bends most. Of the parameters that change "
                f"by more than 1 % ({_those(plain)}) it is {large}.",
            ),
        },
        figures,
    )


def shifted(log: Recording, by: float) -> Recording:
    """With wheel speeds stamped so much later [s]."""
    wheels = log["wheel_speed"]
    late = replace(wheels, time=wheels.time + by)
    whole = replace(log, streams={**log.streams, "wheel_speed": late})
    return whole.between(EDGE, DURATION - EDGE)


def turned(log: Recording, by: float) -> Recording:
    """With the speeds of the wheels along x and y turned about z [rad]."""
    wheels = log["wheel_speed"]
    x, y, z = wheels.value.T
    cosine, sine = np.cos(by), np.sin(by)
    value = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
    turned = Series(wheels.time, value, wheels.columns, wheels.unit)
    return replace(log, streams={**log.streams, "wheel_speed": turned})


def turn_nearest_sync(estimate: Array) -> float | None:
    """The shift [s] of the local extremum nearest to none, of estimates at `SHIFTS`."""
    slope = np.sign(np.diff(estimate))
    turns = SHIFTS[1:-1][slope[1:] * slope[:-1] < 0.0]
    return float(turns[np.argmin(np.abs(turns))]) if len(turns) else None


def bend(x: Array, y: Array) -> float:
    """Largest departure from the best line, in parts of the change."""
    line = np.polyval(np.polyfit(x, y, 1), x)
    return float(np.abs(y - line).max() / np.ptp(y))


def _estimates(
    log: Recording, values: Array, changed: Callable[[Recording, float], Recording]
) -> Array:
    """(m, 9) by the momentum integral of single shift."""
    method, settings = METHODS["momentum_1"]
    platform = machine()
    logs = (changed(log, float(value)) for value in values)
    return np.array([identify([item], platform, method, settings).theta[:9] for item in logs])


def _those(plain: NDArray[np.bool_]) -> str:
    return ", ".join(name for name, item in zip(NAMES, plain, strict=True) if item)


def _figure(x: Array, estimates: Array, label: str) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 7.0))
        truth = entries_of(machine())
        for panel, name, column, true in zip(
            figure.subplots(3, 3, sharex=True).ravel(), NAMES, estimates.T, truth, strict=True
        ):
            panel.axhline(true, color=SOFT, lw=0.8)
            panel.plot(x, column, color=PALETTE[0])
            panel.set_ylabel(f"{name} [{'kg m²' if name.startswith('J') else 'kg m'}]")
        figure.supxlabel(label, fontsize=10)
        return svg(figure)


PART = PaperPart(("002.fig5.extremum", "002.fig7.linear"), compute)
