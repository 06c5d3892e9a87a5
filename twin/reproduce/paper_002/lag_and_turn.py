"""Fig. 5, 7 and 10: what our diagnosis makes of a lag and of a turn that the wheels' data hide.

The machine of Table 1 with the sensors of `whorl1`: gyros at 41 Hz, wheel speeds at 1.1 Hz.
"""

import numpy as np

from twin.diagnosis import Diagnosis, diagnose
from twin.effects import Effect, with_effects
from twin.effects.sensors import ClockLag
from twin.effects.wheels import WheelMisalignment
from twin.plant.initial import hanging
from twin.platform import load_platform
from twin.reproduce.paper_002.manoeuvre import flown, wheels
from twin.reproduce.part import Computed, Ours, PaperPart, Say

LAG = 0.17
"""[s]: paper, 7 points of 41 Hz."""
TURN = np.radians(3.6)
"""[rad] about z, of the wheels along x and y: paper, from CAD."""
SEED = 9


def compute(say: Say) -> Computed:
    """Two logs, each diagnosed without being told what is in it."""
    turn = (0.0, 0.0, TURN)
    late = diagnosed([ClockLag(LAG, target="wheel_speed")], say)
    askew = diagnosed([WheelMisalignment(turn, target=name) for name in ("w1", "w2")], say)
    return Computed({"002.fig5.lag_found": _lag(late), "002.fig7.seen": _turn(askew)})


def diagnosed(effects: list[Effect], say: Say) -> Diagnosis:
    """Of a log of the machine with effects, held against the machine without."""
    stated = load_platform("whorl1:table1")
    (log,) = flown(
        with_effects(stated, effects),
        wheels(),
        start=hanging(stated.center_of_mass_offset),
        seed=SEED,
    )
    return diagnose([log.without_truth()], stated, say=say)


def _lag(diagnosis: Diagnosis) -> Ours:
    named = _named(diagnosis)
    for cause in diagnosis.causes:
        if cause.effect.label == "clock_lag:wheel_speed":
            value, half = float(cause.effect.values[0]), float(cause.half_widths[0])
            return Ours(value, value - half, value + half, f"Found: {named}.")
    return Ours(np.nan, note=f"Found instead: {named}.")


def _turn(diagnosis: Diagnosis) -> Ours:
    named = _named(diagnosis)
    turns = [
        (cause.effect.target, np.degrees(cause.effect.values[2]), np.degrees(cause.half_widths[2]))
        for cause in diagnosis.causes
        if cause.effect.name == "wheel_misalignment"
    ]
    told = [half for *_, half in turns if np.isfinite(half)]
    if not told:
        return Ours(np.inf, note=f"Found instead: {named}.")
    shown = ", ".join(f"{name} {value:.2f} ({half:.2f}) deg" for name, value, half in turns)
    return Ours(
        float(max(told)),
        note=f"Found: {shown} about z, half intervals in brackets; nan: a turn about the wheel's "
        "own axis makes up for it, and that one was fitted.",
    )


def _named(diagnosis: Diagnosis) -> str:
    return (
        ", ".join(cause.effect.label for cause in diagnosis.causes)
        or f"nothing ({diagnosis.verdict})"
    )


PART = PaperPart(("002.fig5.lag_found", "002.fig7.seen"), compute)
