"""A balancing put together from names, refused before it starts where it cannot work."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.budget import momentum_budget
from twin.controller import AnyController, load_controller
from twin.errors import TwinError, UnknownName, UsageError
from twin.library import Registry
from twin.platform import Platform
from twin.procedures.balancing import Balancing
from twin.procedures.fits import Fits, filter_moment, fit_moment
from twin.procedures.logbook import Lab, Logbook
from twin.procedures.means import Reach, mean_inertia
from twin.procedures.plan import AIM, Aim, Notes, Remark
from twin.reference import Hold, Reference, parse_reference

Array = NDArray[np.float64]


class Refused(TwinError):
    """A balancing that cannot come out; says why, with the number."""


@dataclass(frozen=True)
class Way:
    """A procedure of balancing: which law, if any, levels the body before the masses are moved by
    what was identified."""

    words: str
    """What it does, in a line."""
    law: str | None = None
    """Name of the control law of the level phase; None: there is no such phase."""
    inertia: float | None = None
    """Mean principal moment of inertia for which the law's gains are stated [kg m^2]; they are
    scaled by the machine's over it. None: the law scales them itself."""
    lasts: float = 240.0
    """Duration of the level phase [s]."""
    once: bool = False
    """Whether the level phase comes once, at the start, and not in every round."""
    by_filter: bool = False
    """Whether m r is found by the Kalman filter of 001, J as stated, in place of a fit of both."""


ASTROS, CUBESAT = 16.49, 0.02567
"""Mean principal moments of the machines whose papers print the gains [kg m^2]."""

WAYS: Mapping[str, Way] = Registry(
    "twin.procedures",
    {
        "direct": Way("identify and move the masses, again and again (000 eq. 12-15, 004)"),
        "masses": Way("in the plane by a PID of the masses (001)", "mass_pid", ASTROS),
        "masses-and-filter": Way(
            "in the plane by a PID of the masses, the height by a Kalman filter (001)",
            "mass_pid",
            ASTROS,
            by_filter=True,
        ),
        "masses-and-coils": Way(
            "in the plane by masses, damped by coils (003)", "mass_magnetic_pid", CUBESAT
        ),
        "adaptive": Way(
            "adapted while momentum is tracked, then direct (000 eq. 35-37)",
            "adaptive_balancing",
            lasts=900.0,
            once=True,
        ),
    },
    lambda brought: brought if isinstance(brought, Way) else None,
)
"""Procedures by name: ours, and entry points of the group `twin.procedures`, each a `Way`."""

STATED = {"cubesat": 4.3e-5, "sads": 0.01}
"""Residual torque that the papers of a machine reach [N m]: 003, section 3; 004, conclusion."""
ASSUMED = 5e-6
"""[m]: CM offset whose torque is the target of any other machine. ASSUMED: the goal of a good table
is some micrometres."""
REACH = 0.8
"""Part of each travel that random offsets need at most."""


def usual_target(platform: Platform) -> float:
    """Default target: residual torque [N m]."""
    name = platform.name.partition(":")[0]
    return STATED.get(name, ASSUMED * platform.mass * platform.gravity)


def balancing(
    platform: Platform,
    n: int,
    *,
    way: str,
    target: float,
    tell: Callable[[Remark], None] | None = None,
    workers: int = 1,
    wait: bool = True,
) -> Balancing:
    """The procedure of that name for n runs of a machine; its `lab.fits` is to be closed.

    Args:
        platform: the machine.
        n: runs.
        way: of `WAYS`.
        target: residual torque [N m].
        tell: takes each remark on a run.
        workers: processes that fit.
        wait: for fits, as a simulation must.

    Raises:
        UnknownName: no such procedure.
        UsageError: a target that is no torque, or a machine on which nothing shows the vertical.
        ControllerError: the machine lacks a part.
    """
    if way not in WAYS:
        raise UnknownName("procedure", way, WAYS)
    if not (np.isfinite(target) and target > 0.0):
        raise UsageError(f"target is {target:g} N m; give a torque above zero")
    _need_vertical(platform)
    chosen = WAYS[way]
    by_filter = chosen.by_filter or "attitude" not in platform.sensors
    notes = Notes(n, tell)
    procedure = Balancing(
        Aim(target, platform.gravity),
        Lab(
            Logbook(platform),
            Fits(
                platform,
                fit=filter_moment if by_filter else fit_moment,
                workers=workers,
                wait=wait,
            ),
            notes,
        ),
        None if chosen.law is None else _law(chosen.law, chosen.inertia, platform),
        _reference(way),
        chosen.lasts,
        chosen.once,
    )
    procedure.init(platform, n)
    return procedure


def _need_vertical(platform: Platform) -> None:
    shown = ", ".join(platform.sensors) or "nothing"
    if not {"attitude", "inclinometer", "accelerometer"} & platform.sensors.keys():
        raise UsageError(
            f"{platform.name} measures {shown}, and none of it shows how the body leans: carry an "
            "inclinometer, an accelerometer or motion capture as [sensors.inclinometer], "
            "[sensors.accelerometer] or [sensors.attitude]"
        )
    if "gyro" not in platform.sensors:
        raise UsageError(
            f"{platform.name} measures {shown}: without a gyro nothing damps its turn about the "
            "vertical, and what is left cannot be observed; carry one as [sensors.gyro], or level "
            "it by `twin run --controller mass_pid`"
        )


def refuse(platform: Platform, way: str, target: float, base: Array) -> None:
    """What cannot work with an m r of `base` (3,) at stage position 0 [kg m].

    Raises:
        Refused: the masses do not reach, or wheels will saturate.
    """
    reach = Reach.of(platform)
    goal = np.array([0.0, 0.0, -AIM * target / platform.gravity])
    needed = reach.masses.positions((goal - base)[None])[0]
    beyond = reach.beyond(needed)
    if beyond:
        um = base / platform.mass * 1e6
        raise Refused(
            f"the CM of {platform.name} is ({um[0]:.4g}, {um[1]:.4g}, {um[2]:.4g}) um from the CR "
            f"with all masses at 0: beyond their reach, {beyond}; shift weights by hand, or say "
            "with --stages where the masses stood when the offset was found"
        )
    if WAYS[way].law != "adaptive_balancing" or len(platform.gimbals) >= 3:
        return
    lowered = base[2] - reach.depth
    hung = replace(platform, center_of_mass_offset=np.array([0.0, 0.0, 0.5 * lowered]))
    budget = momentum_budget(hung, _reference(way), WAYS[way].lasts)
    if budget.saturates_at is not None and budget.first is not None:
        limit = next(w.momentum_limit for w in platform.wheels if w.name == budget.first)
        raise Refused(
            f"{budget.first} will saturate: tracking with the masses as low as they are at first "
            f"takes it to its {limit:g} N m s at {budget.saturates_at:.0f} s; use `direct`"
        )


def random_offsets(platform: Platform, seed: int, runs: int) -> Array:
    """(runs, 3) m r at stage position 0 [kg m] that the masses can undo, each from its own seed.

    The masses balance it at positions in the inner part of their travel, about its middle.
    """
    reach = Reach.of(platform)
    stages = len(platform.stages)
    draws = np.array(
        [np.random.default_rng([seed, run]).uniform(-REACH, REACH, stages) for run in range(runs)]
    )
    return reach.undone_by(draws)


def _law(name: str, inertia: float | None, platform: Platform) -> AnyController:
    """With the gains that it has for a mean moment of inertia, in the measure of this machine's."""
    law = load_controller(name)
    if inertia is None:
        return law
    share = mean_inertia(platform) / inertia
    return load_controller(name, {gain: share * value for gain, value in vars(law).items()})


def _reference(way: str) -> Reference:
    law = WAYS[way].law
    if law is None or not WAYS[way].once:
        return Hold()
    return parse_reference(load_controller(law).reference)
