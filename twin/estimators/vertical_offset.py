"""How far the CM is below the CR, from the gyro: one offset in a Kalman filter."""

from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from twin.estimators.estimator import (
    Estimator,
    OffsetEstimate,
    blank,
    encoders,
    need_floating_body,
    newest,
    ready_runs,
    shared,
    still_awaited,
)
from twin.platform import Platform
from twin.rotation import cross, skew, vertical_body
from twin.signals import Estimate, Quantity, Reading, Samples

Array = NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])
_ALONG = np.outer(_UP, _UP)


@dataclass(slots=True, kw_only=True)
class VerticalEstimate(OffsetEstimate):
    """The estimate at the newest gyro sample."""

    state: Array
    """(n, 4) body rate [rad/s] and r_z [m]."""
    state_covariance: Array
    """(n, 4, 4) of it."""
    gyro_time: Array
    """(n,) of that sample [s]; NaN before the first."""
    inertia: Array
    """(3, 3) [kg m^2]."""
    inverse: Array
    """(3, 3) of it."""
    weight: float
    """[N]."""
    mass: float
    """[kg]."""

    def quantities(self) -> dict[str, Quantity]:
        """r_z alone: of the offset in the plane the filter knows nothing."""
        sigma = np.sqrt(self.state_covariance[:, 3:, 3])
        return {"vertical_offset": Quantity(self.state[:, 3:], sigma, "m", ("z",))}


@dataclass(frozen=True)
class VerticalOffsetFilter(Estimator):
    """Extended Kalman filter of body rate and vertical offset, x = (w, r_z).

    dw/dt = J^-1 (-w x J w + r x f),  r = (0, 0, r_z),  f = -m g R^T e_z,  dr_z/dt = 0   (29)
    dP/dt = F P + P F^T + Q, F = df/dx                                                    (33)
    K = P H^T (H P H^T + R)^-1, H = (1 0)                                                 (36)
    x+ = x + K (z - H x),  P+ = (1 - K H) P (1 - K H)^T + K R K^T                     (35, 37)

    Each gyro sample z is taken in turn, and between two of them (30) and (33) are stepped once,
    F held. R is the newest attitude as it was measured, up to that sample.

    It knows of no offset in the plane and of no gyro bias, and takes what they do for a vertical
    offset: on a machine that swings by 10 deg, 2.6 um in plane move r_z by a tenth of 50 um. The
    stages must stand still; r_z is then that of the whole, where they stand.

    Q, R and P_0 are as printed, whatever the platform states of its sensors.

    Source: S. Y. Choi, Automatic mass balancing system for the 5-DOF spacecraft simulator, Georgia
    Institute of Technology 2016, eq. 27 to 41. Its fig. 10 has r_z upside down: the CM is below the
    CR where the machine swings.
    """

    rate_process: float = field(default=1e-6, metadata={"unit": "rad^2/s^3"})
    """Of Q, about each axis (39)."""
    offset_process: float = field(default=1e-10, metadata={"unit": "m^2/s"})
    """Of Q (39)."""
    gyro_variance: float = field(default=2.5e-6, metadata={"unit": "rad^2/s^2"})
    """R (40), of a sample."""
    rate_start: float = field(default=1e-9, metadata={"unit": "rad^2/s^2"})
    """Of P_0, about each axis (41)."""
    offset_start: float = field(default=1e-6, metadata={"unit": "m^2"})
    """Of P_0 (41)."""

    def init(self, platform: Platform, n: int) -> VerticalEstimate:
        """Level, at rest, the CM at the CR; not valid."""
        need_floating_body(platform, "vertical_offset")
        variances = [self.rate_start] * 3 + [self.offset_start]
        return VerticalEstimate(
            **shared(blank(platform, n)),
            center_of_mass_offset=np.zeros((n, 3)),
            offset_covariance=platform.mass**2 * self.offset_start * np.tile(_ALONG, (n, 1, 1)),
            state=np.zeros((n, 4)),
            state_covariance=np.tile(np.diag(variances), (n, 1, 1)),
            gyro_time=np.full(n, np.nan),
            inertia=platform.inertia,
            inverse=np.asarray(np.linalg.inv(platform.inertia), dtype=np.float64),
            weight=platform.mass * platform.gravity,
            mass=platform.mass,
        )

    def update(self, estimate: Estimate, reading: Reading) -> VerticalEstimate:
        """Valid from a run's first attitude and positions; gyro before the former tells nothing."""
        before, streams = cast(VerticalEstimate, estimate), reading.streams
        state, covariance, time = before.state, before.state_covariance, before.gyro_time
        attitude, oriented = before.attitude, before.oriented
        fixes, gyro = streams.get("attitude"), streams.get("gyro")
        if gyro is not None:
            for place in range(gyro.time.shape[1]):
                stamp, shown = gyro.time[:, place], gyro.valid[:, place]
                if fixes is not None:
                    attitude, oriented = _until(fixes, stamp, attitude, oriented)
                used = shown & oriented
                step = np.where(used & ~np.isnan(time), stamp - time, 0.0)
                moved, spread = self._predicted(before, state, covariance, attitude, step)
                moved, spread = self._corrected(moved, spread, gyro.value[:, place])
                state = np.where(used[:, None], moved, state)
                covariance = np.where(used[:, None, None], spread, covariance)
                time = np.where(used, stamp, time)
        attitude = newest(fixes, attitude)
        if fixes is not None:
            oriented = oriented | fixes.valid.any(axis=1)
        awaited = still_awaited(streams, before)
        return replace(
            before,
            time=reading.time,
            attitude=attitude,
            rate_body=state[:, :3],
            **encoders(streams, before),
            valid=ready_runs(oriented, awaited),
            oriented=oriented,
            awaited=awaited,
            center_of_mass_offset=before.mass * state[:, 3:] * _UP,
            offset_covariance=before.mass**2 * covariance[:, 3:, 3:] * _ALONG,
            state=state,
            state_covariance=covariance,
            gyro_time=time,
        )

    def _predicted(
        self,
        known: VerticalEstimate,
        state: Array,
        covariance: Array,
        attitude: Array,
        step: Array,
    ) -> tuple[Array, Array]:
        """(30) and (33) over a step (n,) [s]."""
        rate, height = state[:, :3], state[:, 3:]
        inverse = known.inverse
        momentum = np.einsum("ij,nj->ni", known.inertia, rate)
        arm = cross(np.broadcast_to(_UP, rate.shape), -known.weight * vertical_body(attitude))
        change = np.einsum("ij,nj->ni", inverse, height * arm - cross(rate, momentum))
        slope = np.zeros((len(state), 4, 4))
        slope[:, :3, :3] = inverse @ (skew(momentum) - skew(rate) @ known.inertia)
        slope[:, :3, 3] = np.einsum("ij,nj->ni", inverse, arm)
        onward = np.eye(4) + step[:, None, None] * slope
        moved = state.copy()
        moved[:, :3] += step[:, None] * change
        spread = onward @ covariance @ onward.transpose(0, 2, 1)
        process = np.array([self.rate_process] * 3 + [self.offset_process])
        spread[:, range(4), range(4)] += step[:, None] * process
        return moved, spread

    def _corrected(self, state: Array, covariance: Array, shown: Array) -> tuple[Array, Array]:
        """(35) to (37), by a sample (n, 3) [rad/s]."""
        noise = self.gyro_variance * np.eye(3)
        seen = covariance[:, :, :3]
        gain = seen @ np.linalg.inv(seen[:, :3] + noise)
        left = np.eye(4) - gain @ np.eye(3, 4)
        state = state + np.einsum("nij,nj->ni", gain, shown - state[:, :3])
        spread = left @ covariance @ left.transpose(0, 2, 1)
        return state, spread + self.gyro_variance * gain @ gain.transpose(0, 2, 1)


def _until(
    fixes: Samples, time: Array, held: Array, known: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """The newest attitude (n, 4) that was true by then (n,), and whether there is one yet."""
    valid = fixes.valid & (fixes.time <= time[:, None] + 1e-9)
    return newest(Samples(fixes.value, fixes.time, valid), held), known | valid.any(axis=1)
