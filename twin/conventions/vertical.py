"""The attitude against the accelerometer and the magnetometer, which needs no gyro: what is felt
points up, and the field stays as it is in the room.

An accelerometer is mounted askew and has a bias, so that a constant difference in body axes counts
little. It must lean when the attitude does.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.conventions.correction import (
    LATE,
    SIMPLE,
    Correction,
    FrameCorrection,
    attitude_changes,
    axes_changes,
    frames_of,
    lag_change,
    read_angles,
    signed_permutations,
)
from twin.conventions.evidence import (
    ConventionFinding,
    choose,
    evidence,
    findings_of,
    inflation,
    no_fit,
    words_of,
)
from twin.conventions.gravity import Upright, Vertical, shaken_by
from twin.conventions.grid import CellGrid, grid_of
from twin.conventions.hypothesis import AttitudeReading, Hypothesis
from twin.conventions.room_vectors import (
    CLOSE,
    COARSE,
    Seen,
    VectorBesideAttitude,
    affordable,
    best_of,
    least_of,
    relative_axes,
    room_vector,
)
from twin.conventions.turning import COMMON, NEAR, Turning, far_lags, vector_axes
from twin.recording import Recording, Series

Array = NDArray[np.float64]


DEAREST = 20.0
"""No hypothesis whose axes cost more is looked at [nats]."""
ALIKE = 6.0
"""Other axes of an accelerometer within this of the best ones are looked at too [nats] ..."""
FORCES = 3
"""... so many in all."""

Axes = tuple[Array, Correction | None]
"""Axes of a stream before the frame is turned, and the correction to them."""
Orientation = tuple[FrameCorrection, Array, Correction | None]
"""A frame, what it and a correction before it make of the quaternion (4, 4), and the correction."""
Force = tuple[Array, Correction | None, float]
"""Total axes of an accelerometer, the correction before the frame, and their misfit [nats]."""

PLACE = {axes.tobytes(): index for index, axes in enumerate(signed_permutations(3))}


def motion_hypotheses(
    recording: Recording, turning: Turning, upright: Upright | None
) -> Iterator[Hypothesis]:
    """Every frame with every reading of the attitude and every axes of the gyro, each in step, and
    with the one or the other late; the log as read among them."""
    gyros = list(axes_changes(recording, "gyro"))
    felt = upright is not None and upright.has_accelerometer
    forces = list(axes_changes(recording, "accelerometer")) if felt else []
    options = list(orientations(recording)), gyros, forces
    for change, series in read_angles(recording):
        turned, up = turning, upright
        if change is not None:
            turned, up = turning.with_attitude(series), upright and upright.with_attitude(series)
        yield from _hypotheses(AttitudeReading(change, series, turned, up), *options)


def _hypotheses(
    reading: AttitudeReading,
    turns: Sequence[Orientation],
    gyros: Sequence[Axes],
    felt: Sequence[Axes],
) -> Iterator[Hypothesis]:
    turning, upright = reading.turning, reading.upright
    near, lags = turning.match(NEAR), far_lags(turning.grid.longest_lag)
    matches = [("", near)]
    if len(lags):
        far = turning.match(lags)
        matches += [("gyro", far), ("attitude", far)]
    for frame, attitude, attitude_change in turns:
        family, turned = vector_axes(attitude)
        lean = upright.penalty(attitude) if upright is not None else 0.0
        forces = _forces(upright, felt, frame, attitude)
        for axes, gyro_change in gyros:
            before = [reading.change, attitude_change, gyro_change]
            before = [change for change in before if change is not None]
            least = lean + frame.cost + sum(change.cost for change in before)
            if before and least > DEAREST:
                continue
            gyro = frame.vector @ axes
            index = family, place_of(turned.T @ gyro)
            for force, force_change, force_misfit in forces:
                own = before if force_change is None else [*before, force_change]
                cost = least if force_change is None else least + force_change.cost
                if own and cost > DEAREST:
                    continue
                for late, match in matches:
                    lag = float(match.lag[index])
                    lag = -lag if late == "attitude" else lag
                    clock = lag_change(late, lag) if late else None
                    yield Hypothesis(
                        corrections=(*own, *frame.corrections, *([clock] if clock else [])),
                        cost=cost + (LATE if late else 0.0),
                        misfit=0.5 * float(match.misfit[index]) + force_misfit,
                        reading=reading,
                        attitude=attitude,
                        gyro=gyro,
                        force=force,
                        gyro_lag=0.0 if late == "attitude" else lag,
                        attitude_lag=lag if late == "attitude" else 0.0,
                    )


def orientations(recording: Recording) -> Iterator[Orientation]:
    """Every frame with every reading of the attitude."""
    changes = list(attitude_changes(recording))
    for frame in frames_of(recording):
        for attitude, change in changes:
            yield frame, frame.attitude @ attitude + 0.0, change


def place_of(axes: Array) -> int:
    """Where a signed permutation (3, 3) stands among all of them."""
    return PLACE[(axes + 0.0).tobytes()]


def _forces(
    upright: Upright | None, read: Sequence[Axes], frame: FrameCorrection, attitude: Array
) -> list[Force]:
    """The accelerometer in no other axes than the frame's, and in its best axes beside that: those
    that fit alike."""
    if upright is None or not read:
        return [(frame.vector, None, 0.0)]
    misfit = 0.5 * upright.match(attitude)
    total = [(frame.vector @ axes, change) for axes, change in read]
    as_read, *others = [(axes, change, float(misfit[place_of(axes)])) for axes, change in total]
    scores = [force[2] + (force[1].cost if force[1] else 0.0) for force in others]
    near = min(scores) + ALIKE
    ranked = sorted(zip(scores, range(len(others)), strict=True))[:FORCES]
    return [as_read, *(others[k] for score, k in ranked if score < near)]


ASTRAY = np.radians(30.0)
"""A reading whose acceleration is in the median further from upright fits nothing [rad]."""
UPSIDE_DOWN = SIMPLE
"""What an attitude of a machine that stands on its head costs a reading [nats]."""


class Field:
    """One reading of an attitude's angles beside the magnetometer."""

    def __init__(self, seen: VectorBesideAttitude, attitude: Series, *, far: bool) -> None:
        self.vectors = [seen.with_attitude(attitude, world=world) for world in (False, True)]
        lags = far_lags(self.vectors[0].grid.longest_lag, COARSE) if far else np.zeros(0)
        self._lags = {False: CLOSE, True: lags}
        self._left = {
            late: [vector.match(lags)[:, 0] for vector in self.vectors]
            for late, lags in self._lags.items()
        }

    @property
    def best(self) -> float:
        """[nats] that the best reading leaves over."""
        return min(float(left.min()) for both in self._left.values() for left in both if left.size)

    @property
    def movement(self) -> float:
        """[nats] of all that the field does in body axes."""
        return 0.5 * float(np.sum(np.square(self.vectors[0].movement)))

    def at(self, attitude: Array, field: int, *, late: bool) -> tuple[float, Seen] | None:
        """[nats] for a quaternion read as the 4 x 4 matrix says and the magnetometer in the axes
        of this number, in step or with the attitude late; None where no lag is tried."""
        family, turned = vector_axes(attitude)
        place = int(relative_axes()[field, place_of(turned)])
        left = self._left[late][family][:, place]
        if len(left) < 3:
            return None
        misfit, lag = least_of(self._lags[late], left)
        return misfit, (self.vectors[family], signed_permutations(3)[place], lag)


@dataclass(frozen=True)
class _Leaning:
    """One reading of attitude, accelerometer and magnetometer."""

    corrections: tuple[Correction, ...]
    cost: float
    """[nats]."""
    misfit: float
    """[nats]."""
    of_gravity: float
    """[nats] of it."""
    vertical: Vertical | None
    attitude: Array
    force: Array
    field: Seen | None

    @property
    def residuals(self) -> list[Array]:
        """Of the accelerometer and of the magnetometer, those that there are; last come the rows
        of what is off throughout."""
        left = []
        if self.vertical is not None:
            left.append(self.vertical.residual(self.attitude, self.force))
        if self.field is not None:
            vector, axes, lag = self.field
            left.append(vector.residual(axes, lag))
        return left

    @property
    def polished(self) -> "_Leaning":
        """The same with the lag of the field sought finely."""
        if self.field is None:
            return self
        vector, axes, lag = self.field
        left, finer = vector.polished(axes, lag)
        return replace(self, misfit=self.of_gravity + left, field=(vector, axes, finer))

    @property
    def score(self) -> float:
        return self.misfit + self.cost


def vertical_of(recording: Recording, gravity: float) -> Vertical | None:
    """The attitude as read; None without an accelerometer, or with too little of both. What the
    body's turning does to the sensor is taken out by the gyro, where there is one."""
    grid = _grid(recording)
    if grid is None:
        return None
    shaken = shaken_by(recording)
    vertical = Vertical(recording["attitude"], recording["accelerometer"], grid, gravity, shaken)
    gyro = recording.streams.get("gyro")
    turns = gyro is not None and gyro.columns == ("x", "y", "z") and grid_of(recording, "gyro")
    return vertical.without_arm(gyro) if gyro is not None and turns else vertical


def vertical_findings(recording: Recording, gravity: float) -> list[ConventionFinding]:
    """What is wrong with attitude, accelerometer or magnetometer; none with the attitude alone, or
    in a right log.

    Args:
        recording: units are right; a gyro has no part in it.
        gravity: [m/s^2].
    """
    grid = _grid(recording)
    seen = room_vector(recording, "magnetometer", "attitude")
    field = seen if isinstance(seen, VectorBesideAttitude) else None
    if grid is None and field is None:
        return []
    every = sorted(_leanings(recording, grid, gravity, field), key=lambda leaning: leaning.score)
    if not every:
        return []
    ranked = best_of(every, lambda item: [item.field] if item.field is not None else [])
    left = zip(*(item.residuals for item in ranked), strict=True)
    inflated = [min(inflation(residual[:-2]) for residual in each) for each in left]

    def weigh(one: _Leaning, other: _Leaning) -> float:
        pairs = zip(one.residuals, other.residuals, inflated, strict=True)
        return sum(evidence(*pair) for pair in pairs) + other.cost - one.cost

    chosen, certainty = choose(ranked, weigh)
    best = chosen[0] if chosen else next(item for item in ranked if not item.corrections)
    if best.vertical is not None:
        angle = best.vertical.angle(best.attitude, best.force)
        if angle > ASTRAY + best.vertical.shaken_aside:
            told = f"the acceleration is {np.degrees(angle):.0f} deg from upright in the best"
            return [no_fit("accelerometer", f"accelerometer and attitude fits: {told} of them")]
    if not chosen:
        return []
    others = dict.fromkeys(words_of(rival) for rival in chosen[1:])
    return list(findings_of(best.corrections, certainty, tuple(others)))


def _leanings(
    recording: Recording, grid: CellGrid | None, gravity: float, field: VectorBesideAttitude | None
) -> Iterator[_Leaning]:
    turns = list(orientations(recording))
    names = ["accelerometer"] * (grid is not None) + ["magnetometer"] * (field is not None)
    read = list(read_angles(recording))
    fields = list[Field]()
    if field is not None:
        fields = [Field(field, series, far=change is None) for change, series in read]
    if fields and min(item.best for item in fields) > (1.0 - COMMON) * fields[0].movement:
        # what moves the field is not the body in any reading
        names, fields = [name for name in names if name != "magnetometer"], []
    if not names:
        return
    options = [list(axes_changes(recording, name)) for name in names]
    numbered = [list(enumerate(change for _, change in option)) for option in options]
    axes = signed_permutations(3)
    beside: Vertical | None = None
    if grid is not None:
        attitude, shaken = recording["attitude"], shaken_by(recording)
        beside = Vertical(attitude, recording["accelerometer"], grid, gravity, shaken)
        beside = beside.measured(recording)
    for k, (change, series) in enumerate(read):
        vertical = beside and beside.with_attitude(series)
        for frame, attitude, attitude_change in turns:
            misfit = np.zeros(len(axes)) if vertical is None else 0.5 * vertical.match(attitude)
            head_down = vertical is not None and vertical.stands_on_its_head(attitude)
            own = [c for c in (change, attitude_change) if c is not None]
            cost = UPSIDE_DOWN * head_down + frame.cost + sum(c.cost for c in own)
            # the log as read is always among them
            most = DEAREST - cost if own or frame.corrections else DEAREST
            for chosen in affordable(numbered, most):
                total = [place_of(frame.vector @ axes[place]) for place, _ in chosen]
                changes = [*own, *(c for _, c in chosen if c is not None)]
                force = total[0] if vertical is not None else 0
                paid = cost + sum(c.cost for _, c in chosen if c is not None)
                for late in (False, True) if fields else (False,):
                    seen, left = None, float(misfit[force])
                    if fields:
                        result = fields[k].at(attitude, total[-1], late=late)
                        if result is None:
                            continue
                        left, seen = left + result[0], result[1]
                    lag = seen[2] if seen is not None else 0.0
                    clocks = [lag_change("attitude", lag), lag_change("magnetometer", -lag)]
                    for clock in clocks if late else [None]:
                        yield _Leaning(
                            (*changes, *frame.corrections, *([clock] if clock else [])),
                            paid + LATE * late,
                            left,
                            float(misfit[force]),
                            vertical,
                            attitude,
                            axes[force],
                            seen,
                        )


def _grid(recording: Recording) -> CellGrid | None:
    if "accelerometer" not in recording or recording["accelerometer"].columns != ("x", "y", "z"):
        return None
    return grid_of(recording, "attitude", "accelerometer")
