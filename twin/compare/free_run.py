"""Free runs: from the state that a filter has at an instant, under the commands, nothing fitted.

Every model starts from the same states: those that the best account gives the instant from what
came before it. What a perfect model would miss from there is found by drawing the start from what
is uncertain of it.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.compare.account import Account
from twin.predict.body import Body
from twin.predict.path.states import States
from twin.predict.whitening.innovations import Innovations

Array = NDArray[np.float64]

HORIZONS = (1.0, 10.0, 60.0)
"""[s]."""
MOST = 20
"""Runs of one horizon."""
DRAWS = 2
"""Of the start of each run, for the perfect model."""
SEED = 1


@dataclass(frozen=True)
class FreeRun:
    """Runs of one length."""

    horizon: float
    """[s]."""
    time: Array
    """(r, m) [s]."""
    as_built: Array
    """(r, m, 1) or (r, m, 4) position."""
    best: Array
    """Likewise, of the best model."""
    errors: tuple[float, float, float]
    """Typical (median) error at the end [rad]: as built, of the best model, of a perfect one."""


def free_run(horizon: float, as_built: Account, best: Account) -> FreeRun | None:
    """Run both models; None where the log is too short."""
    body = best.problem.bodies[0]
    grid = body.grid
    count = round(horizon / grid.step)
    last = float(body.motion.time[-1])
    fits = [s for s in range(1, grid.segments) if grid.starts[s] + horizon <= last + 1e-9]
    if not fits or count < 1:
        return None
    chosen = np.array(fits)[np.unique(np.linspace(0, len(fits) - 1, MOST).astype(np.intp))]
    mean, spread = _filtered(best, chosen)
    rng = np.random.default_rng(SEED)
    drawn = [_drawn(mean, spread, rng) for _ in range(DRAWS)]
    built = _positions(body, as_built, chosen, count, [mean])[0]
    better, *perfect = _positions(body, best, chosen, count, [mean, *drawn])
    time = grid.starts[chosen][:, None] + grid.step * np.arange(count + 1)
    truth = _known(best, time[:, -1])
    errors = [
        _typical(built[:, -1], truth),
        _typical(better[:, -1], truth),
        _typical(np.concatenate(perfect)[:, -1], np.tile(better[:, -1], (DRAWS, 1))),
    ]
    return FreeRun(horizon, time, built, better, (errors[0], errors[1], errors[2]))


def _known(account: Account, time: Array) -> Array:
    """(r, .) position: on the fitted path where the motion follows it, else as smoothed."""
    body = account.problem.bodies[0]
    if not account.follows or _torque_wanders(account):
        return body.motion.at(time).position
    segment, into = body.grid.place(time)
    return account.now.exact[0].path.position[0, segment, np.round(into).astype(np.intp)]


def _torque_wanders(account: Account) -> bool:
    return isinstance(account.now, Innovations) and account.now.noise.torque is not None


def _filtered(account: Account, chosen: NDArray[np.intp]) -> tuple[States, Array]:
    """States (r, .) at the starts of segments, from those before, with the covariance (r, x, x) of
    how far they are from `_known`."""
    exact = account.now.exact[0]
    linear = exact.linear
    before = chosen - 1
    if isinstance(account.now, Innovations):
        link = account.now.chains[0]
        mean = np.stack([link.seen[s][:, 0] for s in before])
        # the fitted path is known with hindsight, and shares with the start what came before it
        known = link.hindsight() if account.follows else np.stack(link.seen_spread)
        spread = known[before]
        if account.now.noise.any:
            x, moved = linear.transition.shape[-1], account.now.linear[0]
            carry = moved.transition[before]
            mean = moved.jump[before] + np.einsum("rxy,ry->rx", carry, mean)
            spread = carry @ spread @ carry.transpose(0, 2, 1) + moved.spread[before]
            return account.at.starts[0][chosen].moved(mean[:, :x]), spread[:, :x, :x]
    else:
        link = account.now.links[0]
        mean = link.states(np.zeros(linear.shared.shape[-1]))[before]
        _, _, weights = account.now.best(np.arange(0))
        inverse = np.linalg.pinv(link.of_state[before])
        spread = inverse @ inverse.transpose(0, 2, 1) / weights[before, None, None]
    carry = linear.transition[before]
    path = exact.path
    end = path[0, before, -1]
    return end.moved(np.einsum("rxy,ry->rx", carry, mean)), carry @ spread @ carry.transpose(
        0, 2, 1
    )


def _drawn(mean: States, spread: Array, rng: np.random.Generator) -> States:
    values, vectors = np.linalg.eigh(spread)
    noise = rng.normal(size=values.shape) * np.sqrt(np.maximum(values, 0.0))
    return mean.moved(np.einsum("rxy,ry->rx", vectors, noise))


def _positions(
    body: Body, account: Account, chosen: NDArray[np.intp], count: int, starts: list[States]
) -> list[Array]:
    """Of each set of starts, (r, count + 1, .)."""
    problem = account.problem
    model: mujoco.MjModel = problem.base.model(account.theta)
    push = problem.push(0, account.at)
    rows = np.tile(chosen, len(starts))
    path = body.rollouts.onward(model, rows, States.joined(starts), count, push)
    return np.split(path, len(starts))


def _typical(position: Array, truth: Array) -> float:
    """Median angle between two sets of positions [rad]."""
    if position.shape[-1] == 1:
        return float(np.median(np.abs(position - truth)))
    turn = rotation.multiply(rotation.conjugate(truth), position)
    return float(np.median(np.linalg.norm(rotation.to_rotation_vector(turn), axis=-1)))
