"""Phases of a balancing, its next move, its notes and its statement.

What to do about an identified mass moment: done, a move, or a better look.
Vertical balancing comes from below: with the CM above the CR the body falls over. So the height
is raised by at most half of what is left, identified anew after each step, and kept where m r_z and
three standard deviations stay below zero by a margin.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt
from scipy.stats import chi2

from twin.controller.exchange import exchange_of
from twin.identification import Misfit
from twin.interval import Interval
from twin.platform import Platform
from twin.recording import Recording
from twin.signals import Estimate

Array = NDArray[np.float64]


MARGIN = 0.2
"""By which the CM stays below the CR, in parts of the mass moment that the target allows."""
AIM = 0.5
"""Height that is aimed at, below the CR, in the same parts."""
WORTH = 0.25
"""Height by which a further step must raise the CM where the target is kept already, in the same
parts: so a balancing ends where it was aimed, and not wherever it first does well enough."""
SIGMAS = 3.0
"""Standard deviations that the CM stays below the CR besides."""
KNOWN = 0.2
"""Standard deviation of m r_z, in parts of itself or of the target's, that is good enough to move
by."""


@dataclass(frozen=True)
class Aim:
    """What is to be reached."""

    torque: float
    """Gravity torque that may be left at the worst attitude [N m]."""
    gravity: float
    """[m/s^2]."""

    @property
    def moment(self) -> float:
        """m r that may be left [kg m]."""
        return self.torque / self.gravity

    def is_known(self, moment: Array, covariance: Array) -> bool:
        """Whether m r (3,) with its covariance (3, 3) is good enough to move by."""
        size = max(float(np.linalg.norm(moment)), AIM * self.moment)
        worst = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        return worst < KNOWN * size

    def is_kept(self, moment: Array, covariance: Array, quantile: float) -> bool:
        """Whether the upper end of the interval keeps the target and the CM is surely below."""
        low = -MARGIN * self.moment
        below = moment[2] + SIGMAS * float(np.sqrt(covariance[2, 2])) <= low
        _, _, high = length(moment, covariance, quantile)
        return bool(below and high <= self.moment)

    def is_worth(self, change: Array) -> bool:
        """Whether a change (3,) of m r raises the CM by so much that a kept target is no reason to
        leave it."""
        return bool(change[2] > WORTH * self.moment)

    def change(self, moment: Array, covariance: Array, *, in_plane: bool) -> Array:
        """(3,) mass moment to add [kg m]: all of it in the plane, the height from below.

        Args:
            moment: (3,) m r [kg m].
            covariance: (3, 3) of it.
            in_plane: whether the masses, rather than a law, bring the CM under the CR.
        """
        sigma = float(np.sqrt(covariance[2, 2]))
        goal = -max(AIM * self.moment, MARGIN * self.moment + SIGMAS * sigma)
        height = float(moment[2])
        raised = goal if height > goal else min(goal, 0.5 * height)
        across = -moment[:2] if in_plane else np.zeros(2)
        return np.array([*across, raised - height])


def length(vector: Array, covariance: Array, quantile: float) -> tuple[float, float, float]:
    """|vector| of a vector (k,) that is known to a covariance (k, k), and its interval.

    |v| is too long where v is small, since errors across it only ever lengthen it: on average
    |v|^2 = |truth|^2 + tr C. So the low end is that of the component along v, what lies across
    taken off, and it is 0 where the k-dimensional 95 % region of v holds the origin. The high end
    bounds |u| in the ellipsoid (u - v)^T C^-1 (u - v) <= quantile^2: to first order it is the
    component's, too, and it is longer where another direction is known far worse.

    It is the project's own. Drawn (k = 2, 3; axes known alike to 30 times worse; truths of 0 to 5
    standard deviations) it holds the truth 93 times in 100 or more: 94 to 98 with axes alike, and
    up to always for a truth along the best known of axes that are not.
    """
    size = float(np.linalg.norm(vector))
    turned = float(np.sqrt(vector @ covariance @ vector))
    worst = float(np.linalg.eigvalsh(covariance)[-1])
    high = float(np.sqrt(size**2 + 2.0 * quantile * turned + quantile**2 * worst))
    if size == 0.0 or _may_be_nothing(vector, covariance, quantile):
        return size, 0.0, high
    along = turned / size
    across = float(np.trace(covariance)) - along**2
    low = float(np.sqrt(max(size**2 - across, 0.0))) - quantile * along
    return size, max(low, 0.0), high


def _may_be_nothing(vector: Array, covariance: Array, quantile: float) -> bool:
    """Whether v^T C^-1 v is within its 95 %, also of a C without an inverse: c C >= v v^T."""
    edge = quantile**2 * chi2.ppf(0.95, len(vector)) / chi2.ppf(0.95, 1)
    return bool(np.linalg.eigvalsh(edge * covariance - np.outer(vector, vector))[0] >= 0.0)


class Phase(IntEnum):
    """What a run is doing; the numbers stand in the procedure's state, (n,)."""

    lower = 0
    settle = 1
    level = 2
    nudge = 3
    back = 4
    swing = 5
    identify = 6
    move = 7
    verify = 8
    judge = 9
    done = 10
    stopped = 11


WORDS: dict[Phase, str] = {
    Phase.lower: "the vertical mass goes to its lower end, so that the body hangs",
    Phase.settle: "away from the stop and at rest",
    Phase.level: "the law brings the CM under the CR",
    Phase.nudge: "masses aside, to make it swing",
    Phase.back: "and back",
    Phase.swing: "swinging, hardly damped; recorded",
    Phase.identify: "held while J and m r are identified",
    Phase.move: "masses go to where the CM should be",
    Phase.verify: "floating free; recorded",
    Phase.judge: "held while what is left is identified",
    Phase.done: "balanced",
    Phase.stopped: "stopped: masses hold, nothing else acts",
}

OVER = (Phase.done, Phase.stopped)
"""A run leaves these no more."""


def among(phase: NDArray[np.int64], phases: tuple[Phase, ...]) -> NDArray[np.bool_]:
    """(n,) mask of the runs whose phase is one of these; called at every tick."""
    return _mask_of(phases)[phase]


@cache
def _mask_of(phases: tuple[Phase, ...]) -> NDArray[np.bool_]:
    return np.isin(np.arange(len(Phase)), phases)


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


class Remark(NamedTuple):
    """What is said of a run."""

    run: int
    time: float
    """[s]."""
    words: str


@dataclass
class RunNotes:
    """Of one run."""

    phase: Phase = Phase.lower
    since: float = 0.0
    """[s]."""
    identified: int = 0
    """How many times its offset was."""
    said: list[Remark] = field(default_factory=list[Remark])
    """In the order of time."""
    reason: str = ""
    """Why it was stopped; empty unless it was."""
    statement: Statement | None = None
    """Of the machine as it stands: once it is balanced, or stopped where it was judged."""


class Notes:
    """Notes of n runs; each remark is handed on as it is made."""

    def __init__(self, n: int, tell: Callable[[Remark], None] | None = None) -> None:
        self.runs = [RunNotes() for _ in range(n)]
        self._tell = tell

    def begin(self, run: int, phase: Phase, time: float) -> None:
        """A phase starts."""
        notes = self.runs[run]
        notes.phase, notes.since = phase, time
        if phase not in OVER:
            # the masses move on, and what was said of where they stood is true no more
            notes.statement = None
        self.say(run, time, f"{phase.name}: {WORDS[phase]}")

    def say(self, run: int, time: float, words: str) -> None:
        """One remark."""
        remark = Remark(run, time, words)
        self.runs[run].said.append(remark)
        if self._tell is not None:
            self._tell(remark)

    def stop(self, run: int, time: float, reason: str) -> None:
        """It cannot go on."""
        self.runs[run].reason = reason
        self.runs[run].phase, self.runs[run].since = Phase.stopped, time
        self.say(run, time, f"stopped: {reason}")

    @property
    def over(self) -> bool:
        """Whether all runs have ended."""
        return all(run.phase in OVER for run in self.runs)
