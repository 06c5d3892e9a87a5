"""State and base together in one Kalman filter, extended or unscented (filterpy).

The state is a turn away from the attitude followed so far, the whole momentum H in body axes, the
gyro's bias and the base. What wheels, gimbals and masses hold of H is measured, c, so that nothing
is differentiated:

    dH/dt = (m r + d) x g + T - w x H,   w = J^-1 (H - c)

and what c is read wrong by is noise in w. Sources: S. Y. Choi, Georgia Institute of Technology
2016, eq. 27 to 41, of whose filter for one offset this is the whole; E. A. Wan and R. van der
Merwe, The unscented Kalman filter, 2001. It goes through a log once, and its intervals are those of
its own linearisation.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from numpy.typing import NDArray
from scipy.linalg import block_diag

from twin import rotation
from twin.errors import UsageError
from twin.identification.linear import LinearEstimate
from twin.identification.prediction_error import NORMAL
from twin.identification.track import Track
from twin.noise import noise_of
from twin.predict.base import ENTRIES, BaseParameters
from twin.recording import Recording, Series

Array = NDArray[np.float64]

RATE = 20.0
"""Updates a second, at most."""
DOUBT = 0.3
"""1 sigma of what is stated of the base, in parts of its scale."""
DIFFERENCE = 1e-5
"""Of the extended filter's slopes."""
POINTS = (1e-1, 2.0, 0.0)
"""alpha, beta and kappa of the sigma points."""
TURN, MOMENTUM, BIAS, BASE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, None)
STATES, READ = 9, 6
"""Numbers before those of the base; numbers that are read: a turn and a rate."""


def ekf(logs: Sequence[tuple[Recording, Track]], base: BaseParameters) -> LinearEstimate:
    """Extended: slopes by differences.

    Args:
        logs: each with its track as it was read.
        base: the parameters sought.

    Raises:
        UsageError: a base that is no ball, or a filter that loses the motion.
    """
    return _through(logs, base, _Extended)


def ukf(logs: Sequence[tuple[Recording, Track]], base: BaseParameters) -> LinearEstimate:
    """Unscented: 2 n + 1 states carried along; otherwise like `ekf`."""
    return _through(logs, base, _Unscented)


class _Motion:
    """One log, from each instant to the next, for any number of states (v, 9 + p) at once."""

    def __init__(self, track: Track, base: BaseParameters) -> None:
        self.track, self.base = track, base
        self.place = 0
        self.attitude, self.next = track.attitude[0], track.attitude[0]
        self._down = np.array([0.0, 0.0, -base.machine.platform.gravity])

    def aim(self, mean: Array, place: int) -> None:
        """From an instant on, turns are told from where this mean goes."""
        self.place = place
        self.next = self._carried(mean[None])[0][0]

    def after(self, x: Array) -> Array:
        """States at the next instant."""
        attitude, momentum = self._carried(x)
        turn = rotation.multiply(rotation.conjugate(self.next), attitude)
        parts = (rotation.to_rotation_vector(turn), momentum, x[:, BIAS], x[:, BASE])
        return np.concatenate(parts, axis=1)

    def read(self, x: Array) -> Array:
        """(v, 6) what the sensors say at the next instant: turn, and rate with bias."""
        inertia, _ = self.bodies(x)
        rate = _rate(inertia, x[:, MOMENTUM] - self.track.carried[self.place + 1])
        return np.concatenate([x[:, TURN], rate + x[:, BIAS]], axis=1)

    def bodies(self, x: Array) -> tuple[Array, Array]:
        """J (v, 3, 3) and m r (v, 3)."""
        base = self.base
        entries = base.entries(base.as_stated) + (x[:, BASE] * base.scale) @ base.map.T
        inertia = np.empty((len(x), 3, 3))
        for entry, (i, j) in enumerate(ENTRIES):
            inertia[:, i, j] = inertia[:, j, i] = entries[:, entry]
        return inertia, entries[:, len(ENTRIES) :]

    def _carried(self, x: Array) -> tuple[Array, Array]:
        track, step, ends = self.track, self.track.step, slice(self.place, self.place + 2)
        q = rotation.multiply(self.attitude, rotation.from_rotation_vector(x[:, TURN]))
        inertia, moment = self.bodies(x)
        moment, torque = moment + track.moved[ends].mean(axis=0), track.torque[ends].mean(axis=0)
        begin = end = x[:, MOMENTUM]
        first, last = track.carried[ends]
        rate = _rate(inertia, begin - 0.5 * (first + last))
        for _ in range(2):
            turned = rotation.multiply(q, rotation.from_rotation_vector(0.5 * step * rate))
            gravity = rotation.rotate(rotation.conjugate(turned), self._down)
            swept = rotation.cross(rate, 0.5 * (begin + end))
            end = begin + step * (rotation.cross(moment, gravity) + torque - swept)
            rate = 0.5 * (_rate(inertia, begin - first) + _rate(inertia, end - last))
        return rotation.multiply(q, rotation.from_rotation_vector(step * rate)), end


class _Extended(ExtendedKalmanFilter):  # pyright: ignore[reportUntypedBaseClass]
    def __init__(self, motion: _Motion, size: int) -> None:
        super().__init__(size, READ)
        self.motion = motion

    def predict_x(self, u: Any = 0) -> None:
        """The mean, and the slopes there."""
        self.x, self.F = self._sloped(self.motion.after)

    def observe(self, z: Array) -> None:
        """Update by a turn and a rate."""
        value, slope = self._sloped(self.motion.read)
        self.update(z, lambda _: slope, lambda _: value)

    def _sloped(self, function: Callable[[Array], Array]) -> tuple[Array, Array]:
        shifted = self.x + np.concatenate([np.zeros((1, self.dim_x)), DIFFERENCE * self._I])
        values = function(shifted)
        return values[0], (values[1:] - values[0]).T / DIFFERENCE


class _Unscented(UnscentedKalmanFilter):  # pyright: ignore[reportUntypedBaseClass]
    def __init__(self, motion: _Motion, size: int) -> None:
        def read(x: Array) -> Array:
            return motion.read(x[None])[0]

        points = MerweScaledSigmaPoints(size, *POINTS)
        super().__init__(size, READ, motion.track.step, read, None, points)
        self.motion = motion

    def compute_process_sigmas(self, dt: float, fx: Any = None, **fx_args: Any) -> None:
        """All at once."""
        self.sigmas_f = self.motion.after(self.points_fn.sigma_points(self.x, self.P))

    def observe(self, z: Array) -> None:
        """Update by a turn and a rate."""
        self.update(z)


def _through(
    logs: Sequence[tuple[Recording, Track]],
    base: BaseParameters,
    kind: Callable[[_Motion, int], _Extended | _Unscented],
) -> LinearEstimate:
    if base.machine.platform.base.kind != "ball":
        raise UsageError(
            f"the filters ekf and ukf are of a body on a ball; {base.machine.platform.name} turns "
            "about a hinge: use prediction-error"
        )
    result, spread = np.zeros(len(base.scale)), np.square(DOUBT) * np.eye(len(base.scale))
    for recording, whole in logs:
        track = whole.every(max(int(1.0 / RATE / whole.step + 1e-9), 1))
        motion = _Motion(track, base)
        follow = kind(motion, STATES + len(result))
        try:
            _run(follow, motion, _Noise(recording, track), result, spread)
        except np.linalg.LinAlgError:
            follow.x[:] = np.nan
        if not np.isfinite(follow.x).all():
            raise UsageError(
                "the filter loses the motion: what it takes for the inertia is no body's; state a "
                "better J and m r in platform.toml, or use prediction-error"
            )
        result, spread = follow.x[BASE], follow.P[BASE, BASE]
    covariance = spread * np.outer(base.scale, base.scale)
    return LinearEstimate(base.as_stated + result * base.scale, covariance, NORMAL)


def _run(
    follow: _Extended | _Unscented, motion: _Motion, noise: "_Noise", result: Array, spread: Array
) -> None:
    track = motion.track
    first = np.concatenate([np.zeros(STATES), result])
    inertia = motion.bodies(first[None])[0][0]
    first[MOMENTUM] = inertia @ track.rate[0] + track.carried[0]
    turn, rate, held = noise.turn, noise.rate, noise.held
    follow.x = first
    # the bias that the attitude has left is less than a sample's noise
    follow.P = block_diag(turn, inertia @ rate @ inertia.T + held, rate, spread)
    for place in range(len(track.time) - 1):
        motion.aim(follow.x, place)
        slip = np.linalg.inv(motion.bodies(follow.x[None])[0][0])
        slip = slip @ held @ slip.T
        follow.Q = np.zeros_like(follow.P)
        follow.Q[TURN, TURN] = np.square(track.step) * slip
        follow.R = block_diag(turn, rate + slip)
        follow.predict()
        off = rotation.multiply(rotation.conjugate(motion.next), track.attitude[place + 1])
        follow.observe(np.concatenate([rotation.to_rotation_vector(off), track.rate[place + 1]]))
        onward = rotation.from_rotation_vector(follow.x[TURN])
        motion.attitude = rotation.multiply(motion.next, onward)
        follow.x[TURN] = 0.0


class _Noise:
    """(3, 3) covariances of what is read at an instant."""

    def __init__(self, recording: Recording, track: Track) -> None:
        # an attitude that comes more rarely than it is used tells no more for that
        shown = float(np.median(np.diff(recording["attitude"].time)))
        often = max(shown / track.step, 1.0)
        carried = Series(track.time, track.carried, ("x", "y", "z"), "N m s")
        self.turn = np.diag(np.square(noise_of(recording["attitude"])) * often)
        self.rate = np.diag(np.square(noise_of(recording["gyro"])))
        self.held = np.diag(np.square(noise_of(carried)))


def _rate(inertia: Array, momentum: Array) -> Array:
    return np.asarray(np.linalg.solve(inertia, momentum[..., None])[..., 0], dtype=np.float64)
