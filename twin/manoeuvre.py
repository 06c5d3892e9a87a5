"""Manoeuvres as a lab states them: a table of attitude or torque over time, or waves in words.

A table is read with the readers of logs. Its first column is the time, by default in s; a unit in
brackets behind a column's name (`yaw [deg]`) is converted, and without one the numbers are in SI.

- Attitude, world from body: `w, x, y, z`, or `roll, pitch, yaw` (intrinsic z-y'-x''), with any one
  text before all of them, as in `q_w, q_x, q_y, q_z`.
- Rate, body axes, beside it if it is known: `rate_x, rate_y, rate_z` (or `gyro_`, `omega_`, `w`).
- Torque on the body, body axes: `x, y, z`, with any one text before all of them.

Waves are `sine:AXES,AMPLITUDE@FREQUENCY[,PHASE]`, `square:` likewise, and
`chirp:AXES,AMPLITUDE@FROM,TO,SECONDS`. AXES are one or more of x, y, z with commas between; several
waves are joined by `+`. A frequency is in Hz, or a period with an `s` behind it: `@20s`.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError, UsageError
from twin.files import write_whole
from twin.recording.column_names import is_clock, stated_time_unit, stated_unit
from twin.recording.formats import TEXTS, NumberFile, OpenFiles
from twin.recording.formats.find import COLUMNS
from twin.recording.rows import TimedRows, attitude
from twin.rotation import conjugate, multiply
from twin.units import known_unit

Array = NDArray[np.float64]

WAVES = "sine:AXES,AMPLITUDE@FREQUENCY[,PHASE], square: likewise, chirp:AXES,AMPLITUDE@FROM,TO,S"
TABLES = (*TEXTS, *COLUMNS)
"""Endings of the files that hold a manoeuvre."""
RAMP = 20.0
"""Until sines and chirps of an attitude have their full amplitude [s]."""
RATES = ("rate", "rate_body", "gyro", "omega", "w")
"""What stands before the axes of a rate beside an attitude."""
FLANK = 0.1
"""Share of its period in which an attitude's square wave goes from one side to the other."""
LATEST = 3600.0
"""A table that begins later counts from some other instant than the flight's start [s]."""
WIDEST = np.radians(170.0)
"""Turn between two rows beyond which the way round is anybody's guess [rad]."""


def is_table(text: str) -> bool:
    """Whether a text names a file of a manoeuvre, by its ending."""
    return Path(text).suffix.lower() in TABLES


def quintic(time: float | Array, duration: float) -> tuple[Array, Array, Array]:
    """Smooth step from 0 to 1 within `duration`, and its first two derivatives in time."""
    u = np.clip(np.asarray(time) / duration, 0.0, 1.0)
    left = 1.0 - u
    step = u**3 * (10.0 + u * (6.0 * u - 15.0))
    return step, 30.0 * (u * left) ** 2 / duration, 60.0 * u * left * (left - u) / duration**2


@dataclass(frozen=True)
class Wave:
    """A sine, a chirp or a square wave about one axis.

    The phase is phi = phi_0 + 2 pi (f t + (f_1 - f) t^2 / 2 T) until T, and goes on at f_1 after
    it; a sine and a square wave have f_1 = f.
    """

    axis: int
    """0, 1 or 2: x, y or z."""
    amplitude: float
    frequency: float
    """f, at time 0 [Hz]."""
    phase: float = 0.0
    """phi_0 [rad]."""
    square: bool = False
    end_frequency: float | None = None
    """f_1 [Hz]; None: f."""
    sweep: float = 1.0
    """T [s]."""

    def value(self, time: float | Array) -> Array:
        """The wave as it is, with the square's steps; any shape."""
        phase = self._phase(np.asarray(time, dtype=np.float64))[0]
        if self.square:
            return self.amplitude * np.where(phase / (2.0 * np.pi) % 1.0 < 0.5, 1.0, -1.0)
        return self.amplitude * np.sin(phase)

    def motion(self, time: float | Array) -> tuple[Array, Array, Array]:
        """The wave from rest at 0, smoothly, and its first two derivatives in time.

        A quintic step raises the amplitude within `RAMP`, that of a square wave within its first
        flank; the flanks are quintic steps of `FLANK` of a period each.
        """
        times = np.asarray(time, dtype=np.float64)
        phase, speed, growth = self._phase(times)
        if self.square:
            turns = phase / (2.0 * np.pi)
            part = turns % 1.0
            up, down = quintic(part, FLANK), quintic(part - 0.5, FLANK)
            # a start within the first flank is on the upper side
            begun = (turns < FLANK) & (self.phase < 2.0 * np.pi * FLANK)
            shape = np.where(begun, 1.0, 2.0 * (up[0] - down[0]) - 1.0)
            slope = np.where(begun, 0.0, 2.0 * (up[1] - down[1])) * self.frequency
            bend = np.where(begun, 0.0, 2.0 * (up[2] - down[2])) * self.frequency**2
            share, share_1, share_2 = quintic(times, FLANK / self.frequency)
        else:
            shape, slope = np.sin(phase), np.cos(phase) * speed
            bend = np.cos(phase) * growth - np.sin(phase) * speed**2
            share, share_1, share_2 = quintic(times, RAMP)
        return (
            self.amplitude * share * shape,
            self.amplitude * (share_1 * shape + share * slope),
            self.amplitude * (share_2 * shape + 2.0 * share_1 * slope + share * bend),
        )

    def _phase(self, time: Array) -> tuple[Array, Array, Array]:
        """Of instants from 0 on, with its derivatives [rad, rad/s, rad/s^2]."""
        end = self.frequency if self.end_frequency is None else self.end_frequency
        time = np.maximum(time, 0.0)
        swept = np.minimum(time, self.sweep)
        gain = (end - self.frequency) / self.sweep
        turns = self.frequency * time + gain * swept * (time - 0.5 * swept)
        speed = self.frequency + gain * swept
        bend = np.where(time < self.sweep, gain, 0.0)
        return self.phase + 2.0 * np.pi * turns, 2.0 * np.pi * speed, 2.0 * np.pi * bend


_WAVE = re.compile(r"(sine|square|chirp):((?:[xyz],)+)([^@]*)@(.*)$", re.IGNORECASE)


def is_wave(text: str) -> bool:
    """Whether a text means waves, rightly or not."""
    kind, colon, _ = text.partition(":")
    return bool(colon) and kind in ("sine", "square", "chirp")


def parse_waves(text: str, what: str) -> tuple[Wave, ...]:
    """The waves of a text, in degrees of phase and in the unit that its amplitudes are in.

    Args:
        text: as the module describes.
        what: the word before it in an error: reference or torque.

    Raises:
        UsageError: it is none, or a number of it is none; says which.
    """
    waves: list[Wave] = []
    for part in re.split(r"\+(?=[a-z])", text):
        match = _WAVE.match(part)
        if match is None:
            raise UsageError(f"{what} {text!r}: {part!r} should be a wave: {WAVES}")
        kind, axes, size, pace = match.groups()
        (amplitude,) = _numbers(what, text, size, "an amplitude", 1, 1)
        if kind == "chirp":
            first, last, seconds = _split(what, text, pace, 3)
            sweep = _numbers(what, text, seconds, "a time above 0 s", 1, 1)[0]
            _check(sweep > 0.0, what, text, f"{seconds!r} should be a time above 0 s")
            more: dict[str, Any] = {"end_frequency": _frequency(what, text, last), "sweep": sweep}
        else:
            first, *rest = _split(what, text, pace, 1, 2)
            angle = _numbers(what, text, rest[0], "a phase in degrees", 1, 1)[0] if rest else 0.0
            more = {"phase": math.radians(angle % 360.0), "square": kind == "square"}
        frequency = _frequency(what, text, first)
        waves += [
            Wave("xyz".index(axis), amplitude, frequency, **more)
            for axis in axes.rstrip(",").lower().split(",")
        ]
    return tuple(waves)


def _frequency(what: str, text: str, word: str) -> float:
    """[Hz]: a number, or a period with an s."""
    period = word.strip().endswith("s")
    (number,) = _numbers(what, text, word.strip().removesuffix("s"), "a frequency or period", 1, 1)
    _check(number > 0.0, what, text, f"{word!r} should be a frequency or period above 0")
    return 1.0 / number if period else number


def _split(what: str, text: str, words: str, minimum: int, maximum: int | None = None) -> list[str]:
    parts = words.split(",")
    inside = minimum <= len(parts) <= (maximum or minimum)
    _check(inside, what, text, f"behind @ stand {len(parts)} numbers, {words!r}; use {WAVES}")
    return parts


def _numbers(
    what: str, text: str, words: str, wanted: str, minimum: int, maximum: int
) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in words.split(","))
    except ValueError:
        values = ()
    good = minimum <= len(values) <= maximum and all(map(math.isfinite, values))
    _check(good, what, text, f"{words!r} should be {wanted}; use {WAVES}")
    return values


def _check(good: bool, what: str, text: str, problem: str) -> None:
    if not good:
        raise UsageError(f"{what} {text!r}: {problem}")


class _Group(NamedTuple):
    """Columns of a table that belong together."""

    before: str
    """What stands before their parts."""
    columns: tuple[str, ...]
    """In the order of the parts."""


class ManoeuvreTable:
    """A file of a manoeuvre: its times, and groups of columns by their parts."""

    def __init__(self, path: Path) -> None:
        """Read names and times.

        Raises:
            LogError: it cannot be read; or its times are none, go back, or begin too late.
        """
        if not path.is_file():
            raise LogError(path, "is no file", "give the path of a table of a manoeuvre")
        self.file: NumberFile = OpenFiles().open(path, unit="")
        header = self.file.header
        self._clock = next((name for name in header if is_clock(name)), self.file.time)
        self.time = self._numbers((self._clock,), "s")[:, 0]
        back = np.flatnonzero(np.diff(self.time) <= 0.0)
        if len(back):
            row = int(back[0]) + 1
            raise self.file.fault(
                f"its time {self.time[row]:g} s follows {self.time[row - 1]:g} s",
                "let the times rise from row to row",
                row,
            )
        if self.time[0] > LATEST:
            raise self.file.fault(
                f"begins at {self.time[0]:.10g} s, and times count from the start of the flight",
                "take the first time off all of them",
                0,
            )

    def group(self, parts: str | tuple[str, ...], among: Sequence[str] = ()) -> _Group | None:
        """The columns whose names end in those parts after one and the same text; None: no such.

        Args:
            parts: in their order.
            among: the texts that count, where not any does.

        Raises:
            LogError: there are several such groups.
        """
        of: dict[str, dict[str, str]] = {}
        for name in self.file.header:
            if name == self._clock:
                continue
            plain = re.sub(r"\s*[\[(].*$", "", name).strip().lower()
            plain = re.sub(r"_(deg|dps|degps|mrad|rpm)$", "", plain)
            part = next((part for part in parts if plain.endswith(part)), None)
            if part is not None:
                of.setdefault(plain.removesuffix(part).rstrip("_. "), {})[part] = name
        whole = [
            _Group(text, tuple(found[part] for part in parts))
            for text, found in of.items()
            if len(found) == len(parts) and (not among or text in among)
        ]
        if len(whole) > 1:
            listed = " or ".join(", ".join(group.columns) for group in whole)
            raise self.file.fault(f"states {listed}", "leave one of them in the table")
        return whole[0] if whole else None

    def values(self, group: _Group, unit: str) -> Array:
        """(rows, columns) of a group, in that SI unit.

        Raises:
            LogError: a cell without a number, or a unit of another kind.
        """
        return self._numbers(group.columns, unit)

    def _numbers(self, names: Sequence[str], si: str) -> Array:
        value = np.array(self.file.numbers(names), dtype=np.float64)
        if not len(value):
            raise LogError(self.file.path, "has no rows", "write the manoeuvre into it")
        bad = np.argwhere(~np.isfinite(value))
        if len(bad):
            row, column = map(int, bad[0])
            raise self.file.not_finite(row, names[column], float(value[row, column]))
        for column, name in enumerate(names):
            text = stated_time_unit(name) if si == "s" else stated_unit(name)
            text = (self.file.units.get(name) or text).strip("[]() ")
            if not text or name in self.file.clocks:
                continue
            unit = known_unit(text)
            if unit is None or unit.si != si:
                raise self.file.fault(
                    f"column {name!r} is in {text!r}, which is no unit of {si}",
                    f"write a unit of {si} behind its name, or none for {si} itself",
                )
            value[:, column] = unit.factor * value[:, column] + unit.offset
        return value


@dataclass(frozen=True)
class AttitudeTable:
    """Attitude over time, interpolated; before the first row and after the last it is held.

    The four numbers of the quaternion are cubic splines of the time, scaled to length 1, so that
    attitude, rate and acceleration are continuous: the motion begins and ends at rest. Where the
    rate is stated, each interval is the cubic between the attitudes and rates of its ends: then
    attitude and rate are continuous, and the acceleration jumps from row to row.
    """

    time: Array
    """(m,) [s]."""
    attitude: Array
    """(m, 4), of continuous sign."""
    rate: Array | None = None
    """(m, 3) [rad/s, body]."""

    @classmethod
    def read(cls, path: Path) -> "AttitudeTable":
        """The table of a file.

        Raises:
            LogError: it cannot be read, has no attitude, or states a rate that is not its own.
        """
        table = ManoeuvreTable(path)
        euler, quaternion = table.group(("roll", "pitch", "yaw")), table.group("wxyz")
        if euler is None and quaternion is None:
            raise table.file.fault(
                f"has no attitude among its columns {', '.join(table.file.header)}",
                "name four of them w, x, y, z, or three roll, pitch, yaw",
            )
        if quaternion is not None:
            value, layout, names = table.values(quaternion, "1"), "wxyz", quaternion.columns
        else:
            value = table.values(cast(_Group, euler), "rad")[:, ::-1]
            layout, names = "euler_zyx", cast(_Group, euler).columns
            _check_radians(table, value, names)
        rows = TimedRows(table.time, value, np.arange(len(value)), ())
        turned, _ = attitude(rows, layout, False, table.file, path.name)
        step = 2.0 * np.arccos(np.clip(np.abs((turned[1:] * turned[:-1]).sum(axis=1)), 0.0, 1.0))
        if step.size and step.max() > WIDEST:
            row = int(np.argmax(step)) + 1
            raise table.file.fault(
                f"turns by {np.degrees(step[row - 1]):.3g} deg from the row before, and which way "
                "round is not known",
                "add rows between them",
                row,
            )
        rated = table.group("xyz", RATES)
        if rated is None:
            return cls(table.time, turned)
        rate = table.values(rated, "rad/s")
        _check_rate(table, turned, rate, rated.columns)
        return cls(table.time, turned, rate)

    def save(self, path: Path) -> None:
        """Write attitudes as a table that `read` takes, `time,w,x,y,z`."""
        rows = np.column_stack([self.time, self.attitude]) + 0.0  # no -0
        lines = [",".join(f"{value:.9g}" for value in row) for row in rows.tolist()]
        write_whole(path, "\n".join(["time,w,x,y,z", *lines]) + "\n")

    def at(self, time: float | Array) -> tuple[Array, Array, Array]:
        """Attitude (..., 4), rate and acceleration (..., 3) [rad/s, rad/s^2, body] at times."""
        times = np.asarray(time, dtype=np.float64)
        inside = (times > self.time[0]) & (times < self.time[-1])
        if len(self.time) == 1:
            rest = np.zeros((*times.shape, 3))
            return np.broadcast_to(self.attitude[0], (*times.shape, 4)), rest, rest
        held = np.clip(times, self.time[0], self.time[-1])
        value, slope, bend = (spline(held) for spline in self._splines)
        square = (value * value).sum(axis=-1, keepdims=True)
        rate = 2.0 * multiply(conjugate(value), slope)[..., 1:] / square
        stretch = (value * slope).sum(axis=-1, keepdims=True) / square
        turning = 2.0 * multiply(conjugate(value), bend)[..., 1:] / square - 2.0 * rate * stretch
        moving = inside[..., None]
        return (
            value / np.sqrt(square),
            np.where(moving, rate, 0.0),
            np.where(moving, turning, 0.0),
        )

    @cached_property
    def _splines(self) -> tuple[Any, Any, Any]:
        """The quaternion's numbers, not yet of length 1, and their derivatives."""
        from scipy.interpolate import CubicHermiteSpline, CubicSpline

        if self.rate is None:
            spline = CubicSpline(self.time, self.attitude, bc_type="clamped")
        else:
            pure = np.concatenate([np.zeros((len(self.rate), 1)), self.rate], axis=1)
            slopes = 0.5 * multiply(self.attitude, pure)
            spline = CubicHermiteSpline(self.time, self.attitude, slopes)
        return spline, spline.derivative(), spline.derivative(2)


def _check_radians(table: ManoeuvreTable, value: Array, names: Sequence[str]) -> None:
    """Degrees that nobody called so turn the body far oftener than it turned."""
    stated = any(table.file.units.get(name) or stated_unit(name) for name in names)
    most = float(np.abs(value).max())
    if not stated and most > 2.0 * np.pi:
        row = int(np.argmax(np.abs(value).max(axis=1)))
        raise table.file.fault(
            f"its angles reach {most:.4g}, and no column states a unit",
            "write [deg] behind their names, or [rad] if the body turns on and on",
            row,
        )


def _check_rate(table: ManoeuvreTable, turned: Array, rate: Array, names: Sequence[str]) -> None:
    """A rate in other units or axes than it is taken for goes another way than the attitude."""
    from twin.rotation import to_rotation_vector

    went = to_rotation_vector(multiply(conjugate(turned[:-1]), turned[1:]))
    says = 0.5 * np.diff(table.time)[:, None] * (rate[1:] + rate[:-1])
    off = np.abs(says - went).sum()
    if off > 0.5 * max(np.abs(went).sum(), np.abs(says).sum()) + 1e-3:
        raise table.file.fault(
            f"its columns {', '.join(names)} are not the rate of its attitude: they turn the body "
            f"by {np.degrees(np.abs(says).sum()):.3g} deg, and it turns by "
            f"{np.degrees(np.abs(went).sum()):.3g} deg",
            "give the rate in rad/s or with its unit, in body axes, or leave it out",
        )


class TorqueProfile(Protocol):
    """Torque on the body over time."""

    @property
    def end(self) -> float | None:
        """Of the last that is stated [s]; None: it goes on."""
        ...

    def mean(self, start: float, stop: float) -> Array:
        """(3,) over a time [N m, body]."""
        ...


@dataclass(frozen=True)
class TorqueWaves:
    """Waves of torque, at their whole amplitude from time 0."""

    waves: tuple[Wave, ...]
    """Amplitudes in N m."""

    end: float | None = None

    def mean(self, start: float, stop: float) -> Array:
        """(3,) [N m, body]: what the waves are in the middle."""
        total = np.zeros(3)
        for wave in self.waves:
            total[wave.axis] += wave.value(0.5 * (start + stop))
        return total


@dataclass(frozen=True)
class TorqueTable:
    """Torque of a table: a row holds until the next one, the last to the end, as commands do."""

    time: Array
    """(m,) [s]."""
    torque: Array
    """(m, 3) [N m, body]; none before the first row."""

    @classmethod
    def read(cls, path: Path) -> "TorqueTable":
        """The table of a file.

        Raises:
            LogError: it cannot be read, or has no torque.
        """
        table = ManoeuvreTable(path)
        group = table.group("xyz")
        if group is None:
            raise table.file.fault(
                f"has no torque among its columns {', '.join(table.file.header)}",
                "name three of them x, y, z, or torque_x, torque_y, torque_z",
            )
        return cls(table.time, table.values(group, "N m"))

    @property
    def end(self) -> float | None:
        """When the last row begins [s]."""
        return float(self.time[-1])

    def mean(self, start: float, stop: float) -> Array:
        """(3,) [N m, body], to the last row's share."""
        edges = np.concatenate([[-np.inf], self.time, [np.inf]])
        share = np.clip(np.minimum(edges[1:], stop) - np.maximum(edges[:-1], start), 0.0, None)
        return (share[1:, None] * self.torque).sum(axis=0) / (stop - start)


ACTUATORS = ("wheels", "gyros", "thrusters")
"""That take a torque profile."""


def parse_torque(text: str) -> tuple[TorqueProfile, str]:
    """A torque profile and the actuators that it names, of `[wheels:|gyros:|thrusters:]PROFILE`.

    PROFILE is a file with a table, or waves in N m; without actuators they are "".

    Raises:
        UsageError: neither; says what would do.
        LogError: a file that cannot be read.
    """
    first, colon, rest = text.partition(":")
    actuators, profile = (first, rest) if colon and first in ACTUATORS else ("", text)
    if is_wave(profile):
        return TorqueWaves(parse_waves(profile, "torque")), actuators
    if is_table(profile):
        return TorqueTable.read(Path(profile)), actuators
    raise UsageError(
        f"torque {text!r} is neither a table (FILE.csv, FILE.parquet) nor waves in N m ({WAVES}); "
        f"{', '.join(f'{name}:' for name in ACTUATORS)} may stand before it"
    )
