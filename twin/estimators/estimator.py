"""What an estimator is: samples in, one `Estimate` out, for one run or a thousand."""

import abc
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.platform import Platform, Sensor
from twin.rotation import IDENTITY
from twin.signals import POSITIONS, Command, Estimate, Mask, Quantity, Reading, Samples

Array = NDArray[np.float64]


@dataclass(slots=True, kw_only=True)
class OffsetEstimate(Estimate):
    """An estimate that tells where the CM is, too."""

    center_of_mass_offset: Array
    """(n, 3) m r from CR to CM with the stages where they are, body axes [kg m]."""
    offset_covariance: Array
    """(n, 3, 3) of it [kg^2 m^2]."""

    def quantities(self) -> dict[str, Quantity]:
        """m r."""
        sigma = np.sqrt(np.diagonal(self.offset_covariance, axis1=1, axis2=2))
        offset = Quantity(self.center_of_mass_offset, sigma, "kg m", ("x", "y", "z"))
        return {"center_of_mass_offset": offset}


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

    def with_command(self, estimate: Estimate, applied: Command) -> Estimate:
        """The same estimate, knowing what is applied from its tick on; most have no use for it."""
        del applied
        return estimate

    def shows(self, platform: Platform) -> frozenset[str]:
        """Which of "attitude" (how it leans), "heading" and "rate" it tells of this machine."""
        del platform
        return frozenset(("attitude", "heading", "rate"))

    def remarks(self, estimate: Estimate) -> list[str]:
        """What its user should know of the sensors at the end of a run, a sentence each."""
        del estimate
        return []


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
    if {"gyro", "accelerometer"} <= set(platform.sensors):
        return "use the estimator 'mekf'"
    shown = "joint_angle" if platform.base.kind == "hinge" else "attitude"
    return f"no estimator knows how it stands: give it [sensors.{shown}]"


def still_awaited(streams: Mapping[str, Samples], before: Estimate) -> Mapping[str, Mask]:
    """What is awaited after these samples."""
    left = {
        name: missing & ~streams[name].valid.any(axis=1) if name in streams else missing
        for name, missing in before.awaited.items()
    }
    return {name: missing for name, missing in left.items() if missing.any()}


def ready_runs(oriented: Mask, awaited: Mapping[str, Mask]) -> Mask:
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


def variance_of(sensor: Sensor) -> Array:
    """(k,) of a sample; a perfect sensor is taken as good to 1e-7 of its unit."""
    return np.maximum(sensor.noise**2 + sensor.resolution**2 / 12.0, 1e-14)


class Agility(NamedTuple):
    """How fast a machine's rate can change: dw/dt <= at_rest + by_rate |w| + by_square |w|^2."""

    at_rest: float
    """By torques [rad/s^2]."""
    by_rate: float = 0.0
    """By the momentum of its rotors [1/s]."""
    by_square: float = 0.0
    """By its own turning [-]."""

    def at(self, rate: Array) -> Array:
        """(n, 1) [rad/s^2] at rates (n, 3)."""
        size = np.sqrt(np.einsum("ni,ni->n", rate, rate))[:, None]
        return self.at_rest + size * (self.by_rate + size * self.by_square)


def agility_of(platform: Platform) -> Agility:
    """What a machine's own actuators, weight and momentum can do to its rate.

    The largest torque of all of them together over the smallest principal moment of inertia, and
    twice that, for what is stated of a machine is not exact. Hands and stops do more.
    """
    momentum = sum(abs(rotor.momentum) for rotor in platform.rotors)
    momentum += sum(wheel.momentum_limit for wheel in platform.wheels)
    moments = np.linalg.eigvalsh(platform.inertia)
    smallest = float(moments[0])
    spread = float(moments[2] - moments[0])  # |w x J w| <= spread |w|^2 / 2
    return Agility(
        2.0 * platform.largest_torque / smallest, 2.0 * momentum / smallest, spread / smallest
    )


def scatter_of(variance: Array) -> Array:
    """(3,) by which two samples of a gyro may differ by noise alone, of its variances (3,).

    Six sigmas of a difference: one good sample in 10^9 is refused.
    """
    return 6.0 * np.sqrt(2.0 * variance)


def accepted_rates(
    value: Array,
    held: Array,
    shown: Array,
    step: Array,
    variance: Array,
    agility: Agility,
) -> Mask:
    """Runs (n,) whose gyro sample is no lone spike.

    A rate changes by no more than the machine can do, or else the next sample confirms it, as after
    a blow against the stop. A sample is refused that is farther than that from the last one; of two
    in a row the second never is, so that a gyro noisier than stated loses samples and no more.

    Args:
        value: (n, 3) the sample [rad/s].
        held: (n, 3) last one that was accepted.
        shown: (n, 3) last one that came.
        step: (n,) since `held` [s].
        variance: (3,) of a sample.
        agility: of the machine.
    """
    margin = agility.at(held) * np.maximum(step, 0.0)[:, None] + scatter_of(variance)
    with np.errstate(invalid="ignore"):
        near = np.abs(value - held) <= margin
    return np.asarray(near.all(axis=1) | (held != shown).any(axis=1))


@dataclass(frozen=True)
class Passthrough(Estimator):
    """No model, and no memory but the last sample: a late one is taken as if it were of now.

    The gyro's bias stays in the rate.
    """

    def init(self, platform: Platform, n: int) -> Estimate:
        """Level and at rest, not valid."""
        return blank(platform, n)

    def shows(self, platform: Platform) -> frozenset[str]:
        """What sensors show as it is."""
        sensors = set(platform.sensors)
        oriented = ("attitude", "heading") if {"attitude", "joint_angle"} & sensors else ()
        return frozenset((*oriented, *["rate"] * bool({"gyro", "joint_rate"} & sensors)))

    def update(self, estimate: Estimate, reading: Reading) -> Estimate:
        """Valid from a run's first attitude, or joint angle on a hinge, and first positions."""
        streams, valid = reading.streams, estimate.valid
        oriented, awaited = estimate.oriented, estimate.awaited
        if not valid.all():
            for name in ("attitude", "joint_angle"):
                if name in streams:
                    oriented = oriented | streams[name].valid.any(axis=1)
            awaited = still_awaited(streams, estimate)
            valid = ready_runs(oriented, awaited)
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
