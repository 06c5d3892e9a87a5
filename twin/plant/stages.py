"""Motion of sliding masses: trapezoidal moves, planned one step of the drive at a time.

Each such step holds one acceleration and is one physics step or several, so the motion that is fed
to MuJoCo as a prescribed joint is exact on the grid of those. The acceleration is Han's discrete
time-optimal feedback ("From PID to Active Disturbance Rejection Control", IEEE Trans. Ind.
Electron. 56(3), 2009): it brings distance and speed to rest in the fewest steps, past the target by
less than a tenth of limit * step^2.
"""

import math
from typing import NamedTuple

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
    acceleration = np.zeros((len(position), steps, position.shape[1]))
    if len(position) == 1:
        # of a few numbers NumPy's calls cost far more than the sums
        position, speed = position.copy(), speed.copy()
        for i, (fastest, limit) in enumerate(zip(max_speed, max_acceleration, strict=True)):
            drive = _Drive(float(target[0, i]), float(fastest), float(limit), step)
            pulls, position[0, i], speed[0, i] = drive.plan(
                float(position[0, i]), float(speed[0, i]), steps
            )
            acceleration[0, :, i] = pulls
        return acceleration, position, speed
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


class _Drive(NamedTuple):
    """One stage of one run: the same law as for arrays, to the bit."""

    target: float
    """[m]."""
    max_speed: float
    """[m/s]."""
    max_acceleration: float
    """[m/s^2]."""
    step: float
    """[s]."""

    def plan(self, position: float, speed: float, steps: int) -> tuple[list[float], float, float]:
        """Accelerations held in each step [m/s^2], position [m] and speed [m/s] at the end."""
        step = self.step
        pulls: list[float] = []
        for _ in range(steps):
            pull = self._time_optimal(position - self.target, speed)
            pull = max(pull, (-self.max_speed - speed) / step)
            pull = min(pull, (self.max_speed - speed) / step)
            position = position + step * speed + 0.5 * step * step * pull
            speed = speed + step * pull
            pulls.append(pull)
            near = abs(position - self.target) < 10.0 * _ARRIVED
            if near and abs(speed) < _ARRIVED / step:
                position, speed = self.target, 0.0
        return pulls, position, speed

    def _time_optimal(self, distance: float, speed: float) -> float:
        d = self.max_acceleration * self.step * self.step
        moved = self.step * speed
        y = distance + 0.5 * moved
        if abs(y) <= d:
            a = moved + y
        else:
            root = math.sqrt(d * (d + 8.0 * abs(y)))
            a = moved + math.copysign(1.0, y) * (root - d) * 0.5
        return -self.max_acceleration * min(max(a / d, -1.0), 1.0)
