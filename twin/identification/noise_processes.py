"""Noise processes by restricted maximum likelihood: what wanders beside the sensors' white noise.

A torque about the base's axes and a slow error of each sensor of the motion, each an
Ornstein-Uhlenbeck process with two numbers, its rms and its correlation time. They are taken in one
after the other, the one that the logs ask for most first, while the likelihood pays for them.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from twin.errors import TwinError
from twin.identification.prediction_error import WORTHWHILE, restricted
from twin.predict.body import Exact
from twin.predict.innovations import Innovations, Problem
from twin.predict.kalman import TORQUE, NoiseProcess, Wander, blocked, scaled
from twin.stop import check

Array = NDArray[np.float64]

TORQUES = (1e-6, 1e-5, 1e-4, 1e-3)
"""Rms from which a torque's is sought, in parts of g abs(m r), or of J a second squared where that
is larger."""
ERRORS = (0.3, 3.0)
"""Likewise a sensor error's, in parts of a sample's noise."""
TORQUE_TIME, ERROR_TIME = 3.0, 20.0
"""Correlation times from which a torque's and an error's are sought [s]."""
SHORTEST = 0.2
"""Correlation time below which a process is as good as white [s]."""
OFTEN = 5.0
"""Correlation times that a log must last: of one that is longer it shows little more than a
constant."""
WITHIN = 0.1
"""Tolerance of the logarithms of rms and correlation time."""
ROUNDS = 4
"""Of processes and white noise in turns."""
SURE, SAME = 4.0, 0.02
"""Standard deviations, and share, by which a white noise must be off to be scaled."""
EVALUATIONS = 25
"""At most, for each process that is sought."""

Cost = Callable[[NoiseProcess], float]


def likely_noise(
    problem: Problem, innovations: Innovations, first: NoiseProcess | None = None
) -> NoiseProcess:
    """The noise processes at which logs are likeliest, those that pay only.

    Args:
        problem: the logs.
        innovations: their prediction, linearised.
        first: where to look from, if that is known; else nothing.
    """
    noise = first or NoiseProcess()
    for _ in range(ROUNDS):
        noise = _processes(problem, innovations, noise)
        scales = _scales(problem, innovations, noise)
        if scales == noise.scales:
            break
        noise = replace(noise, scales=scales)
    return noise


def _processes(problem: Problem, innovations: Innovations, noise: NoiseProcess) -> NoiseProcess:
    """The processes that pay, the white noise being what it is."""
    coarse: list[Exact] = []
    for item in innovations.exact:
        linear, local, _ = scaled(item.linear, item.local, noise.scales)
        linear, local = blocked(linear, local)
        coarse.append(replace(item, linear=linear, local=local))

    def cost(noise: NoiseProcess) -> float:
        check()
        try:
            return restricted(problem.whiten(innovations.at, coarse, replace(noise, scales=())))
        except TwinError:  # so large that no number holds it
            return np.inf

    longest = max(b.motion.time[-1] - b.motion.time[0] for b in problem.bodies) / OFTEN
    best = cost(noise)
    if noise.wanders:
        noise, best = _sharpened(noise, best, cost, longest)
        noise, best = _pruned(noise, best, cost)
    streams = [s for s in innovations.exact[0].local.errors if s not in dict(noise.errors)]
    candidates = [TORQUE] * (noise.torque is None) + streams
    while candidates:
        tries = {name: _begun(problem, noise, name, cost, longest) for name in candidates}
        name = min(tries, key=lambda entry: tries[entry][1])
        tried, reached = tries[name]
        if reached > best - WORTHWHILE:
            break
        candidates.remove(name)
        noise, best = _sharpened(tried, reached, cost, longest)
    return noise


def _scales(
    problem: Problem, innovations: Innovations, noise: NoiseProcess
) -> tuple[tuple[str, float], ...]:
    """By how much the white noise of each stream must be larger for its innovations to have the
    variance 1; as it was where they nearly have, and 1 where noise alone could leave as much."""
    whitened = problem.whiten(innovations.at, innovations.exact, noise)
    known = dict(noise.scales)
    squares: dict[str, list[float]] = {}
    # what was fitted under other noise moves with it
    for item, rows in zip(whitened.exact, whitened.residuals_of_logs(whitened.step()), strict=True):
        for stream, error in item.local.errors.items():
            shown = rows[np.any(error != 0.0, axis=-1)]
            squares.setdefault(stream, []).extend([float(shown @ shown), float(shown.size)])
    result: list[tuple[str, float]] = []
    for stream, parts in squares.items():
        square, count = sum(parts[::2]), sum(parts[1::2])
        before = known.get(stream, 1.0)
        factor = before * float(np.sqrt(square / max(count, 1.0)))
        sigma = 1.0 / np.sqrt(2.0 * max(count, 1.0))
        if abs(np.log(factor / before)) < max(SURE * sigma, SAME):
            factor = before
        if factor > 1.0 + max(SURE * sigma, SAME):
            result.append((stream, factor))
    return tuple(result)


def _begun(
    problem: Problem, noise: NoiseProcess, name: str, cost: Cost, longest: float
) -> tuple[NoiseProcess, float]:
    """With one process more, roughly sized."""
    result: list[tuple[float, NoiseProcess]] = []
    time = TORQUE_TIME if name == TORQUE else ERROR_TIME
    for rms in _sizes(problem, name):
        tried = _with(noise, name, Wander(rms, min(time, longest)))
        result.append((cost(tried), tried))
        if len(result) > 1 and result[-1][0] > result[-2][0]:
            break
    reached, tried = min(result, key=lambda item: item[0])
    return tried, reached


def _sizes(problem: Problem, name: str) -> list[float]:
    """Rms from which a process is sought, in its unit (SI)."""
    if name == TORQUE:
        platform = problem.base.machine.platform
        restoring = platform.gravity * float(np.linalg.norm(platform.center_of_mass_offset))
        unit = max(float(np.linalg.eigvalsh(platform.inertia)[0]), restoring)
        return [unit * torque for torque in TORQUES]
    output = next(o for body in problem.bodies for o in body.outputs if o.stream == name)
    return [float(np.median(output.noise)) * error for error in ERRORS]


def _sharpened(
    noise: NoiseProcess, reached: float, cost: Cost, longest: float
) -> tuple[NoiseProcess, float]:
    """With rms and time of all processes at their best together."""
    names = [*([TORQUE] if noise.torque else []), *(stream for stream, _ in noise.errors)]

    def at(logs: Array) -> NoiseProcess:
        whitened = noise
        for name, (rms, time) in zip(names, np.exp(logs).reshape(-1, 2).tolist(), strict=True):
            whitened = _with(whitened, name, Wander(rms, float(np.clip(time, SHORTEST, longest))))
        return whitened

    first = np.log([[item.rms, item.time] for item in map(lambda n: _of(noise, n), names)]).ravel()
    simplex = np.concatenate([first[None], first + 0.7 * np.eye(len(first))])
    result = minimize(
        lambda logs: cost(at(logs)),
        first,
        method="Nelder-Mead",
        options={
            "initial_simplex": simplex,
            "xatol": WITHIN,
            "fatol": 1.0,
            "maxfev": EVALUATIONS * len(names),
        },
    )
    if float(result.fun) > reached:
        return noise, reached
    return at(result.x), float(result.fun)


def _pruned(noise: NoiseProcess, reached: float, cost: Cost) -> tuple[NoiseProcess, float]:
    """Without the processes that no longer pay."""
    for name in [*([TORQUE] if noise.torque else []), *(stream for stream, _ in noise.errors)]:
        fewer = _with(noise, name, None)
        whitened = cost(fewer)
        if whitened < reached + WORTHWHILE:
            noise, reached = fewer, whitened
    return noise, reached


def _with(noise: NoiseProcess, name: str, wander: Wander | None) -> NoiseProcess:
    if name == TORQUE:
        return replace(noise, torque=wander)
    return noise.with_error(name, wander)


def _of(noise: NoiseProcess, name: str) -> Wander:
    result = noise.torque if name == TORQUE else dict(noise.errors)[name]
    assert result is not None
    return result
