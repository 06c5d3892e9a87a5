"""Measured streams that a prediction is held against: where each sample lies, what it should be.

Samples keep their own instants: the prediction is interpolated to them. In a residual they stand
segment by segment, and within one in the order of the grid instants that they are nearest to.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.model import Machine
from twin.noise import noise_and_worth, noise_left, resolution_of
from twin.platform import Platform
from twin.predict.drive.profiles import Course
from twin.predict.log.stated_errors import (
    FEW,
    claimed_bias,
    claimed_delay,
    claimed_noise,
    counted_noise,
    with_claim,
)
from twin.predict.path.states import States
from twin.predict.sensors.sensed import Sense
from twin.recording import Recording, Series

Array = NDArray[np.float64]
Index = NDArray[np.intp]

Shaking = Callable[[str, Array], Array | None]

FEWEST = 4
"""Shorter streams are not predicted."""


@dataclass(frozen=True)
class Grid:
    """Segments of equal length, side by side, each on its own physics grid."""

    begin: float
    """[s]."""
    step: float
    """[s]."""
    steps: int
    """In a segment."""
    segments: int

    @property
    def length(self) -> float:
        """Of a segment [s]."""
        return self.step * self.steps

    @property
    def starts(self) -> Array:
        """(segments,) [s]."""
        return np.asarray(self.begin + self.length * np.arange(self.segments), dtype=np.float64)

    @property
    def begins(self) -> Array:
        """(segments, steps) at which the steps begin [s]."""
        return self.starts[:, None] + self.step * np.arange(self.steps)

    @property
    def edges(self) -> Array:
        """(segments steps + 1,) of all steps [s]."""
        count = self.steps * self.segments
        return np.asarray(self.begin + self.step * np.arange(count + 1), dtype=np.float64)

    def place(self, time: Array, *, ending: bool = False) -> tuple[Index, Array]:
        """Segment of each instant, and how many steps into it.

        Args:
            time: (m,) [s].
            ending: whether an instant between two segments belongs to the first.
        """
        whole = (time - self.begin) / self.step
        parts = whole / self.steps
        segment = np.ceil(parts - 1e-9) - 1.0 if ending else np.floor(parts + 1e-9)
        segment = np.clip(segment, 0, self.segments - 1)
        return segment.astype(np.intp), whole - segment * self.steps


@dataclass(frozen=True)
class Output:
    """One measured stream on the grid: m samples of k numbers."""

    stream: str
    unit: str
    columns: tuple[str, ...]
    """k names; x y z for an attitude, whose residual is a turn about body axes."""
    noise: Array
    """(k,) 1 sigma a sample where nothing shakes the sensor; of attitudes [rad]."""
    stated: bool
    """Whether the noise is the log's own statement or estimated from its data."""
    worth: Array
    """(k,) the share of the samples that would tell as much of the noise as is known of it."""
    claimed: Array
    """(k,) noise that platform.toml states; 0: none."""
    bias: Array
    """(k,) 1 sigma of the sensor's constant error, as platform.toml states it; 0: none."""
    delay: float
    """By which the low-pass that platform.toml states passes slow signals late [s]."""
    time: Array
    """(m,) [s]."""
    value: Array
    """(m, k), or (m, 4)."""
    segment: Index
    """(m,)."""
    place: Array
    """(m,) steps into the segment."""
    slot: Index
    """(m, k) where the residual stands among the rows of its grid instant."""
    sense: Sense | None = None
    """How the stream follows from the state; None where it is a part of it."""
    course: Course | None = None
    """Of stages that were told to move."""
    told: Series | None = None
    """What it follows by the commands, whatever the state; None where it does not."""
    shaken: Array | None = None
    """(m, 1) or (m, k) variance that what moves adds to the noise; None where nothing does."""

    @cached_property
    def sigma(self) -> Array:
        """(m, k) standard deviation of each sample."""
        if self.shaken is None:
            return np.broadcast_to(self.noise, self.slot.shape)
        return np.sqrt(np.square(self.noise) + self.shaken)

    @property
    def instant(self) -> Index:
        """(m,) the nearest grid instant."""
        return np.rint(self.place).astype(np.intp)

    def predicted(self, path: States, step: float, late: float | Array = 0.0) -> Array:
        """What the stream should be, (v, m, k) or (v, m, 4).

        Args:
            path: of v predictions, (v, segments, steps + 1, .).
            step: of the path [s].
            late: as if each sample, or each its own of (m,), had been true so much before its stamp
                [s].
        """
        if self.told is not None:
            value = self.told.interpolated_at(self.time - late)
            return np.broadcast_to(value, (len(path.rate), *value.shape))
        segments, steps = path.rate.shape[1], path.rate.shape[2] - 1
        place = self.place - (late + self.delay) / step
        found = self._at(path, step, self.segment, place)
        # what was true in another segment than it is stamped in lies on that one's path; how it
        # answers to a change is told along its own, on which its row stands
        whole = np.floor(place / steps + 1e-9) * (place < 0.0)
        whole += (np.ceil(place / steps - 1e-9) - 1.0) * (place > steps)
        other = np.clip(self.segment + whole.astype(np.intp), 0, segments - 1)
        away = np.flatnonzero(other != self.segment)
        if away.size:
            there = self._at(path[:1], step, other, place - (other - self.segment) * steps)
            near, far = found[:1, away], there[:, away]
            if self.stream == "attitude":
                change = rotation.multiply(rotation.conjugate(near), found[:, away])
                found[:, away] = rotation.multiply(far, change)
            else:
                found[:, away] += far - near
        return found

    def _at(self, path: States, step: float, segment: Index, place: Array) -> Array:
        """Of v paths, so many steps into a segment; before and after it as it goes there."""
        steps = path.rate.shape[2] - 1
        before = np.clip(np.floor(place + 1e-9).astype(np.intp), 0, steps - 1)
        part = (place - before)[:, None]

        def ends(values: Array) -> tuple[Array, Array]:
            return values[:, segment, before], values[:, segment, before + 1]

        if self.sense is not None:
            first, last = ends(self.sense.shown(path))
            return first + part * (last - first)
        straight = {"wheel_speed": path.wheel_speed, "gimbal_angle": path.gimbal_angle}
        if self.stream in ("gyro", "joint_rate", *straight):
            first, last = ends(straight.get(self.stream, path.rate))
            return first + part * (last - first)
        first, last = ends(path.position)
        rate_first, rate_last = ends(path.rate)
        if self.stream == "joint_angle":
            return first + _cubic(last - first, step * rate_first, step * rate_last, part)
        turn = rotation.to_rotation_vector(rotation.multiply(rotation.conjugate(first), last))
        return rotation.multiply(
            first,
            rotation.from_rotation_vector(_cubic(turn, step * rate_first, step * rate_last, part)),
        )

    def residual(self, path: States, step: float, late: float | Array = 0.0) -> Array:
        """(measured - predicted) / sigma, (v, m, k)."""
        predicted = self.predicted(path, step, late)
        if self.stream == "attitude":
            error = rotation.multiply(rotation.conjugate(predicted), self.value)
            return rotation.to_rotation_vector(error) / self.sigma
        return (self.value - predicted) / self.sigma

    def with_noise_of(self, left: Array) -> "Output":
        """Its noise found again, in what a prediction leaves.

        A control law that answers to noise, and the rounding of what moves slowly, look like more
        of it than there is; a torque that is held while few samples are taken, like less. More than
        platform.toml states is not believed: it may be what the model lacks.

        Args:
            left: (m, k) residual of a prediction that follows the log.
        """
        if self.stated or not self.scatters:
            return self
        noise, worth = noise_left(self.time, self.value, left * self.noise)
        noise, worth = with_claim(self.claimed, noise, worth, len(self.time))
        noise = np.minimum(noise, np.maximum(self.claimed, self.noise))
        return replace(self, noise=noise, worth=np.where(noise != self.noise, worth, self.worth))

    @property
    def scatters(self) -> bool:
        """Whether its residual is noise of the size that is assumed: a counter's is less."""
        return self.course is None

    def moved_by(self, change: Array, first: int, path: States) -> Array:
        """d residual (m, k, a) by changes (S, steps + 1, x, a) of the state at each instant.

        Args:
            change: turns and rates of bodies, speeds of wheels.
            first: where in a state the numbers stand that this stream measures, if they do.
            path: (1, S, steps + 1, .) that is changed.
        """
        if self.told is not None:
            return np.zeros((*self.slot.shape, change.shape[-1]))
        if self.sense is not None:
            change, first = self.sense.moved_by(path, change), 0
        steps = change.shape[1] - 1
        before = np.clip(np.floor(self.place + 1e-9).astype(np.intp), 0, steps - 1)
        part = (self.place - before)[:, None, None]
        seen = slice(first, first + len(self.noise))
        one, other = (change[self.segment, at, seen] for at in (before, before + 1))
        # in place: these are the largest arrays of a diagnosis
        other -= one
        other *= part
        other += one
        other /= -self.sigma[..., None]
        return other


def _cubic(rise: Array, slope: Array, end_slope: Array, part: Array) -> Array:
    """Of the rise over a step, the cubic with these slopes at both ends, at `part` of the step."""
    bend = (slope - rise) * (1.0 - part) + (rise - end_slope) * part
    return part * rise + part * (1.0 - part) * bend


def outputs_of(
    recording: Recording,
    machine: Machine,
    grid: Grid,
    streams: Sequence[str],
    senses: Mapping[str, Sense],
    course: Course | None,
    told: Mapping[str, Series],
    shaking: Shaking,
) -> tuple[tuple[Output, ...], int]:
    """The streams that a recording has, and how many rows each grid instant is given.

    Args:
        recording: the log.
        machine: whose sensors they are.
        grid: of the prediction.
        streams: to look for, in this order.
        senses: of those among them that are no part of the state.
        course: that stages were told to take, if they are among them.
        told: of those that follow from commands alone.
        shaking: variance (m, 1) or (m, k) that what moves adds to a stream at some instants.
    """
    found: list[Output] = []
    width = 0
    for name in streams:
        if name not in recording or len(recording[name]) < FEWEST:
            continue
        series = recording[name]
        # a rate's change is felt at the end of a step
        segment, place = grid.place(series.time, ending=name in senses)
        inside = (place > -0.5) & (place < grid.steps + 0.5)
        if name in senses and senses[name].feels_turning:
            # how fast the rate changed before the log began nobody knows
            inside &= (segment > 0) | (place > 0.5)
        segment, place = segment[inside], place[inside]
        instant = np.rint(place).astype(np.intp)
        # the how-manieth of its instant each sample is
        key = segment * (grid.steps + 1) + instant
        first = np.searchsorted(key, key)
        rank = np.arange(len(key)) - first
        attitude = name == "attitude"
        columns = ("x", "y", "z") if attitude else series.columns
        k = len(columns)
        slot = width + rank[:, None] * k + np.arange(k)
        stages = course if name == "stage_position" else None
        shaken = shaking(name, series.time)
        counter = None if stages is None else counted_noise(machine.platform, len(series))
        noise, stated, worth = counter or _noise(recording, machine.platform, name, k, shaken)
        found.append(
            Output(
                name,
                "rad" if attitude else series.unit,
                columns,
                noise,
                stated,
                worth,
                claimed_noise(machine.platform, name, k),
                claimed_bias(machine.platform, name, k),
                0.0 if name in senses else claimed_delay(machine.platform, name),
                series.time[inside],
                series.value[inside],
                segment,
                place,
                slot,
                senses.get(name),
                stages,
                told.get(name),
                None if shaken is None else shaken[inside],
            )
        )
        width += k * int(rank.max(initial=-1) + 1)
    return tuple(found), width


def noise_of(recording: Recording, platform: Platform, stream: str) -> Array:
    """(k,) 1 sigma of a reading: as the log states it, else as its samples and the platform say."""
    return _noise(recording, platform, stream, recording[stream].value.shape[1], None)[0]


def digits_of(series: Series, platform: Platform, stream: str) -> Array:
    """(k,) steps to which readings are rounded, as they show; of one that stays at a value, or at
    the edge between two, and shows none, as platform.toml states. 0: not at all."""
    shown = np.array([resolution_of(column) for column in series.value.T])
    if stream not in platform.sensors:
        return shown
    return np.where(_still(series), platform.sensors[stream].resolution, shown)


def _still(series: Series) -> NDArray[np.bool_]:
    """(k,) whether readings stay at one value, or at the edge between two."""
    return np.array([len(np.unique(column)) <= 2 for column in series.value.T])


def _noise(
    recording: Recording, platform: Platform, name: str, k: int, shaken: Array | None
) -> tuple[Array, bool, Array]:
    facts = cast(Mapping[str, Mapping[str, Any]], recording.provenance.get("streams") or {})
    stated = facts.get(name, {}).get("noise")
    if stated is None:
        series = recording[name] if shaken is None else _quiet(recording[name], shaken)
        noise, worth = noise_and_worth(series)
        if name in platform.sensors and name != "attitude":
            # what stays says nothing of its noise, but is no better known than its steps
            rounding = platform.sensors[name].resolution / np.sqrt(12.0)
            noise = np.where(_still(recording[name]), np.maximum(noise, rounding), noise)
        noise, worth = with_claim(claimed_noise(platform, name, k), noise, worth, len(series))
        return noise, False, worth
    return np.broadcast_to(np.asarray(stated, dtype=np.float64), (k,)).copy(), True, np.full(k, inf)


def _quiet(series: Series, shaken: Array) -> Series:
    """Its samples while nothing shakes the sensor; the quietest few where something always does."""
    whole = shaken.max(axis=1)
    keep = whole <= np.sort(whole)[min(FEW, len(whole)) - 1]
    return replace(series, time=series.time[keep], value=series.value[keep])
