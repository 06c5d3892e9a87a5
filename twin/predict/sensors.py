"""Predicted readings of sensors, and the places of their samples in a residual.

Sensors on the body show specific force, tilt and field of the predicted motion by the laws of the
simulated sensors, at every instant of the grid, after the low-pass that platform.toml states. An
accelerometer feels the mean angular acceleration over a step, or over the sensor's window.

Samples keep their own instants: the prediction is interpolated to them. In a residual they are
ordered by segment, and within one by the nearest instant of the grid. All segments have as many
rows as the fullest one; the others stay zero.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.signal import sosfilt, sosfilt_zi

from twin import rotation
from twin.model import Machine
from twin.noise import noise_and_worth, noise_left, resolution_of
from twin.plant.sensors import sections_of
from twin.plant.truth import elevations, site_places, specific_force
from twin.platform import Platform, Sensor
from twin.predict.logs import (
    FEW,
    claimed_bias,
    claimed_delay,
    claimed_noise,
    counted_noise,
    with_claim,
)
from twin.predict.profiles import Course
from twin.predict.states import States
from twin.recording import Recording, Series

Array = NDArray[np.float64]
SENSED = ("inclinometer", "accelerometer", "magnetometer")
"""Streams that follow from attitude, rate and the change of the rate. So does a gyro with a filter,
which takes from the rate what the drives' steps shake it by."""
SETTLED = 8.0
"""Time constants of a low-pass before a segment over which its motion is carried back: what the
filter remembers of."""
Index = NDArray[np.intp]
Shaking = Callable[[str, Array], Array | None]
FEWEST = 4
"""Shorter streams are not predicted."""


@dataclass(frozen=True)
class Sense:
    """One sensor on one grid."""

    stream: str
    step: float
    """Of the grid [s]."""
    gravity: float
    """[m/s^2]."""
    field_world: Array
    """(3,) [T]."""
    site: Array
    """(3,) from the CR, body axes [m]."""
    window: float
    """Over which the change of the rate is taken, where that is longer than a step [s]."""
    sections: Array | None
    """(., 6) second-order sections of the low-pass; None without one."""
    memory: int
    """Steps before a segment that the low-pass remembers."""

    @property
    def feels_turning(self) -> bool:
        """Whether a value depends on how the rate has changed over the step before."""
        return self.stream in ("inclinometer", "accelerometer")

    def shown(self, path: States) -> Array:
        """Values (v, S, steps + 1, k) along paths (v, S, steps + 1, .)."""
        position, rate, turning = self._extended(path)
        if self.stream == "gyro":
            value = rate
        elif self.stream == "magnetometer":
            value = rotation.rotate(rotation.conjugate(position), self.field_world)
        else:
            push = np.zeros_like(rate)
            push[..., 2] = self.gravity
            value = specific_force(position, push, rate, turning, self.site)
            if self.stream == "inclinometer":
                value = elevations(value, self.gravity)
        if self.sections is None:
            return value
        rest = sosfilt_zi(self.sections)[:, None, None, :, None] * value[None, :, :, :1]
        passed, _ = sosfilt(self.sections, value, axis=2, zi=rest)
        return passed[:, :, self.memory :]

    def slope(self, path: States) -> Array:
        """(S, steps + 1, k, 6) d value / d (turn, rate) along a path (1, S, steps + 1, .), the
        low-pass left out."""
        return self._slopes(path)[..., :6]

    def moved_by(self, path: States, change: Array) -> Array:
        """(S, steps + 1, k, a) change of the values by changes (S, steps + 1, x, a) of the state,
        none before the first instant."""
        turning = self._turning(np.moveaxis(change[:, :, 3:6], 1, 0))
        felt = np.concatenate([change[:, :, :6], np.moveaxis(turning, 0, 1)], axis=2)
        moved = self._slopes(path) @ felt
        return moved if self.sections is None else sosfilt(self.sections, moved, axis=1)

    def _slopes(self, path: States) -> Array:
        """(S, steps + 1, k, 9) d value / d (turn, rate, its derivative)."""
        position, rate = path.position[0], path.rate[0]
        none = np.zeros((*rate.shape[:-1], 3, 3))
        if self.stream == "gyro":
            return np.concatenate([none, none + np.eye(3), none], axis=-1)
        if self.stream == "magnetometer":
            field_body = rotation.rotate(rotation.conjugate(position), self.field_world)
            return np.concatenate([rotation.skew(field_body), none, none], axis=-1)
        up = rotation.rotate(rotation.conjugate(position), np.array([0.0, 0.0, self.gravity]))
        whirl = (
            rate[..., :, None] * self.site
            + (rate @ self.site)[..., None, None] * np.eye(3)
            - 2.0 * self.site[:, None] * rate[..., None, :]
        )
        lever = none - rotation.skew(self.site)
        slopes = np.concatenate([rotation.skew(up), whirl, lever], axis=-1)
        if self.stream == "accelerometer":
            return slopes
        level = np.sqrt(np.maximum(1.0 - np.square(up / self.gravity), 1e-6)) * self.gravity
        return np.stack(
            [slopes[..., 1, :] / level[..., 1:2], -slopes[..., 0, :] / level[..., 0:1]], axis=-2
        )

    def _extended(self, path: States) -> tuple[Array, Array, Array]:
        """Attitude, rate and its derivative, from so long before each segment as is remembered."""
        position, rate = path.position, path.rate
        turning = np.moveaxis(self._turning(np.moveaxis(rate, 2, 0)), 0, 2)
        if not self.memory:
            return position, rate, turning
        ago = self.step * np.arange(self.memory, 0, -1)[:, None]
        first, slope = rate[:, :, :1], turning[:, :, :1]
        back = rotation.from_rotation_vector(0.5 * slope * ago**2 - first * ago)
        before = rotation.multiply(position[:, :, :1], back)
        return (
            np.concatenate([before, position], axis=2),
            np.concatenate([first - slope * ago, rate], axis=2),
            np.concatenate([np.repeat(slope, self.memory, axis=2), turning], axis=2),
        )

    def _turning(self, rate: Array) -> Array:
        """How fast rates (steps + 1, ...) change, at each instant the mean over the window; as if
        they had changed before the first as they do after it."""
        slope = np.diff(rate, axis=0) / self.step
        slope = np.concatenate([slope[:1], slope])
        steps = max(self.window / self.step, 1.0)
        if steps == 1.0:
            return slope
        # of a step that the window does not fill, its part
        parts = np.clip(steps - np.arange(np.ceil(steps)), 0.0, 1.0) / steps
        padded = np.concatenate([slope[:1].repeat(len(parts) - 1, axis=0), slope])
        last = len(parts) - 1
        return sum(
            (part * padded[last - back : len(padded) - back] for back, part in enumerate(parts)),
            start=np.zeros_like(slope),
        )


def senses_of(machine: Machine, step: float, field_world: Array) -> dict[str, Sense]:
    """By stream, those of a ball. On one that glides, accelerometers and inclinometers feel more
    than the state of a prediction holds. A magnetometer needs a field that is known."""
    platform = machine.platform
    base = platform.base
    if base.kind != "ball":
        return {}
    glides = set(base.planar) - set(base.locked)
    sites = site_places(machine)
    result: dict[str, Sense] = {}
    for name in ("gyro", *SENSED):
        sensor = platform.sensors.get(name)
        if sensor is None or (name == "magnetometer" and not field_world.any()):
            continue
        sections, memory = _low_pass(sensor, step)
        if name == "gyro" and sections is None:
            continue
        if glides and name in ("inclinometer", "accelerometer"):
            continue
        site = sites.get(sensor.site, np.zeros(3))
        result[name] = Sense(
            name, step, platform.gravity, field_world, site, sensor.window, sections, memory
        )
    return result


def _low_pass(sensor: Sensor, step: float) -> tuple[Array | None, int]:
    if not np.isfinite(sensor.cutoff) or sensor.cutoff * step >= 0.5:
        return None, 0
    memory = int(np.ceil(SETTLED / (2.0 * np.pi * sensor.cutoff * step)))
    return sections_of(sensor, step), memory


@dataclass(frozen=True)
class StepGrid:
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
        result = self._at(path, step, self.segment, place)
        # what was true in another segment than it is stamped in lies on that one's path; how it
        # answers to a change is told along its own, on which its row stands
        whole = np.floor(place / steps + 1e-9) * (place < 0.0)
        whole += (np.ceil(place / steps - 1e-9) - 1.0) * (place > steps)
        other = np.clip(self.segment + whole.astype(np.intp), 0, segments - 1)
        away = np.flatnonzero(other != self.segment)
        if away.size:
            there = self._at(path[:1], step, other, place - (other - self.segment) * steps)
            near, far = result[:1, away], there[:, away]
            if self.stream == "attitude":
                change = rotation.multiply(rotation.conjugate(near), result[:, away])
                result[:, away] = rotation.multiply(far, change)
            else:
                result[:, away] += far - near
        return result

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
        if path.position.shape[-1] == 3:
            straight |= {"velocity": path.rate[..., :2], "heading_rate": path.rate[..., 2:]}
        if self.stream in ("gyro", "joint_rate", *straight):
            first, last = ends(straight.get(self.stream, path.rate))
            return first + part * (last - first)
        first, last = ends(path.position)
        rate_first, rate_last = ends(path.rate)
        if path.position.shape[-1] != 4:
            risen = _cubic(last - first, step * rate_first, step * rate_last, part)
            shown = {"position": slice(0, 2), "heading": slice(2, 3)}.get(self.stream, slice(None))
            return (first + risen)[..., shown]
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

    def with_noise_of(self, residual: Array) -> "Output":
        """Its noise found again, in what a prediction leaves.

        A control law that answers to noise, and the rounding of what moves slowly, look like more
        of it than there is; a torque that is held while few samples are taken, like less. More than
        platform.toml states is not believed: it may be what the model lacks.

        Args:
            residual: (m, k) of a prediction that follows the log.
        """
        if self.stated or not self.scatters:
            return self
        noise, worth = noise_left(self.time, self.value, residual * self.noise)
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
        item, other = (change[self.segment, at, seen] for at in (before, before + 1))
        # in place: these are the largest arrays of a diagnosis
        other -= item
        other *= part
        other += item
        other /= -self.sigma[..., None]
        return other


def _cubic(rise: Array, slope: Array, end_slope: Array, part: Array) -> Array:
    """Of the rise over a step, the cubic with these slopes at both ends, at `part` of the step."""
    bend = (slope - rise) * (1.0 - part) + (rise - end_slope) * part
    return part * rise + part * (1.0 - part) * bend


def outputs_of(
    recording: Recording,
    machine: Machine,
    grid: StepGrid,
    streams: Sequence[str],
    senses: Mapping[str, Sense],
    course: Course | None,
    commanded: Mapping[str, Series],
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
        commanded: of those that follow from commands alone.
        shaking: variance (m, 1) or (m, k) that what moves adds to a stream at some instants.
    """
    outputs: list[Output] = []
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
        outputs.append(
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
                commanded.get(name),
                None if shaken is None else shaken[inside],
            )
        )
        width += k * int(rank.max(initial=-1) + 1)
    return tuple(outputs), width


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


@dataclass(frozen=True)
class Cells:
    """S segments of N rows."""

    row: NDArray[np.int32]
    """(S, K, W) which of them each slot of each instant is; N where no sample stands."""
    count: int
    """N."""
    places: tuple[tuple[Index, NDArray[np.int32]], ...]
    """Of each output: segment (m, 1) and row (m, k) of its numbers."""

    @staticmethod
    def of(outputs: Sequence[Output], grid: StepGrid, width: int) -> "Cells":
        """Order the numbers.

        Args:
            outputs: whose slots are among `width` an instant.
            grid: of the prediction.
            width: W.
        """
        held = np.zeros((grid.segments, grid.steps + 1, width), dtype=np.bool_)
        for output in outputs:
            held[output.segment[:, None], output.instant[:, None], output.slot] = True
        rank = np.cumsum(held.reshape(grid.segments, -1), axis=1, dtype=np.int32)
        count = int(rank[:, -1].max(initial=0))
        row = np.where(held, rank.reshape(held.shape) - 1, count).astype(np.int32)
        places = tuple(
            (o.segment[:, None], row[o.segment[:, None], o.instant[:, None], o.slot])
            for o in outputs
        )
        return Cells(row, count, places)

    def scatter(self, parts: Sequence[Array]) -> Array:
        """Numbers of each output (v, m, k) to their rows (v, S, N)."""
        rows = np.zeros((len(parts[0]), len(self.row), self.count))
        for (segment, row), part in zip(self.places, parts, strict=True):
            rows[:, segment, row] = part
        return rows

    def gather(self, rows: Array) -> list[Array]:
        """Numbers in rows (S, N) back to their outputs, each (m, k)."""
        return [rows[place] for place in self.places]
