"""How much wanders in logs, and how noisy their sensors are: maximum likelihood beside a fit.

Base, biases, strengths and states are at their best for each size that is tried, in the linearised
prediction of where the fit stands, so a trial costs a filter and no rollout. Sizes and time
constants are sought by their logarithms. What does not pay for its place is 0, and has no state.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.identify.prediction_error import Fit, fit
from twin.predict.whitening.innovations import Innovations, Problem
from twin.predict.whitening.noise_model import QUIET, SLOW, WALKING, GaussMarkov, NoiseModel
from twin.predict.whitening.unknowns import Unknowns

Array = NDArray[np.float64]

ROOM = 6.0
"""-2 log L that each thing that wanders must gain, or it is not there; and that it costs where it
is: what costs nothing would be everywhere."""
TORQUE_TIME, ERROR_TIME = 3.0, 20.0
"""Usual time constants: of draughts and cables, of an attitude filter [s]."""
TIME_WIDTH = float(np.log(2.0))
"""1 sigma of the logarithm of a time constant about its usual one: where sensors hide it, only what
a torque does in the long run shows, and its rms goes with it."""
STATED_WIDTH = float(np.log(2.0))
"""Likewise, of a sensor's noise about what is stated of it."""
DECADES = (-14.0, 2.0)
"""Powers of ten between which a torque is sought: intensity per squared scale of the base
[rad^2/s^3]."""
ERRORS = (0.1, 0.4, 1.5)
"""Sizes of a slow error that are tried first, in units of a sample's noise."""
WALKS = (3e-3, 3e-2)
"""Likewise of what a constant error walks in a second."""
STEP = 0.1
"""Of differences of logarithms."""
FARTHEST = 1.5
"""That a logarithm moves in one iteration."""
CONVERGED = 0.5
"""Fall of -2 log L at which the iteration ends."""
ITERATIONS = 12
AS_PROMISED = 1.0
"""Cost by which a fit may differ from what its linearisation foretold, for its noise to stay."""
UNSURE = 0.01
"""Share by which a sensor's noise may be off and stay as it was."""
ROUNDS = 3
"""Times that the fit and its noise follow each other."""


def fit_with_noise(problem: Problem, start: Unknowns, noise: NoiseModel = QUIET) -> Fit:
    """Fit the base, the biases and the states, with all that wanders as large as is likeliest.

    Args:
        problem: the logs.
        start: where the unknowns start.
        noise: where the noise starts.

    Raises:
        TwinError: no rigid body has the base that the iteration starts from.
    """
    found = fit(problem, start, noise)
    for round_ in range(ROUNDS):
        there = likeliest(problem, found.innovations, look=round_ == 0)
        promised = cost_of(problem, there)
        if not promised < cost_of(problem, found.innovations) - CONVERGED:
            break
        found = fit(problem, there.moved(there.step()), there.noise)
        if abs(cost_of(problem, found.innovations) - promised) < AS_PROMISED:
            break
    return found


def cost_of(problem: Problem, now: Innovations) -> float:
    """-2 log of the marginal likelihood of a fit, up to a constant, and what its room costs.

    Whatever the base and the biases are: what these take of the noise would be missed in it, and a
    torque that is always there pass for one that wanders less (restricted likelihood; H. D.
    Patterson and R. Thompson, Biometrika 58, 1971). Strengths are at their best.
    """
    return now.cost + told(now) + _known(problem, now.noise) + ROOM * _count(now.noise)


def told(now: Innovations) -> float:
    """Log-determinant of what logs tell of the base and the biases, in units of the base's."""
    count = len(now.at.theta) + sum(map(len, now.at.biases))
    columns = now.columns[:, :count]
    size = np.linalg.norm(columns, axis=0)
    triangle = np.linalg.qr(columns / size, mode="r")
    return 2.0 * float(np.log(np.abs(np.diag(triangle)) * size).sum())


def likeliest(
    problem: Problem, now: Innovations, *, look: bool = True, among: Sequence[NoiseModel] = ()
) -> Innovations:
    """The same fit with the likeliest noise.

    Args:
        problem: the logs.
        now: where they were linearised, and the noise to start from.
        look: also for what is not there yet.
        among: other noise to start from, if that is likelier: from far too little, which does
            nothing, no slope leads up to what there is.
    """
    trials = _Trials(problem, now)
    noise = trials.best([now.noise, *among])
    if look:
        for kind in _kinds(problem):
            if not kind.there(noise):
                noise = trials.best([noise, *kind.seeds(noise, trials)])
    noise = _rescaled(trials, noise)
    while True:
        noise = _settled(trials, noise)
        fewer = [kind.without(noise) for kind in _kinds(problem) if kind.there(noise)]
        least = trials.best([noise, *fewer])
        if least == noise:
            break
        noise = least
    return trials.at(_rescaled(trials, noise))


class _Trials:
    """Noise of different sizes beside one fit, each tried once."""

    def __init__(self, problem: Problem, now: Innovations) -> None:
        self.problem, self.now = problem, now
        self._costs: dict[str, float] = {repr(now.noise): cost_of(problem, now)}
        self.bends: dict[int, float] = {}
        """Curvature of the cost along the logarithm of each number that was settled, by place."""

    def at(self, noise: NoiseModel) -> Innovations:
        """The fit with it."""
        return self.problem.whiten(self.now.at, self.now.exact, noise)

    def cost(self, noise: NoiseModel) -> float:
        """Infinite where no number holds it."""
        key = repr(noise)
        if key not in self._costs:
            try:
                self._costs[key] = cost_of(self.problem, self.at(noise))
            except (TwinError, np.linalg.LinAlgError):
                self._costs[key] = float("inf")
        return self._costs[key]

    def best(self, several: Sequence[NoiseModel]) -> NoiseModel:
        """Of several the likeliest; the first of equals."""
        return min(several, key=self.cost)


@dataclass(frozen=True)
class _Kind:
    """One thing that may wander, by its numbers."""

    get: Callable[[NoiseModel], tuple[float, ...]]
    """Its size, and its time constant if it has one."""
    put: Callable[[NoiseModel, tuple[float, ...]], NoiseModel]
    seeds: Callable[[NoiseModel, _Trials], list[NoiseModel]]
    """Sizes to begin with, where it is not there yet."""

    def there(self, noise: NoiseModel) -> bool:
        return self.get(noise)[0] > 0.0

    def without(self, noise: NoiseModel) -> NoiseModel:
        return self.put(noise, (0.0, *self.get(noise)[1:]))


def _kinds(problem: Problem) -> list[_Kind]:
    """All that may wander in these logs."""
    outputs = [output for body in problem.bodies for output in body.outputs]
    sigma = {o.stream: float(np.mean(o.noise)) for o in outputs if o.told is None}
    found = [_torque(problem)]
    found += [_error(stream, size) for stream, size in sigma.items() if stream in SLOW]
    return found + [_walk(stream, size) for stream, size in sigma.items() if stream in WALKING]


def _torque(problem: Problem) -> _Kind:
    scale = float(np.max(problem.base.scale))

    def put(noise: NoiseModel, numbers: tuple[float, ...]) -> NoiseModel:
        return replace(noise, torque=GaussMarkov(*numbers))

    def of(noise: NoiseModel, decade: float) -> NoiseModel:
        rms = scale * np.sqrt(10.0**decade / (2.0 * TORQUE_TIME))
        return put(noise, (float(rms), TORQUE_TIME))

    def seeds(noise: NoiseModel, trials: _Trials) -> list[NoiseModel]:
        # far more than there is does harm, far less nothing: between them it is found by halves
        none, (low, high) = trials.cost(noise), DECADES
        found: list[NoiseModel] = []
        while high - low > 1.0:
            middle = 0.5 * (low + high)
            found.append(of(noise, middle))
            better = trials.cost(found[-1]) < none + ROOM + 0.1
            worse = not better or trials.cost(found[-1]) > trials.cost(of(noise, middle - 0.5))
            low, high = (low, middle) if worse else (middle, high)
        return found

    return _Kind(lambda n: (n.torque.rms, n.torque.time_constant), put, seeds)


def _error(stream: str, sigma: float) -> _Kind:
    def get(noise: NoiseModel) -> tuple[float, ...]:
        error = noise.errors.get(stream, GaussMarkov(0.0, ERROR_TIME))
        return error.rms, error.time_constant

    def put(noise: NoiseModel, numbers: tuple[float, ...]) -> NoiseModel:
        return noise.with_error(stream, GaussMarkov(*numbers))

    def seeds(noise: NoiseModel, _: _Trials) -> list[NoiseModel]:
        return [put(noise, (size * sigma, ERROR_TIME)) for size in ERRORS]

    return _Kind(get, put, seeds)


def _walk(stream: str, sigma: float) -> _Kind:
    def get(noise: NoiseModel) -> tuple[float, ...]:
        return (noise.walks.get(stream, 0.0),)

    def put(noise: NoiseModel, numbers: tuple[float, ...]) -> NoiseModel:
        return noise.with_walk(stream, *numbers)

    def seeds(noise: NoiseModel, _: _Trials) -> list[NoiseModel]:
        return [put(noise, (size * sigma,)) for size in WALKS]

    return _Kind(get, put, seeds)


def _settled(trials: _Trials, noise: NoiseModel) -> NoiseModel:
    """All that is there at its likeliest: a quasi-Newton iteration (BFGS) on logarithms."""
    every = _kinds(trials.problem)
    places = [
        3 * place + number
        for place, kind in enumerate(every)
        for number in range(len(kind.get(noise)) if kind.there(noise) else 0)
    ]
    kinds = [kind for kind in every if kind.there(noise)]
    counts = [len(kind.get(noise)) for kind in kinds]

    def placed(logs: Array) -> NoiseModel:
        there = noise
        for kind, part in zip(kinds, np.split(logs, np.cumsum(counts)[:-1]), strict=True):
            there = kind.put(there, tuple(np.exp(part).tolist()))
        return there

    def cost(logs: Array) -> float:
        return trials.cost(placed(logs))

    if not kinds:
        return noise
    now = np.log(np.concatenate([kind.get(noise) for kind in kinds]))
    units = STEP * np.eye(len(now))
    value = cost(now)
    ahead = np.array([cost(now + unit) for unit in units])
    if not all(place in trials.bends for place in places):
        behind = np.array([cost(now - unit) for unit in units])
        bend = (ahead + behind - 2.0 * value) / STEP**2
        trials.bends.update(zip(places, np.maximum(np.abs(bend), 1.0).tolist(), strict=True))
    bend = np.array([trials.bends[place] for place in places])
    slope = (ahead - value) / STEP - 0.5 * STEP * bend
    inverse = np.diag(1.0 / bend)
    for _ in range(ITERATIONS):
        step = np.clip(-inverse @ slope, -FARTHEST, FARTHEST)
        there, after = _downhill(cost, now, step, value)
        if there is None or value - after < CONVERGED:
            now = now if there is None else there
            break
        taken, now, value = there - now, there, after
        ahead = np.array([(cost(now + unit) - value) / STEP for unit in units]) - 0.5 * STEP * bend
        inverse = _updated(inverse, taken, ahead - slope)
        slope = ahead
    return placed(now)


def _downhill(
    cost: Callable[[Array], float], now: Array, step: Array, value: float
) -> tuple[Array | None, float]:
    """After the largest part of a step that makes it likelier; None without any."""
    for halving in range(4):
        there = now + 0.5**halving * step
        after = cost(there)
        if after < value:
            return there, after
    return None, value


def _updated(inverse: Array, step: Array, change: Array) -> Array:
    """The inverse of the curvature after a step that changed the slope so (BFGS)."""
    along = float(step @ change)
    if along < 1e-6 * float(np.linalg.norm(step) * np.linalg.norm(change)):
        return inverse
    part = np.eye(len(step)) - np.outer(step, change) / along
    return part @ inverse @ part.T + np.outer(step, step) / along


def _rescaled(trials: _Trials, noise: NoiseModel) -> NoiseModel:
    """With the white noise of each stream as large as what is left of it, where that pays."""
    now = trials.at(noise)
    problem, squares = trials.problem, dict[str, list[Array]]()
    for body, rows in zip(problem.bodies, now.left(), strict=True):
        for output, values in zip(body.outputs, body.cells.gather(rows), strict=True):
            if output.scatters and output.told is None:
                squares.setdefault(output.stream, []).append(np.square(values).ravel())
    other = noise
    for stream, parts in squares.items():
        size = float(np.sqrt(np.mean(np.concatenate(parts))))
        if abs(size - 1.0) > UNSURE:
            other = other.with_scale(stream, noise.scales.get(stream, 1.0) * size)
    return other if trials.cost(other) < trials.cost(noise) - ROOM else noise


def _known(problem: Problem, noise: NoiseModel) -> float:
    """-2 log of how likely such noise is beforehand."""
    total = 0.0
    times = [(noise.torque, TORQUE_TIME)]
    times += [(error, ERROR_TIME) for error in noise.errors.values()]
    for process, usual in times:
        if process.rms > 0.0:
            total += (np.log(process.time_constant / usual) / TIME_WIDTH) ** 2
    for body in problem.bodies:
        for output in body.outputs:
            claimed = output.noise if output.stated else output.claimed
            if noise.scales.get(output.stream, 1.0) != 1.0 and np.all(claimed > 0.0):
                off = np.log(noise.scales[output.stream] * output.noise / claimed)
                total += float(np.mean(np.square(off))) / STATED_WIDTH**2
    return float(total)


def _count(noise: NoiseModel) -> int:
    """Of things that wander."""
    sizes = [noise.torque.rms, *(e.rms for e in noise.errors.values()), *noise.walks.values()]
    return sum(size > 0.0 for size in sizes)
