"""Fig. 5: what the simplified equations (17) miss of the whole ones (13)."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.model import Sliding, compile_model
from twin.plant.prescribed import plan
from twin.platform import Platform
from twin.reproduce.paper_001.figures import Panel, drawn, named
from twin.reproduce.paper_001.flights import STABLE, FlownRuns, astros
from twin.reproduce.paper_001.in_plane import fly
from twin.reproduce.part import Computed, Ours, Say
from twin.rotation import cross

Array = NDArray[np.float64]

AWAY = 0.3
"""Of the stages from the CR, where they are not at it [m]."""


def missed(
    inertia: Array, riding: Sliding, rate: Array, position: Array, speed: Array, pull: Array
) -> Array:
    """Angular acceleration that eq. 17 leaves out of eq. 13, (m, 3) [rad/s^2].

    alpha = -J^-1 (dJ/dt w + sum m p x a + w x sum m p x v),
    dJ/dt = sum m (2 (p . v) 1 - p v^T - v p^T)

    Args:
        inertia: J, (3, 3) [kg m^2].
        riding: the bodies on the stages: p = home + travel d.
        rate: w, (m, 3) [rad/s].
        position, speed, pull: of the stages, (m, s) [m, m/s, m/s^2].
    """
    place = riding.home + np.einsum("ms,bsi->mbi", position, riding.travel)
    swift, push = (np.einsum("ms,bsi->mbi", x, riding.travel) for x in (speed, pull))
    turned = rate[:, None]
    along = np.sum(place * swift, axis=-1, keepdims=True)
    spreading = 2.0 * along * turned
    spreading -= place * np.sum(swift * turned, axis=-1, keepdims=True)
    spreading -= swift * np.sum(place * turned, axis=-1, keepdims=True)
    torque = spreading + cross(place, push)
    torque += cross(np.broadcast_to(turned, place.shape), cross(place, swift))
    return -np.linalg.solve(inertia, np.einsum("b,mbi->im", riding.mass, torque)).T


def profile(platform: Platform, run: FlownRuns) -> tuple[Array, Array, Array, Array]:
    """Times (m,) and the stages' position, speed and acceleration (m, s) at each physics step.

    As their drives plan them from the positions that were commanded.
    """
    limits = np.array([(stage.speed, stage.acceleration) for stage in platform.stages])
    position = run.true["stage_position"][0].copy()
    speed = np.zeros_like(position)
    rows: list[tuple[Array, Array, Array]] = []
    for target in run.applied["command_stage_position"][:-1]:
        for _ in range(platform.steps_per_tick):
            pull, position, speed = plan(
                position,
                speed,
                target,
                steps=1,
                step=platform.step,
                max_speed=limits[:, 0],
                max_acceleration=limits[:, 1],
            )
            rows.append((position[0], speed[0], pull[0, 0]))
    places, speeds, pulls = (np.array(column) for column in zip(*rows, strict=True))
    time = np.arange(1.0, len(rows) + 1.0) * platform.step
    return time, places, speeds, pulls


def smooth(run: FlownRuns) -> tuple[Array, Array, Array]:
    """Position, speed and acceleration (m, s) of masses that move evenly between two ticks."""
    place = run.true["stage_position"][:, 0]
    speed = np.gradient(place, run.time, axis=0)
    return place, speed, np.gradient(speed, run.time, axis=0)


def at_center(platform: Platform) -> Sliding:
    """Eq. 14: mass j at d_j u_j from the CR, none riding on another."""
    axes = np.array([stage.axis for stage in platform.stages])
    masses = np.array([stage.mass for stage in platform.stages])
    return Sliding(masses, np.zeros_like(axes), np.einsum("bs,bi->bsi", np.eye(len(axes)), axes))


def compared(say: Say) -> Computed:
    """Along the run of Fig. 7: stages at the CR as in eq. 14, and 0.3 m away from it."""
    say("200 s with the masses' law, and what eq. 17 misses of it")
    run = fly(STABLE)
    platform = astros()
    time, *motion = profile(platform, run)
    rate = np.stack([np.interp(time, run.time, w) for w in run.true["rate"][:, 0].T], axis=-1)
    near = missed(platform.inertia, at_center(platform), run.true["rate"][:, 0], *smooth(run))
    driven = missed(platform.inertia, at_center(platform), rate, *motion)
    riding = compile_model(platform).sliding
    distance = np.linalg.norm(riding.home, axis=1)
    away = replace(riding, home=riding.home * (AWAY / distance)[:, None])
    far = missed(platform.inertia, away, rate, *motion)
    rows = {
        "001.eq17.simplified": Ours(
            float(np.abs(near).max()),
            note="Largest component over 200 s, with the masses' mean speed in each tick, as they "
            "have no drive in the paper's simulation; the trapezoids of real drives, which start "
            f"and stop in each tick, make it {np.abs(driven).max():.2g}. Masses that move along "
            "lines through the CR leave dJ/dt w alone.",
        ),
        "001.eq17.simplified_real_mounting": Ours(
            float(np.abs(far).max()),
            note=f"Stages {AWAY:g} m from the CR, in the direction in which the shipped machine "
            f"has them ({distance.mean():.2f} m away, ASSUMED); their drives' "
            f"{np.abs(motion[2]).max():.3g} m/s^2 turn the body by m p x a.",
        ),
    }
    over_time = [
        np.stack([np.interp(run.time, time, column) for column in far.T], axis=-1),
        near,
    ]
    panels = [
        Panel(label, named(("x", "y", "z"), values))
        for label, values in zip(
            (f"{AWAY:g} m away [rad/s^2]", "at the CR [rad/s^2]"), over_time, strict=True
        )
    ]
    return Computed(rows, {"Fig. 5: what eq. 17 misses of eq. 13": drawn(run.time, panels)})
