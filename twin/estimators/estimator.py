"""What an estimator is: samples in, one `Estimate` out, for one run or a thousand."""

import abc
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.platform import Platform
from twin.rotation import IDENTITY
from twin.signals import POSITIONS, Command, Estimate, Mask, Reading, Samples

Array = NDArray[np.float64]


@dataclass(slots=True, kw_only=True)
class OffsetEstimate(Estimate):
    """An estimate that tells where the CM is, too."""

    center_of_mass_offset: Array
    """(n, 3) m r from CR to CM with the stages where they are, body axes [kg m]."""
    offset_covariance: Array
    """(n, 3, 3) of it [kg^2 m^2]."""


class Estimator(abc.ABC):
    """A frozen dataclass of settings; what it remembers is the `Estimate`, or a subclass of it."""

    @abc.abstractmethod
    def init(self, platform: Platform, n: int) -> Estimate:
        """The estimate before the first sample; `valid` is False.

        Raises:
            UsageError: the platform lacks the sensors that it needs.
        """

    @abc.abstractmethod
    def update(self, estimate: Estimate, reading: Reading) -> Estimate:
        """The estimate at `reading.time`, from all samples that arrived since the last one."""

    def told(self, estimate: Estimate, applied: Command) -> Estimate:
        """The same estimate, knowing what is applied from its tick on; most have no use for it."""
        del applied
        return estimate


def blank(platform: Platform, n: int) -> Estimate:
    """The estimate of a machine that nobody has looked at: level, at rest, not valid."""
    hinges = int(platform.base.kind == "hinge")
    return Estimate(
        time=0.0,
        attitude=np.tile(IDENTITY, (n, 1)),
        rate_body=np.zeros((n, 3)),
        wheel_speed=np.zeros((n, len(platform.wheels))),
        stage_position=np.zeros((n, len(platform.stages))),
        gimbal_angle=np.tile([gimbal.home for gimbal in platform.gimbals], (n, 1)),
        joint_angle=np.zeros((n, hinges)),
        joint_rate=np.zeros((n, hinges)),
        gyro_bias=np.zeros((n, 3)),
        valid=np.zeros(n, dtype=np.bool_),
        oriented=np.zeros(n, dtype=np.bool_),
        awaited={
            name: np.ones(n, dtype=np.bool_) for name in POSITIONS if name in platform.sensors
        },
    )


def shared(estimate: Estimate) -> dict[str, Any]:
    """By name, what every estimate has: for one that tells more."""
    return {entry.name: getattr(estimate, entry.name) for entry in fields(Estimate)}


def need_floating_body(platform: Platform, estimator: str) -> None:
    """An estimator of mass properties needs gyro and attitude of a body on a ball.

    Raises:
        UsageError: the platform lacks them.
    """
    missing = [name for name in ("gyro", "attitude") if name not in platform.sensors]
    if missing or platform.base.kind != "ball":
        lack = f"has no {' and no '.join(missing)}" if missing else "hangs on no ball"
        raise UsageError(
            f"the estimator {estimator!r} needs gyro and attitude of a body on a ball, and "
            f"{platform.name} {lack}; {instead(platform)}"
        )


def instead(platform: Platform) -> str:
    """What would do where an estimator lacks its sensors: one that these sensors make valid."""
    if {"attitude", "joint_angle"} & set(platform.sensors):
        return "use the estimator 'passthrough'"
    if "inclinometer" in platform.sensors:
        return "use the estimator 'inclinometer'"
    shown = "joint_angle" if platform.base.kind == "hinge" else "attitude"
    return f"no estimator knows how it stands: give it [sensors.{shown}]"


def still_awaited(streams: Mapping[str, Samples], before: Estimate) -> Mapping[str, Mask]:
    """What is awaited after these samples."""
    left = {
        name: missing & ~streams[name].valid.any(axis=1) if name in streams else missing
        for name, missing in before.awaited.items()
    }
    return {name: missing for name, missing in left.items() if missing.any()}


def seen(oriented: Mask, awaited: Mapping[str, Mask]) -> Mask:
    """Runs (n,) that are oriented and wait for no position."""
    for missing in awaited.values():
        oriented = oriented & ~missing
    return oriented


def encoders(streams: Mapping[str, Samples], before: Estimate) -> dict[str, Any]:
    """Newest of what wheels, stages and gimbals show, as fields of an estimate."""
    return {
        name: newest(streams.get(name), getattr(before, name))
        for name in ("wheel_speed", "stage_position", "gimbal_angle")
    }


def newest(samples: Samples | None, held: Array) -> Array:
    """Last valid sample of each run, shape (n, k); `held` where there is none."""
    if samples is None:
        return held
    value, valid = samples.value, samples.valid
    if valid[:, -1].all():
        return value[:, -1]
    # The first valid one from the back; where none is, argmax points at an invalid one.
    last = valid.shape[1] - 1 - valid[:, ::-1].argmax(axis=1)
    rows = np.arange(len(valid))
    return np.where(valid[rows, last][:, None], value[rows, last], held)
