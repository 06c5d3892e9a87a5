"""What a machine's sensors tell an attitude filter, and when: streams, levers, delays, states."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.estimators.estimator import Agility, agility_of, variance_of
from twin.platform import Platform, Sensor
from twin.rotation import (
    IDENTITY,
    conjugate,
    cross,
    from_rotation_vector,
    matrix,
    multiply,
    normalized,
    rotate,
    skew,
    to_rotation_vector,
)
from twin.signals import Mask, Samples

Array = NDArray[np.float64]

AIDS = ("attitude", "accelerometer", "inclinometer", "magnetometer", "position")
"""Streams that correct what the gyro integrates."""
UP = np.array([0.0, 0.0, 1.0])
_EPS = 1e-9
_SLANT = 0.02
"""Share of a field along the floor from which on it shows a heading."""


@dataclass(frozen=True)
class Aid:
    """What became of the samples of one stream, run by run (n,)."""

    taken: Array
    """Samples that corrected the estimate."""
    refused: Array
    """Samples beyond the gate, or of no plausible size."""
    squares: Array
    """Sum of squared innovations in their sigmas, a column; each no larger than the gate."""
    since: Array
    """Since when all were refused [s]; NaN where the last one was taken."""
    last: Array
    """Newest sample as it was shown; NaN before the first, (n, columns)."""
    used: Array
    """When the last one was taken [s]; NaN before the first."""
    odd: Array
    """When the last one was beyond the gate [s]; NaN before the first."""


class Layout(NamedTuple):
    """Where the states stand; a part that a machine does not have is an empty slice."""

    turn: slice
    """Attitude error, room axes [rad]."""
    gyro: slice
    """Its bias, body axes [rad/s]."""
    scale: slice
    """Its scale and misalignment, row by row [-]."""
    drift: slice
    """Both: what turns the attitude wrongly."""
    bias: dict[str, slice]
    """Of each aid that states one, in its unit and its columns."""
    disturbance: slice
    """Of the field, room axes [T]."""
    velocity: slice
    """Of the CR, room axes [m/s]."""
    place: slice
    """Of the CR, room axes [m]."""
    size: int


class Known(NamedTuple):
    """What the filter knows of the machine."""

    layout: Layout
    sensors: dict[str, Sensor]
    """Those that it reads."""
    gyro_variance: Array
    """(3,) of a sample [rad^2/s^2]."""
    bias_walk: float
    """How far its bias wanders in a second [rad/s^1.5]."""
    period: float
    """Between two gyro samples [s]."""
    variance: dict[str, Array]
    """Of a sample of each aid, a number a column."""
    delay: dict[str, float]
    """By which a sensor's low-pass makes a slow signal late [s]."""
    horizon: float
    """How far behind the tick the state stands: by then all samples have come [s]."""
    gravity: float
    lever: dict[str, Array]
    """(3,) from the CR to the site [m]."""
    moves: bool
    """Whether the CR moves in the room."""
    heading: bool
    """Whether a sensor shows the turn about the vertical."""
    agility: Agility
    """How fast its rate can change."""


def known_of(
    platform: Platform,
    *,
    acceleration: float | None,
    bias_walk: float | None,
    scaled: bool,
    disturbed: bool,
) -> Known:
    """Of a machine.

    Args:
        platform: the machine.
        acceleration: largest change of its rate [rad/s^2]; None: what it can do by itself.
        bias_walk: of the gyro [rad/s^1.5]; None: after its stated bias.
        scaled: whether the gyro's scale and misalignment are states.
        disturbed: whether the field's disturbance is.

    Raises:
        UsageError: it lacks a gyro, or what shows the vertical.
    """
    lacking = missing(platform)
    if lacking:
        raise UsageError(f"the estimator 'mekf' needs {lacking}, and {platform.name} has none")
    sensors = {name: platform.sensors[name] for name in aids_of(platform)}
    delay = {name: delay_of(platform.sensors[name]) for name in ("gyro", *sensors)}
    moves = platform.base.travels and "accelerometer" in sensors
    return Known(
        layout=_layout(
            sensors,
            scaled=scaled,
            disturbed=disturbed and "magnetometer" in sensors,
            moves=moves,
        ),
        sensors=sensors,
        gyro_variance=variance_of(platform.sensors["gyro"]),
        bias_walk=_walk(platform.sensors["gyro"]) if bias_walk is None else bias_walk,
        period=1.0 / platform.sensors["gyro"].rate,
        variance={name: _variance(sensor, platform) for name, sensor in sensors.items()},
        delay=delay,
        horizon=max(platform.sensors[name].latency + late for name, late in delay.items()),
        gravity=platform.gravity,
        lever=_levers(platform, sensors),
        moves=moves,
        heading=shows_heading(platform),
        agility=agility_of(platform) if acceleration is None else Agility(acceleration),
    )


def _walk(gyro: Sensor) -> float:
    return 1e-3 * float(gyro.bias.max()) if gyro.bias.any() else 1e-6


def _layout(sensors: Mapping[str, Sensor], *, scaled: bool, disturbed: bool, moves: bool) -> Layout:
    end = 15 if scaled else 6
    scale, drift = slice(6, end), slice(3, end)
    bias: dict[str, slice] = {}
    for name, sensor in sensors.items():
        if sensor.bias.any():
            bias[name] = slice(end, end + len(sensor.bias))
            end += len(sensor.bias)
    disturbance = slice(end, end + 3 * disturbed)
    velocity = slice(disturbance.stop, disturbance.stop + 3 * moves)
    place = slice(velocity.stop, velocity.stop + 3 * moves)
    turn, gyro = slice(0, 3), slice(3, 6)
    return Layout(turn, gyro, scale, drift, bias, disturbance, velocity, place, place.stop)


def aids_of(platform: Platform) -> tuple[str, ...]:
    """Streams of this machine that correct a gyro: of a body that is thrown, not those that feel
    gravity."""
    falls = platform.base.kind == "free" or platform.base.falls
    felt = ("accelerometer", "inclinometer") if falls else ()
    moves = platform.base.travels and "accelerometer" in platform.sensors
    kept = [name for name in AIDS if name in platform.sensors and name not in felt]
    if not moves or falls:
        kept = [name for name in kept if name != "position"]
    return tuple(kept)


def missing(platform: Platform) -> str:
    """What the filter lacks on this machine; empty where it lacks nothing."""
    if platform.base.kind == "hinge" or "gyro" not in platform.sensors:
        return "a gyro of a body that turns about three axes"
    if {"attitude", "accelerometer", "inclinometer"} & set(aids_of(platform)):
        return ""
    return "a sensor that shows the vertical (attitude, accelerometer or inclinometer)"


def shows_heading(platform: Platform) -> bool:
    """Whether a sensor of the machine shows the turn about the vertical: a camera, or a
    magnetometer in a field that does not stand upright."""
    if "attitude" in platform.sensors:
        return True
    strength = float(np.linalg.norm(platform.magnetic_field))
    along = float(np.hypot(*platform.magnetic_field[:2]))
    return "magnetometer" in platform.sensors and (strength == 0.0 or along > _SLANT * strength)


def heading_sigma(platform: Platform, duration: float) -> float:
    """1 sigma of a heading that the gyro alone carries for so long [rad]: its white noise, and its
    bias about the vertical, which nothing else shows of a level body."""
    gyro = platform.sensors["gyro"]
    noise, bias = float(np.sqrt(variance_of(gyro).max())), float(gyro.bias.max())
    return float(np.hypot(noise * np.sqrt(duration / gyro.rate), bias * duration))


def delay_of(sensor: Sensor) -> float:
    """By which its Butterworth low-pass delays a slow signal: sum of -Re(1 / pole) [s]."""
    if not np.isfinite(sensor.cutoff):
        return 0.0
    turns = np.pi * (2.0 * np.arange(sensor.order) + sensor.order + 1.0) / (2.0 * sensor.order)
    return float(-np.cos(turns).sum() / (2.0 * np.pi * sensor.cutoff))


def _variance(sensor: Sensor, platform: Platform) -> Array:
    """(k,) of a sample; a perfect magnetometer is taken as good to 1e-7 of the field."""
    if sensor.stream != "magnetometer":
        return variance_of(sensor)
    smallest = 1e-7 * max(float(np.linalg.norm(platform.magnetic_field)), 1e-6)
    return np.maximum(sensor.noise**2 + sensor.resolution**2 / 12.0, smallest**2)


def _levers(platform: Platform, sensors: dict[str, Sensor]) -> dict[str, Array]:
    felt = [name for name, sensor in sensors.items() if sensor.site]
    if not felt:
        return {}
    from twin.model import compile_model  # only where a site is asked for
    from twin.plant.truth import site_places

    places = site_places(compile_model(platform))
    return {name: places[sensors[name].site] for name in felt}


def due(
    known: Known, waiting: Mapping[str, Samples], streams: Mapping[str, Samples], until: float
) -> tuple[dict[str, Samples], dict[str, Samples]]:
    """What the filter reads, stamped with the time at which it was true, by the horizon and
    after."""
    due_samples: dict[str, Samples] = {}
    coming: dict[str, Samples] = {}
    for name, delay in known.delay.items():
        new, kept = streams.get(name), waiting.get(name)
        if new is not None and delay:
            new = Samples(new.value, new.time - delay, new.valid)
        if new is None or kept is None:
            both = new or kept
            if both is None:
                continue
        else:
            both = Samples(
                np.concatenate([kept.value, new.value], axis=1),
                np.concatenate([kept.time, new.time], axis=1),
                np.concatenate([kept.valid, new.valid], axis=1),
            )
        # runs share their schedule but for faults of their clocks: the earliest decides
        count = int(np.sum(both.time.min(axis=0) <= until + _EPS))
        if count:
            due_samples[name] = Samples(
                both.value[:, :count], both.time[:, :count], both.valid[:, :count]
            )
        if count < both.time.shape[1]:
            coming[name] = Samples(
                both.value[:, count:], both.time[:, count:], both.valid[:, count:]
            )
    return due_samples, coming


def in_order(due_samples: dict[str, Samples]) -> list[tuple[str, int]]:
    """Streams and places of samples: each gyro sample, then those of the time up to it."""
    gyro = due_samples["gyro"].time.min(axis=0) if "gyro" in due_samples else np.empty(0)
    keyed = [(float(k), -1, "gyro", k) for k in range(len(gyro))]
    for rank, name in enumerate(AIDS):
        if name in due_samples:
            stamps = due_samples[name].time.min(axis=0)
            after = np.searchsorted(gyro, stamps - _EPS, side="left")
            keyed += [(float(a), rank, name, k) for k, a in enumerate(after)]
    return [(name, place) for _, _, name, place in sorted(keyed)]


class Spin(NamedTuple):
    """How the body turns, as the gyro shows it."""

    rate: Array
    """(n, 3) [rad/s]."""
    change: Array
    """(n, 3) [rad/s^2]."""
    variance: Array
    """(n, 1) of the change, from the gyro's noise."""


def look(
    known: Known,
    name: str,
    value: Array,
    attitude: Array,
    states: Array,
    field: Array,
    turning: Spin,
) -> tuple[Array, Array, Array]:
    """What a sample shows beyond what was expected.

    Args:
        known: of the machine.
        name: of the stream.
        value: (n, columns) the sample.
        attitude: (n, 4) when it was true.
        states: (n, size).
        field: (n, 3) of the room [T].
        turning: of the body.

    Returns:
        (n, m) that, (n, m, size) its derivative by the errors of the states, (n, m) its variance.
    """
    layout, columns = known.layout, len(known.variance[name])
    back = matrix(attitude).transpose(0, 2, 1)
    variance = np.broadcast_to(known.variance[name], (len(value), columns))
    slope = np.zeros((len(value), columns, layout.size))
    if name == "attitude":
        error = to_rotation_vector(multiply(conjugate(attitude), value))
        slope[:, :, :3] = back  # about the body's axes, as its noise is
    elif name == "position":
        error = value - states[:, layout.place]
        slope[:, :, layout.place] = np.eye(3)
    elif name == "magnetometer":
        disturbed = layout.disturbance.stop > layout.disturbance.start
        room = field + states[:, layout.disturbance] if disturbed else field
        error = value - np.einsum("nij,nj->ni", back, room)
        slope[:, :, :3] = back @ skew(room)
        if disturbed:
            slope[:, :, layout.disturbance] = back
    else:
        weight = np.broadcast_to(known.gravity * UP, (len(value), 3))
        felt = felt_by_turning(known, name, turning) + np.einsum("nij,nj->ni", back, weight)
        tipped = back @ skew(weight)
        lever = known.lever.get(name, np.zeros(3))
        noise = turning.variance * (lever @ lever - lever * lever)
        if name == "accelerometer":
            error = value - felt
            slope[:, :, :3] = tipped
            variance = variance + noise
        else:
            sine = np.clip(felt / known.gravity, -0.999, 0.999)[:, 1::-1]
            sign = np.array([1.0, -1.0])
            scale = sign / (known.gravity * np.sqrt(1.0 - sine * sine))
            error = value - sign * np.arcsin(sine)
            slope[:, :, :3] = scale[..., None] * tipped[:, 1::-1]
            variance = variance + scale * scale * noise[:, 1::-1]
    where = layout.bias.get(name)
    if where is not None:
        error = error - states[:, where]
        slope[:, :, where] = np.eye(columns)
    return error, slope, variance


def felt_by_turning(known: Known, name: str, turning: Spin) -> Array:
    """(n, 3) specific force at a sensor's site from the body's turning about the CR [m/s^2]."""
    lever = np.broadcast_to(known.lever.get(name, np.zeros(3)), turning.rate.shape)
    rate = turning.rate
    return cross(turning.change, lever) + cross(rate, cross(rate, lever))


def first_attitude(
    first: Mapping[str, tuple[Array, Array, Mask]], field: Array, n: int
) -> tuple[Array, Array]:
    """(n, 4) from the first samples of each stream, and the field (n, 3), learnt where it is 0.

    The vertical first, then the turn about it: the triad. What a camera shows stands before both.
    """
    up = np.tile(UP, (n, 1))
    if "inclinometer" in first:
        tilts, _, measured = first["inclinometer"]
        sines = np.sin(np.where(measured[:, None], tilts, 0.0))
        upward = np.sqrt(np.maximum(1.0 - np.square(sines).sum(axis=1), 0.0))
        shown = np.stack([-sines[:, 1], sines[:, 0], upward], axis=1)
        up = np.where(measured[:, None], shown, up)
    if "accelerometer" in first:
        force, _, measured = first["accelerometer"]
        measured = measured & force.any(axis=1)
        up = np.where(measured[:, None], normalized(np.where(measured[:, None], force, UP)), up)
    attitude = upright(up)
    if "magnetometer" in first:
        value, _, measured = first["magnetometer"]
        value = np.where(measured[:, None], value, 0.0)
        shown = rotate(attitude, value)
        learnt = np.zeros_like(shown)
        learnt[:, 0], learnt[:, 2] = np.hypot(shown[:, 0], shown[:, 1]), shown[:, 2]
        field = np.where((measured & ~field.any(axis=1))[:, None], learnt, field)
        turn = np.where(measured, off_field(attitude, value, field), 0.0)
        attitude = multiply(from_rotation_vector(turn[:, None] * UP), attitude)
    if "attitude" in first:
        value, _, measured = first["attitude"]
        value = np.where(measured[:, None], value, IDENTITY)
        attitude = np.where(measured[:, None], normalized(value), attitude)
    return attitude, field


def off_field(attitude: Array, value: Array, field: Array) -> Array:
    """(n,) by which a heading is off, where the field (n, 3) has one to show [rad]."""
    shown = rotate(attitude, value)
    level = np.hypot(field[:, 0], field[:, 1])
    plain = level > _SLANT * np.sqrt(np.einsum("ni,ni->n", field, field))
    angle = np.arctan2(field[:, 1], field[:, 0]) - np.arctan2(shown[:, 1], shown[:, 0])
    return np.where(plain, angle, 0.0)


def upright(up: Array) -> Array:
    """(n, 4) the attitude without yaw in which the body's axes show the vertical so, (n, 3)."""
    axis = cross(up, np.broadcast_to(UP, up.shape))
    sine = np.sqrt(np.einsum("ni,ni->n", axis, axis))
    angle = np.arctan2(sine, up[:, 2])
    unit = np.where(sine[:, None] > 1e-9, axis / np.maximum(sine, 1e-9)[:, None], [1.0, 0.0, 0.0])
    level = from_rotation_vector(angle[:, None] * unit)
    ahead = rotate(level, np.broadcast_to(np.array([1.0, 0.0, 0.0]), up.shape))
    yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
    return multiply(from_rotation_vector(-yaw[:, None] * UP), level)
