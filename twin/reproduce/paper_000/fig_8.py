"""Fig. 8 and 9: adaptive balancing against direct compensation, with the faults the paper names.

Both on the machine that was balanced by hand, with gimbal friction, backlash, the gyros' own CM
offset (each at its usual size) and sensors as shipped. Direct: identify once by the paper's batch
method from the tracking run, move the masses by eq. 12. Adaptive: eq. 35 and 37.
"""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.controller import load_controller
from twin.effects import effects_of, parse_effects, with_effects
from twin.effects.actuators import GimbalFriction
from twin.identification import identify
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.report.style import FIGURE, PALETTE, svg
from twin.reproduce.flown import Flown, flown
from twin.reproduce.paper_000.bench import RollPitch, tracked
from twin.reproduce.paper_000.drawn import side_by_side
from twin.reproduce.part import Computed, Ours, PaperPart, Say
from twin.rotation import tilt

Array = NDArray[np.float64]

FAULTS = ("gimbal_friction", "gimbal_backlash", "gimbal_center_of_mass_offset")
METHOD = "integrated"
RUNS = range(4)
LENGTH = 600.0
"""Of the adaptive run [s]."""
SETTLED = 2.0 * np.pi / RollPitch().pace
"""One period of the excitation, over which the end is averaged [s]."""


def compute(say: Say) -> Computed:
    """Four runs of each."""
    shipped = load_platform("tas2")
    machine = with_effects(shipped, parse_effects(",".join(FAULTS)))
    say("direct compensation")
    logs = tracked(machine, runs=RUNS)
    true = logs.true["center_of_mass_offset"].mean(axis=0)  # its masses stand at 0
    pairs = zip(logs.recordings, true, strict=True)
    left = np.array([_directly(shipped, log, moment) for log, moment in pairs])
    say("adaptive balancing")
    run = _adapting(machine, RUNS)
    end, adapted = _end(run)
    alone, sound = list[str](), 0.0
    for name in ("", *FAULTS):
        say(f"adaptive balancing with {name or 'no fault'} alone")
        item = parse_effects(name) if name else ()
        last, moment = _end(_adapting(with_effects(shipped, item), (0,)))
        torque = 1e3 * machine.gravity * moment.mean()
        alone.append(f"{torque:.3g} with {name.replace('_', ' ') or 'none of them'}")
        if not name:
            sound = 1e3 * float(last.true["stage_position"][..., 2].mean())
    first = np.linalg.norm(machine.center_of_mass_offset)
    torques = machine.gravity * np.array([adapted.mean(), left.mean(), first])
    stood = end.true["stage_position"].mean(axis=0)
    sides = np.abs(stood[:, :2]).max(axis=1)
    friction = next(e for e in effects_of(machine) if isinstance(e, GimbalFriction))
    short = friction.torque / friction.stiffness * shipped.rotors[0].momentum
    rows = {
        "000.fig8.adaptive_beats_direct": Ours(
            float(torques[0] / torques[1]),
            note=f"{1e3 * torques[0]:.3g} over {1e3 * torques[1]:.3g} mN m, from "
            f"{1e3 * torques[2]:.3g}: means of {len(RUNS)} runs, g abs(m r). The adaptive law "
            f"alone ends at {', '.join(alone)} [mN m]: what keeps the momentum from being followed "
            f"is taken for gravity. Friction of {friction.torque:g} N m makes a drive of "
            f"{friction.stiffness:g} N m s/rad without an integral fall short by {1e3 * short:.2g} "
            "mN m of the gyro's torque; a drive that holds its rate would not.",
        ),
        "000.fig9.vertical_mass_moves_most": Ours(
            float((np.abs(stood[:, 2]) / sides).mean()),
            note=f"{1e3 * stood[:, 2].mean():+.3g} mm, upwards positive, over "
            f"{1e3 * sides.mean():.3g} mm; {sound:+.3g} mm where no fault misleads the law.",
        ),
    }
    figures = {
        "Fig. 8: tilt during adaptive balancing": _tilt(run),
        "Fig. 9: momentum error and positions of the masses": _adapted(run),
    }
    return Computed(rows, figures)


def _adapting(machine: Platform, runs: Sequence[int]) -> Flown:
    law = load_controller("adaptive_balancing")
    return flown(machine, law, LENGTH, reference=RollPitch(), runs=runs)


def _end(run: Flown) -> tuple[Flown, Array]:
    """The last turn of the excitation, and abs(m r) of its mean, (n,) [kg m]."""
    end = run.between(run.time[-1] - SETTLED, np.inf)
    return end, np.linalg.norm(end.true["center_of_mass_offset"].mean(axis=0), axis=1)


def _directly(stated: Platform, log: Recording, true: Array) -> float:
    """abs(m r) that is left of the true one (3,) when the masses undo what the batch method says
    [kg m]."""
    identification = identify([log], stated, METHOD)
    slides = np.array([stage.mass * stage.axis for stage in stated.stages])
    moved = -np.linalg.solve(slides.T, identification.theta[6:9])
    travel = np.array([stage.travel for stage in stated.stages])
    moved = np.clip(moved, travel[:, 0], travel[:, 1])
    return float(np.linalg.norm(true + moved @ slides))


def _tilt(run: Flown) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.0))
        panel = figure.subplots()
        panel.plot(run.time, np.degrees(tilt(run.true["attitude"][:, 0])), color=PALETTE[0])
        panel.set_xlabel("time [s]")
        panel.set_ylabel("tilt [deg]")
        return svg(figure)


def _adapted(run: Flown) -> str:
    error = run.true["rate"][:, 0] - RollPitch().at(run.time).rate_body
    panels = {
        "momentum error [N m s]": error @ run.platform.inertia,
        "mass position [mm]": 1e3 * run.true["stage_position"][:, 0],
    }
    return side_by_side(run.time, panels)


PART = PaperPart(("000.fig8.adaptive_beats_direct", "000.fig9.vertical_mass_moves_most"), compute)
