"""What a balancing leaves: the CM's offset and gravity's torque, with 95 % intervals."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from twin.controller.exchange import exchange_of
from twin.identification import Misfit
from twin.interval import Interval
from twin.platform import Platform
from twin.procedures.plan import length
from twin.recording import Recording
from twin.signals import Estimate

Array = NDArray[np.float64]

CORNER = 1.0
"""Of the low-pass before the observed torque [Hz]."""
EDGE = 2.0
"""What the filter spoils at either end [s]."""


@dataclass(frozen=True)
class Statement:
    """Of one run, at the masses' last positions."""

    center_of_mass_offset: tuple[Interval, Interval, Interval]
    """m r along x, y, z [kg m, body]."""
    residual_torque: Interval
    """g |m r|, at the worst attitude [N m]."""
    residual_torque_in_plane: Interval
    """g |m r_xy|, of the level body [N m]."""
    residual_torque_observed: float
    """95th percentile of |J dw/dt + w x H + dh/dt| while it floated free [N m]."""
    stage_position: Array
    """(stages,) where the masses stand [m]."""
    misfit: Misfit
    """What the model leaves of the logs; more than noise, and the intervals do not know why."""

    def document(self) -> Mapping[str, Any]:
        """For `--json`."""
        axes = [axis.document() for axis in self.center_of_mass_offset]
        return {
            "residual_torque": {**self.residual_torque.document(), "unit": "N m"},
            "residual_torque_in_plane": {**self.residual_torque_in_plane.document(), "unit": "N m"},
            "residual_torque_observed": {"value": self.residual_torque_observed, "unit": "N m"},
            "center_of_mass_offset": {
                **{part: [axis[part] for axis in axes] for part in ("value", "low", "high")},
                "unit": "kg m",
            },
            "stage_position": self.stage_position.tolist(),
            "chi2_per_sample": {
                "value": self.misfit.chi2_per_sample,
                "band": [self.misfit.low, self.misfit.high],
            },
        }


def state(
    platform: Platform,
    moment: Array,
    covariance: Array,
    quantile: float,
    observed: float,
    stage_position: Array,
    misfit: Misfit,
) -> Statement:
    """The statement on an identified m r (3,) with its covariance (3, 3)."""
    half = quantile * np.sqrt(np.diag(covariance))
    x, y, z = (
        Interval(v, v - h, v + h) for v, h in zip(moment.tolist(), half.tolist(), strict=True)
    )
    g = platform.gravity
    whole = Interval(*(g * s for s in length(moment, covariance, quantile)))
    plane = Interval(*(g * s for s in length(moment[:2], covariance[:2, :2], quantile)))
    return Statement((x, y, z), whole, plane, observed, stage_position, misfit)


def observed_torque(recording: Recording, platform: Platform, inertia: Array) -> float:
    """95th percentile of |J dw/dt + w x H + dh/dt| [N m], whatever the torque's cause.

    H = J w + h. Rates are low-passed at 1 Hz; the gyro's noise that passes is part of it, as in the
    source: the note on in-plane balancing by sliding masses and magnetorquers (paper 003 of
    docs/design.md), after its reference 13.
    """
    gyro = recording["gyro"]
    step = float(np.median(np.diff(gyro.time)))
    times = np.arange(gyro.time[0], gyro.time[-1], step)
    rate = gyro.interpolated_at(times)
    if "estimate_gyro_bias" in recording:
        rate = rate - recording["estimate_gyro_bias"].value[-1]
    sections = butter(2, CORNER, fs=1.0 / step, output="sos")
    rate = np.asarray(sosfiltfilt(sections, rate, axis=0), dtype=np.float64)
    momentum = rate @ inertia
    change = np.gradient(momentum, step, axis=0)
    held = _held(recording, platform, times)
    if held is not None:
        held = np.asarray(sosfiltfilt(sections, held, axis=0), dtype=np.float64)
        momentum = momentum + held
        change = change + np.gradient(held, step, axis=0)
    torque = np.linalg.norm(change + np.cross(rate, momentum), axis=1)
    inside = (times > times[0] + EDGE) & (times < times[-1] - EDGE)
    return float(np.percentile(torque[inside], 95.0))


def _held(recording: Recording, platform: Platform, times: Array) -> Array | None:
    """(m, 3) momentum of wheels or gyros relative to the body [N m s]; None without any."""
    if not (platform.wheels or platform.gimbals):
        return None
    m, still = len(times), np.zeros((len(times), 3))

    def read(name: str, width: int, otherwise: Array) -> Array:
        return (
            recording[name].interpolated_at(times)
            if name in recording
            else np.broadcast_to(otherwise, (m, width))
        )

    wheels = np.array([wheel.home for wheel in platform.wheels])
    homes = np.array([gimbal.home for gimbal in platform.gimbals])
    estimate = Estimate(
        time=0.0,
        attitude=np.tile([1.0, 0.0, 0.0, 0.0], (m, 1)),
        rate_body=still,
        wheel_speed=read("wheel_speed", len(wheels), wheels),
        stage_position=np.zeros((m, len(platform.stages))),
        joint_angle=np.zeros((m, 0)),
        joint_rate=np.zeros((m, 0)),
        gyro_bias=still,
        valid=np.ones(m, dtype=np.bool_),
        gimbal_angle=read("gimbal_angle", len(homes), homes),
    )
    return exchange_of(platform, "the observed torque").momentum(estimate)
