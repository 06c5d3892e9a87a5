"""Motion of sliding masses: trapezoidal moves, planned one step of the drive at a time.

Each such step holds one acceleration and is one physics step or several, so the motion that is fed
to MuJoCo as a prescribed joint is exact on the grid of those. The acceleration is Han's discrete
time-optimal feedback ("From PID to Active Disturbance Rejection Control", IEEE Trans. Ind.
Electron. 56(3), 2009): it brings distance and speed to rest in the fewest steps, past the target by
less than a tenth of limit * step^2.
"""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ARRIVED = 1e-16
"""[m]: a stage that moves less than this in a step, within ten times this of its target, is put
there at rest. The jump in speed changes the machine's momentum, so it must be of the size of
rounding."""


def plan(
    position: Array,
    speed: Array,
    target: Array,
    *,
    steps: int,
    step: float,
    max_speed: Array,
    max_acceleration: Array,
) -> tuple[Array, Array, Array]:
    """Move towards `target` for a number of steps.

    Arrays are (n, s) [m, m/s]; limits (s,) [m/s, m/s^2].

    Returns:
        Accelerations held in each step (n, steps, s) [m/s^2], position and speed at the end.
    """
    if len(position) == 1:
        return _plan_one(position, speed, target, steps, step, max_speed, max_acceleration)
    acceleration = np.zeros((len(position), steps, position.shape[1]))
    for k in range(steps):
        pull = _time_optimal(position - target, speed, max_acceleration, step)
        pull = np.clip(pull, (-max_speed - speed) / step, (max_speed - speed) / step)
        position = position + step * speed + 0.5 * step * step * pull
        speed = speed + step * pull
        acceleration[:, k] = pull
        arrived = (np.abs(position - target) < 10.0 * _ARRIVED) & (np.abs(speed) < _ARRIVED / step)
        position = np.where(arrived, target, position)
        speed = np.where(arrived, 0.0, speed)
    return acceleration, position, speed


def _time_optimal(distance: Array, speed: Array, limit: Array, step: float) -> Array:
    """Han's fhan, for x+ = x + h v + h^2 u / 2: the shift by half a step's travel is his y."""
    d = limit * step * step
    moved = step * speed
    y = distance + 0.5 * moved
    root = np.sqrt(d * (d + 8.0 * np.abs(y)))
    far = moved + np.sign(y) * (root - d) * 0.5
    near = moved + y
    inside = np.abs(y) <= d
    a = np.where(inside, near, far)
    return -limit * np.clip(a / d, -1.0, 1.0)


def _plan_one(
    position: Array,
    speed: Array,
    target: Array,
    steps: int,
    step: float,
    max_speed: Array,
    max_acceleration: Array,
) -> tuple[Array, Array, Array]:
    """The same for one run, to the bit: of a few numbers NumPy's calls cost six times the sums."""
    acceleration = np.zeros((1, steps, position.shape[1]))
    position, speed = position.copy(), speed.copy()
    each = zip(position[0], speed[0], target[0], max_speed, max_acceleration, strict=True)
    for i, numbers in enumerate(each):
        x, v, goal, fastest, limit = map(float, numbers)
        d = limit * step * step
        for k in range(steps):
            moved = step * v
            y = (x - goal) + 0.5 * moved
            far = moved + math.copysign(1.0, y) * (math.sqrt(d * (d + 8.0 * abs(y))) - d) * 0.5
            a = moved + y if abs(y) <= d else far
            pull = -limit * min(max(a / d, -1.0), 1.0)
            pull = min(max(pull, (-fastest - v) / step), (fastest - v) / step)
            x = x + step * v + 0.5 * step * step * pull
            v = v + step * pull
            acceleration[0, k, i] = pull
            if abs(x - goal) < 10.0 * _ARRIVED and abs(v) < _ARRIVED / step:
                x, v = goal, 0.0
        position[0, i], speed[0, i] = x, v
    return acceleration, position, speed
