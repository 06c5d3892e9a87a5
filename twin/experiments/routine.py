"""Checks of every morning: a free float against the ones before it, and weights for its offset.

A free float of 60 to 120 s shows the torque that a table cannot hold still against. Its recording
is fitted with J held as stated: m r, a torque about the vertical (swirl of the bearing) and a
viscous friction are free, beside constant errors of sensors and the initial state. Each number is
then held against those of the earlier recordings on a control chart. The spread between recordings
beyond their intervals is the moment estimate of R. DerSimonian and N. Laird, Meta-analysis in
clinical trials, Controlled Clinical Trials 7 (1986); a number is out of control beyond three
standard deviations of a new one (W. A. Shewhart, 1931).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from twin.diagnosis.baseline import baseline_of, check_logs
from twin.diagnosis.experiment import SimulatedRun
from twin.diagnosis.explanation import explain
from twin.effects import effect_named
from twin.errors import TwinError, UsageError
from twin.identification.prediction_error import NORMAL
from twin.identification.start import base_of
from twin.interval import Interval
from twin.platform import Platform, in_gravity_of, load_platform, platform_of
from twin.predict.base import BaseParameters
from twin.predict.forces import predicted_machine
from twin.predict.logs import usable
from twin.recording import Recording, open_log
from twin.rotation import from_euler_zyx
from twin.shown import Shown

Array = NDArray[np.float64]
Say = Callable[[str], None]
LIMIT = 3.0
"""Standard deviations of a new recording beyond which a number is out of control."""
FEWEST = 2
"""Earlier recordings that a control limit needs."""
FLOAT = 90.0
"""Of a simulated free float [s]."""
TILT, TURN = 1.0, 0.3
"""Where it is let go from [deg], and how fast it turns about the vertical [deg/s]."""
WEIGHTS = (0.1, 0.2, 0.5, 1.0, 2.0)
"""That a trim proposes [kg]."""
BALANCED = 1e-3
"""Share of an offset that stages may leave and still be said to reach it."""
OF_TORQUES = ("bearing_swirl_torque", "bearing_viscous_friction")


@dataclass(frozen=True)
class FreeFloat:
    """What a recording says of a machine that floats."""

    source: str
    when: datetime
    """When it was recorded, or its file was written; of one in memory, now."""
    duration: float
    """[s]."""
    numbers: Mapping[str, Interval]
    """Half an interval is 1.96 standard deviations:

    - `mr_x`, `mr_y`, `mr_z` [kg m]: at the mean stage positions of the recording,
    - `residual_torque` [N m]: of gravity on the horizontal part of m r, at level,
    - `vertical_offset` [m]: mr_z over the mass,
    - `bearing_swirl_torque` [N m], `bearing_viscous_friction` [N m s]."""
    periods: tuple[float, ...]
    """Of the slower and the faster free swing about horizontal axes [s]; none above the CR."""
    misfit: float
    """Mean squared residual over that of noise."""
    stated: Mapping[str, float]
    """What the platform has for the same numbers."""


UNITS: Mapping[str, str] = {
    "mr_x": "kg m",
    "mr_y": "kg m",
    "mr_z": "kg m",
    "residual_torque": "N m",
    "vertical_offset": "m",
    "bearing_swirl_torque": "N m",
    "bearing_viscous_friction": "N m s",
}


@dataclass(frozen=True)
class ControlLimit:
    """Where a number of the next recording should lie."""

    middle: float
    spread: float
    """Standard deviation between recordings, beside their intervals."""
    low: float
    high: float
    inside: bool
    """Whether the last one does."""


@dataclass(frozen=True)
class Trend(Shown):
    """Free floats of a machine over time, and whether the last one departs from the others."""

    platform: Platform
    floats: tuple[FreeFloat, ...]
    """The earliest first; the last one is judged."""
    limits: Mapping[str, ControlLimit]
    """By number; none of fewer than `FEWEST` earlier recordings."""
    skipped: Mapping[str, str]
    """Why a recording is not used, by its name."""
    simulated: bool = False
    """Whether the last one is a simulation of the platform as stated."""

    @property
    def departures(self) -> tuple[str, ...]:
        """Numbers that are out of control."""
        return tuple(name for name, limit in self.limits.items() if not limit.inside)


def verify(
    platform: str | Path | Platform,
    recordings: Sequence[str | Path | Recording] = (),
    *,
    seed: int = 0,
    say: Say = lambda _: None,
) -> Trend:
    """Residual torque, period and vertical offset of a free float, against the earlier ones.

    Args:
        platform: the machine.
        recordings: of free floats; the latest is judged. None: one is simulated, which shows what
            the check could see.
        seed: of a simulated one.
        say: takes the name of each recording.

    Raises:
        UsageError: a recording from which the numbers cannot be had.
    """
    machine = platform if isinstance(platform, Platform) else load_platform(str(platform))
    _check_ball(machine)
    if not recordings:
        say("a simulated free float")
        roll, pitch = hanging(machine)
        stop = float(np.degrees(machine.stop_angle))
        angles = (np.array(np.radians(angle)) for angle in (0.0, pitch, roll))
        lean = float(np.degrees(machine.lean(from_euler_zyx(*angles))))
        if lean + TILT > stop:
            raise UsageError(
                f"{machine.name} as stated hangs at {lean:.1f} deg, beyond its stop at {stop:.1f} "
                "deg: it has no free float; trim it first (`twin trim`), or give recordings"
            )
        attitude = (roll + TILT, pitch + 0.6 * TILT, 0.0)
        run = SimulatedRun(machine, "free_float", FLOAT, attitude=attitude, rate=(0.0, 0.0, TURN))
        log, obstacle = run.attempt(machine, seed=seed)
        if obstacle:
            raise UsageError(f"a simulated free float of {machine.name} ends early: {obstacle}")
        made = free_float(log.without_truth(), machine, source="simulated")
        return Trend(machine, (made,), {}, {}, simulated=True)
    floats: list[FreeFloat] = []
    for item in recordings:
        log = item if isinstance(item, Recording) else open_log(Path(item))
        name = log.source if isinstance(item, Recording) else str(item)
        say(name)
        floats.append(free_float(log.without_truth(), machine, source=name))
    return trend(machine, floats)


def history(
    folder: str | Path, platform: str | Path | Platform | None = None, *, say: Say = lambda _: None
) -> Trend:
    """The trend of a machine over all recordings in a folder and below it.

    Args:
        folder: with .rrd files and folders with a log.toml.
        platform: the machine; None: the one that the first recording names. Recordings of other
            machines are skipped, and said.
        say: takes the name of each recording.

    Raises:
        UsageError: no folder, or no recording in it from which anything can be had.
    """
    where = Path(folder)
    if not where.is_dir():
        raise UsageError(f"{where} is no folder; give one with recordings")
    paths = sorted([*where.rglob("*.rrd"), *(path.parent for path in where.rglob("log.toml"))])
    if not paths:
        raise UsageError(
            f"{where} holds no recording: neither an .rrd nor a folder with a log.toml"
        )
    machine = None
    if platform is not None:
        machine = platform if isinstance(platform, Platform) else load_platform(str(platform))
    floats: list[FreeFloat] = []
    skipped: dict[str, str] = {}
    for path in paths:
        name = str(path.relative_to(where))
        say(name)
        try:
            log = open_log(path)
            of_log = platform_of(log)
            machine = machine or of_log
            if of_log.folder.resolve() != machine.folder.resolve():
                skipped[name] = f"it is of {of_log.name}"
                continue
            _check_ball(machine)
            floats.append(free_float(log.without_truth(), machine, source=str(path)))
        except TwinError as problem:
            skipped[name] = str(problem)
    if machine is None or not floats:
        reasons = "; ".join(f"{name}: {why}" for name, why in list(skipped.items())[:3])
        raise UsageError(f"nothing in {where} can be used: {reasons}")
    return replace(trend(machine, floats), skipped=skipped)


def trend(platform: Platform, floats: Sequence[FreeFloat]) -> Trend:
    """The last of some free floats, by time, on the control chart of the others."""
    ordered = sorted(floats, key=lambda item: item.when)
    *earlier, last = ordered
    limits: dict[str, ControlLimit] = {}
    if len(earlier) >= FEWEST:
        for name, interval in last.numbers.items():
            of = [item.numbers[name] for item in earlier if name in item.numbers]
            if len(of) >= FEWEST:
                limits[name] = control_limit(of, interval)
    return Trend(platform, tuple(ordered), limits, {})


def control_limit(earlier: Sequence[Interval], last: Interval) -> ControlLimit:
    """Limits for a number, from its earlier intervals.

    Args:
        earlier: at least `FEWEST`.
        last: the one that is judged.
    """
    value = np.array([item.value for item in earlier])
    variance = np.array([_deviation(item) ** 2 for item in earlier])
    weight = 1.0 / variance
    fixed = float(weight @ value / weight.sum())
    excess = float(weight @ np.square(value - fixed)) - (len(value) - 1)
    between = max(excess / float(weight.sum() - np.square(weight).sum() / weight.sum()), 0.0)
    weight = 1.0 / (variance + between)
    middle = float(weight @ value / weight.sum())
    reach = LIMIT * float(np.sqrt(between + _deviation(last) ** 2 + 1.0 / weight.sum()))
    inside = abs(last.value - middle) <= reach
    return ControlLimit(middle, float(np.sqrt(between)), middle - reach, middle + reach, inside)


def _deviation(interval: Interval) -> float:
    return max((interval.high - interval.low) / (2.0 * NORMAL), 1e-300)


def _check_ball(platform: Platform) -> None:
    if platform.base.kind != "ball" or platform.base.joint in platform.base.locked:
        raise UsageError(
            f"{platform.name} does not turn about a ball bearing: it has no free float; "
            "hold its logs against the model with `twin compare`"
        )


def free_float(recording: Recording, platform: Platform, *, source: str) -> FreeFloat:
    """The numbers of one recording, J held as stated.

    Raises:
        UsageError: the recording lacks the streams that the prediction needs.
    """
    machine = in_gravity_of([recording], platform)
    check_logs([recording], machine)
    log = usable(recording, machine)
    _, base = base_of(predicted_machine(machine), [log])
    base = _without_inertia(base)
    baseline = baseline_of([log], machine, base=base)
    stated_already = {effect.label for effect in baseline.bodies[0].machine.effects}
    kinds = [effect_named(name) for name in OF_TORQUES if name not in stated_already]
    effects = [kind.typical().absent() for kind in kinds]
    fitted = explain(baseline.bodies, base, effects, baseline.at) if effects else baseline
    moment = _moment(fitted.base.entries(fitted.at.theta)[6:], log, machine)
    covariance = fitted.base.map @ fitted.covariance[: len(base.names), : len(base.names)]
    of_moment = (covariance @ fitted.base.map.T)[6:, 6:]
    spread = np.sqrt(np.diag(of_moment))
    inflation = float(np.sqrt(max(fitted.account.inflation, 1.0)))
    numbers = {
        name: _interval(float(value), inflation * float(sd))
        for name, value, sd in zip(("mr_x", "mr_y", "mr_z"), moment, spread, strict=True)
    }
    across = moment[:2]
    size = float(np.linalg.norm(across))
    along = across / max(size, 1e-300)
    torque = machine.gravity * size
    sd = machine.gravity * float(np.sqrt(along @ of_moment[:2, :2] @ along)) * inflation
    numbers["residual_torque"] = Interval(
        torque, max(torque - NORMAL * sd, 0.0), torque + NORMAL * sd
    )
    numbers["vertical_offset"] = _interval(
        float(moment[2]) / machine.mass, inflation * float(spread[2]) / machine.mass
    )
    for effect, free, own in zip(fitted.effects, fitted.free, fitted.covariances, strict=True):
        if free.all():
            sd = inflation * float(np.sqrt(own[0, 0]))
            numbers[effect.label] = _interval(float(effect.values[0]), sd)
    stated = _moment(machine.center_of_mass_offset, log, machine)
    samples = fitted.prediction.residual[fitted.prediction.cluster >= 0]
    return FreeFloat(
        source,
        _when(recording),
        recording.stop - recording.start,
        numbers,
        periods(machine, moment),
        float(samples @ samples) / max(fitted.samples, 1),
        {
            "mr_x": float(stated[0]),
            "mr_y": float(stated[1]),
            "mr_z": float(stated[2]),
            "residual_torque": machine.gravity * float(np.linalg.norm(stated[:2])),
            "vertical_offset": float(stated[2]) / machine.mass,
        },
    )


def _without_inertia(base: BaseParameters) -> BaseParameters:
    """J held as stated: a float that nothing drives tells it but for a common factor."""
    while any(name.startswith("J") for name in base.names):
        base = base.without(next(i for i, name in enumerate(base.names) if name[0] == "J"))
    return base


def _moment(moment: Array, log: Recording, platform: Platform) -> Array:
    """m r with the stages where they stand in a log in the mean."""
    if not platform.stages or "stage_position" not in log or not len(log["stage_position"]):
        return moment
    position = log["stage_position"].value.mean(axis=0)
    mass = np.array([stage.mass for stage in platform.stages])
    axes = np.stack([stage.axis for stage in platform.stages])
    return moment + (mass * position) @ axes


def _interval(value: float, deviation: float) -> Interval:
    return Interval(value, value - NORMAL * deviation, value + NORMAL * deviation)


def _when(recording: Recording) -> datetime:
    started = recording.provenance.get("started")
    if isinstance(started, str):
        return datetime.fromisoformat(started).replace(tzinfo=None)
    path = Path(recording.source)
    file = path / "log.toml" if path.is_dir() else path
    return datetime.fromtimestamp(file.stat().st_mtime) if file.exists() else datetime.now()


def hanging(platform: Platform) -> tuple[float, float]:
    """Roll and pitch at which a machine hangs [deg]; level where its CM is not below the CR."""
    x, y, z = platform.center_of_mass_offset
    if z >= 0.0:
        return 0.0, 0.0
    # the vertical in body axes, R^T z = (-sin pitch, cos pitch sin roll, cos pitch cos roll)
    up = -np.array([x, y, z]) / np.linalg.norm([x, y, z])
    return float(np.degrees(np.arctan2(up[1], up[2]))), float(np.degrees(-np.arcsin(up[0])))


def periods(platform: Platform, moment: Array) -> tuple[float, ...]:
    """Periods of the small free swings about where it hangs [s], the slowest first; none where the
    CM is not below the CR.

    Of J th'' = -g |m r| (1 - u u^T) th, u the direction of m r.
    """
    size = float(np.linalg.norm(moment))
    if moment[2] >= 0.0:
        return ()
    across = np.eye(3) - np.outer(moment, moment) / size**2
    squares = np.real(np.linalg.eigvals(np.linalg.solve(platform.inertia, across)))
    swings = np.sqrt(platform.gravity * size * np.sort(squares)[1:])
    return tuple((2.0 * np.pi / swings).tolist())


@dataclass(frozen=True)
class AddedMass:
    """A point mass that is fixed to the bus."""

    mass: float
    """[kg]."""
    position: Array
    """(3,) from the CR, body axes [m]."""


@dataclass(frozen=True)
class Trim(Shown):
    """Where the centre of mass is, what the sliding masses undo of it, and which weight the rest
    needs."""

    platform: Platform
    """With the masses that were added."""
    added: tuple[AddedMass, ...]
    moment: Array
    """(3,) m r with the stages at 0 [kg m]."""
    source: str
    """Of m r: the platform, or a recording."""
    target: Array
    """(3,) m r that is wanted [kg m]."""
    stages: Array
    """(stages,) positions that come nearest [m]."""
    rest: Array
    """(3,) m r that they leave beside the target [kg m]."""
    reach: Array
    """(3, 2) lowest and highest change of m r by the stages [kg m]."""
    weights: tuple[AddedMass, ...]
    """Each by itself takes the rest away; empty where the stages do."""

    @property
    def periods(self) -> tuple[float, ...]:
        """Of the free swings once it is trimmed [s]."""
        left = self.rest if not self.weights else np.zeros(3)
        return periods(self.platform, self.target + left)


def trim(
    platform: str | Path | Platform,
    *,
    recording: str | Path | Recording | None = None,
    add: Sequence[Sequence[float]] = (),
    below: float = 0.0,
    say: Say = lambda _: None,
) -> Trim:
    """Which weight where: what sliding masses undo of an offset, and what the rest needs.

    Args:
        platform: the machine.
        recording: a free float from which m r is taken; None: the platform's own.
        add: masses that are fixed to it, each (mass [kg], x, y, z [m]) from the CR, body axes.
        below: how far below the CR the CM is to be [m].
        say: takes the name of each step.

    Raises:
        UsageError: a mass that is not positive, or a recording that cannot be used.
    """
    machine = platform if isinstance(platform, Platform) else load_platform(str(platform))
    _check_ball(machine)
    source = machine.name
    if recording is not None:
        log = recording if isinstance(recording, Recording) else open_log(Path(recording))
        source = log.source
        say(source)
        made = free_float(log.without_truth(), machine, source=source)
        there = np.array([made.numbers[f"mr_{axis}"].value for axis in "xyz"])
        zero = there - _moment(np.zeros(3), usable(log, machine), machine)
        machine = replace(machine, center_of_mass_offset=zero)
    masses = tuple(_added(entry) for entry in add)
    for item in masses:
        machine = with_mass(machine, item)
    target = np.array([0.0, 0.0, -below * machine.mass])
    stages, rest = _balanced(machine, target)
    axes, low, high = _stage_columns(machine)
    ends = np.stack([axes * low, axes * high]) if len(low) else np.zeros((2, 3, 0))
    reach = np.stack([ends.min(axis=0).sum(axis=1), ends.max(axis=0).sum(axis=1)], axis=1)
    size = float(np.linalg.norm(machine.center_of_mass_offset - target))
    enough = float(np.linalg.norm(rest)) <= max(BALANCED * size, 1e-9)
    weights = () if enough else tuple(AddedMass(mass, -rest / mass) for mass in WEIGHTS)
    return Trim(
        machine,
        masses,
        machine.center_of_mass_offset,
        source,
        target,
        stages,
        rest,
        reach,
        weights,
    )


def _added(entry: Sequence[float]) -> AddedMass:
    if len(entry) != 4 or not np.all(np.isfinite(entry)):
        raise UsageError(
            f"a mass that is added has four numbers, kg and x, y, z in m, not {len(entry)}"
        )
    mass, *position = entry
    if mass <= 0.0:
        raise UsageError(f"a mass that is added is {mass:g} kg; give one above 0")
    return AddedMass(mass, np.array(position))


def with_mass(platform: Platform, added: AddedMass) -> Platform:
    """A machine with a point mass: J += m (r^2 1 - r r^T), m r += m r."""
    r = added.position
    return replace(
        platform,
        mass=platform.mass + added.mass,
        inertia=platform.inertia + added.mass * (float(r @ r) * np.eye(3) - np.outer(r, r)),
        center_of_mass_offset=platform.center_of_mass_offset + added.mass * r,
    )


def _stage_columns(platform: Platform) -> tuple[Array, Array, Array]:
    """(3, stages) change of m r a metre, and the lowest and highest positions."""
    if not platform.stages:
        return np.zeros((3, 0)), np.zeros(0), np.zeros(0)
    axes = np.stack([stage.mass * stage.axis for stage in platform.stages], axis=1)
    low, high = np.array([stage.travel for stage in platform.stages]).T
    return axes, low, high


def _balanced(platform: Platform, target: Array) -> tuple[Array, Array]:
    """Stage positions that bring m r nearest to a target within their travel, and the rest."""
    axes, low, high = _stage_columns(platform)
    offset = platform.center_of_mass_offset - target
    if not len(low):
        return np.zeros(0), offset
    solved = lsq_linear(axes, -offset, bounds=(low, high), method="bvls")
    position = np.asarray(solved.x, dtype=np.float64)
    return position, offset + axes @ position
