"""Fig. 3: adaptive balancing with and without excitation, as simulated in the paper: no noise."""

import numpy as np
from numpy.typing import NDArray

from twin.controller import load_controller
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.reproduce.flown import Flown, flown, perfect
from twin.reproduce.paper_000.bench import RollPitch
from twin.reproduce.paper_000.drawn import side_by_side
from twin.reproduce.part import Computed, Ours, PaperPart, Say
from twin.rotation import cross, from_rotation_vector, vertical_body

Array = NDArray[np.float64]

TILTED = InitialState(attitude=from_rotation_vector(np.array([0.1, 0.0, 0.0])))
"""Where the run without excitation starts: at level its masses would have nothing to do."""
STILL, MOVING = 150.0, 700.0
"""Without excitation, and with it [s]."""


def compute(say: Say) -> Computed:
    """Two runs."""
    machine = perfect(load_platform("tas2"))
    law, kind = load_controller("adaptive_balancing"), "passthrough"
    say("without excitation")
    still = flown(machine, law, STILL, start=TILTED, estimator=kind)
    say("with excitation")
    moving = flown(machine, law, MOVING, reference=RollPitch(), estimator=kind)
    error, moment = np.linalg.norm(momentum_error(still), axis=1), offset(still)
    up = vertical_body(still.true["attitude"][:, 0])
    length = np.linalg.norm(moment, axis=1)
    angle = float(np.linalg.norm(cross(moment[-1], up[-1])) / length[-1])
    kept = float(length[-1] / length[0])
    with_it = np.linalg.norm(offset(moving), axis=1)
    last = moving.time > moving.time[-1] - 2.0 * np.pi / RollPitch().pace
    left = float(with_it[last].mean() / with_it[0])
    wrong = np.linalg.norm(momentum_error(moving, RollPitch())[last], axis=1).mean()
    whole = np.linalg.norm(RollPitch().at(MOVING).rate_body @ machine.inertia)
    rows = {
        "000.fig3.momentum_without_excitation": Ours(
            float(error[-1] / error.max()), note=f"After {STILL:g} s, from 0.1 rad of tilt."
        ),
        "000.fig3.offset_without_excitation": Ours(
            angle if kept > 0.1 else float("nan"),
            note=f"The CM keeps {100.0 * kept:.3g} % of its distance from the CR.",
        ),
        "000.fig3.offset_with_excitation": Ours(
            left,
            note=f"Mean of the last turn of {MOVING:g} s of rolling and pitching by 10 deg at "
            f"{RollPitch().pace:g} rad/s; reference and gains are ours. What is left goes with a "
            f"momentum error of {wrong:.2g} in {whole:.2g} N m s: drives and a loop of 20 Hz are "
            "late, and the law takes that for gravity.",
        ),
    }
    figures = {
        "Fig. 3, top: momentum error and m r without excitation": _drawn(still),
        "Fig. 3, bottom: the same with excitation": _drawn(moving, RollPitch()),
    }
    return Computed(rows, figures)


def momentum_error(run: Flown, reference: RollPitch | None = None) -> Array:
    """J (w - w_d) of the first run, (m, 3) [N m s]."""
    rate = run.true["rate"][:, 0]
    wanted = np.zeros_like(rate) if reference is None else reference.at(run.time).rate_body
    return (rate - wanted) @ run.platform.inertia


def offset(run: Flown) -> Array:
    """m r of the first run, (m, 3) [kg m]."""
    return run.true["center_of_mass_offset"][:, 0]


def _drawn(run: Flown, reference: RollPitch | None = None) -> str:
    panels = {
        "momentum error [N m s]": momentum_error(run, reference),
        "m r [g m]": 1e3 * offset(run),
    }
    return side_by_side(run.time, panels)


PART = PaperPart(
    (
        "000.fig3.momentum_without_excitation",
        "000.fig3.offset_without_excitation",
        "000.fig3.offset_with_excitation",
    ),
    compute,
)
