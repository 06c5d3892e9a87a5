"""The sensors as they are: the newest valid sample of each stream is the estimate."""

from dataclasses import dataclass

from twin.estimators.estimator import Estimator, blank, newest, seen, still_awaited
from twin.platform import Platform
from twin.signals import Estimate, Reading


@dataclass(frozen=True)
class Passthrough(Estimator):
    """No model, and no memory but the last sample: a late one is taken as if it were of now.

    The gyro's bias stays in the rate.
    """

    def init(self, platform: Platform, n: int) -> Estimate:
        """Level and at rest, not valid."""
        return blank(platform, n)

    def update(self, estimate: Estimate, reading: Reading) -> Estimate:
        """Valid from a run's first attitude, or joint angle on a hinge, and first positions."""
        streams, valid = reading.streams, estimate.valid
        oriented, awaited = estimate.oriented, estimate.awaited
        if not valid.all():
            for name in ("attitude", "joint_angle"):
                if name in streams:
                    oriented = oriented | streams[name].valid.any(axis=1)
            awaited = still_awaited(streams, estimate)
            valid = seen(oriented, awaited)
        return Estimate(
            time=reading.time,
            attitude=newest(streams.get("attitude"), estimate.attitude),
            rate_body=newest(streams.get("gyro"), estimate.rate_body),
            wheel_speed=newest(streams.get("wheel_speed"), estimate.wheel_speed),
            stage_position=newest(streams.get("stage_position"), estimate.stage_position),
            gimbal_angle=newest(streams.get("gimbal_angle"), estimate.gimbal_angle),
            joint_angle=newest(streams.get("joint_angle"), estimate.joint_angle),
            joint_rate=newest(streams.get("joint_rate"), estimate.joint_rate),
            gyro_bias=estimate.gyro_bias,
            valid=valid,
            oriented=oriented,
            awaited=awaited,
        )
