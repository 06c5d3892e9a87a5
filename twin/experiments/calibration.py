"""Calibration of gyros, accelerometers and magnetometers from logs, with 95 % intervals.

A sensor shows T x + b of the truth x, T = 1 + e on the diagonal and symmetric off it (axes that are
not square), b its constant error: the effects `*_scale` and `*_bias` of the catalogue.

- Accelerometer: at rest it shows gravity, whatever the attitude: |T^-1 (shown - b)| = g, by least
  squares over poses. Six poses along the axes tell bias and scale, nine in general directions all
  nine numbers. F. Ferraris, U. Grimaldi and M. Parvis, Sensors and Materials 7 (1995); I. Skog and
  P. Haendel, IMEKO World Congress (2006).
- Magnetometer: likewise with the field of the room, sample by sample (the ellipsoid). Where its
  strength is not stated, the mean scale stays open and is set to 1.
- Gyro: bias, and white noise, bias instability and rate random walk by the Allan deviation of the
  longest stretch at rest (IEEE Std 952). Beside an attitude, scale, misalignment and lag by
  `twin.strapdown`; else scale by whole turns about one axis between two rests (Ferraris).

Residuals of a sample's neighbours are alike, so a magnetometer's intervals come from the scatter
between stretches of time (a sandwich covariance); those of poses from their residuals.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from twin.errors import UsageError
from twin.files import write_whole
from twin.interval import Interval
from twin.noise.stream import SlowNoise, noise_of, slow_noise
from twin.recording import Recording, Series, open_log
from twin.shown import Shown
from twin.strapdown import compare_gyro
from twin.strapdown.compare import NAMES

Array = NDArray[np.float64]
Kind = Literal["gyro", "accelerometer", "magnetometer"]
KINDS: tuple[Kind, ...] = ("gyro", "accelerometer", "magnetometer")
Say = Callable[[str], None]
GRAVITY = 9.81
"""Unless a log states it [m/s^2]."""
WINDOW = 0.5
"""Over which a sensor must be still to be at rest [s]."""
SHORTEST = 1.0
"""Of a pose [s]."""
STILL = 3.0
"""Times the scatter of the calmest tenth of windows that a window at rest may have."""
TURNING = 0.05
"""Difference from the longest rest above which a gyro turns steadily [rad/s]."""
SAME_POSE = np.radians(5.0)
"""Between two rests that count as one pose [rad]."""
FEWEST_POSES, ALL_POSES = 6, 9
"""From which bias and scale, and axes that are not square, are fitted."""
BLOCK = 2.0
"""Of a magnetometer's samples that scatter together [s]."""
FEWEST_BLOCKS = 15
LARGEST_ERROR = 0.5
"""Of a scale, or of the angle between axes, that is still a sensor's."""
COVERED = 0.15
"""Least singular value of the directions that a sensor was turned to, over the largest."""
WHOLE_TURN, TURN_SHARE = 0.05, 0.98
"""A turn is whole within this share of 360 deg, and about one axis where so much of the path is."""
TURN_ERROR = np.radians(1.0)
"""1 sigma of where a hand ends a whole turn, ASSUMED [rad]."""
UNITS: dict[Kind, str] = {"gyro": "rad/s", "accelerometer": "m/s^2", "magnetometer": "T"}
PAIRS = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class CalibratedNumber:
    """One number of a calibration."""

    name: str
    """`bias_x`, `scale_error_x`, `skew_xy`, `noise_x`, ..."""
    unit: str
    interval: Interval
    """Bounds are NaN where nothing tells them."""


@dataclass(frozen=True)
class Calibration(Shown):
    """What logs say of a sensor."""

    kind: Kind
    sources: tuple[str, ...]
    numbers: tuple[CalibratedNumber, ...]
    before: float
    """Rms error of the measured length as shown, in its unit; NaN of a gyro,"""
    after: float
    """and calibrated."""
    directions: Array
    """(m, 3) what the fit used: means of poses, or samples; as shown."""
    corrected: Array
    """(m, 3) the same, calibrated."""
    length: float
    """Of gravity or field [SI]; NaN of a gyro."""
    allan: SlowNoise | None
    """Of a gyro at rest."""
    remarks: tuple[str, ...]

    def number(self, name: str) -> Interval | None:
        """A number by its name."""
        return next((item.interval for item in self.numbers if item.name == name), None)

    def write(self, path: Path) -> None:
        """Write what a platform's folder takes as calibration.toml.

        Raises:
            UsageError: nothing of it is an effect of the catalogue.
        """
        names = {"bias": f"{self.kind}_bias", "scale_error": f"{self.kind}_scale"}
        if self.kind == "gyro":
            names["scale_error"] = "gyro_scale_factor"
        keys = {"bias": "bias", "scale_error": "error"}
        lines = [f"# {self.kind}, by twin calibrate from {', '.join(self.sources)}"]
        for part, effect in names.items():
            found = [self.number(f"{part}_{axis}") for axis in "xyz"]
            if any(item is None for item in found):
                continue
            values = ", ".join(f"{item.value:.6g}" for item in found if item is not None)
            halves = ", ".join(
                f"{0.5 * (item.high - item.low):.2g}" for item in found if item is not None
            )
            lines += [f"[effects.{effect}]", f"{keys[part]} = [{values}]  # 95 %: +- {halves}"]
        if len(lines) == 1:
            raise UsageError(f"nothing of this calibration of a {self.kind} can be written")
        write_whole(path, "\n".join(lines) + "\n")


def calibrate(
    kind: str,
    logs: str | Path | Recording | Sequence[str | Path | Recording],
    *,
    gravity: float | None = None,
    field: float | None = None,
    say: Say = lambda _: None,
) -> Calibration:
    """Bias, scale and noise of a sensor from logs, with 95 % intervals.

    Args:
        kind: `gyro`, `accelerometer` or `magnetometer`.
        logs: at least one, with that stream.
        gravity: [m/s^2]; None: what the first log states, else 9.81.
        field: strength of the magnetic field [T]; None: what the first log states, else unknown.
        say: takes the name of each log.

    Raises:
        UsageError: another kind, or logs that do not show it.
    """
    if kind not in KINDS:
        raise UsageError(f"{kind!r} cannot be calibrated; give one of {', '.join(KINDS)}")
    several = [logs] if isinstance(logs, str | Path | Recording) else list(logs)
    if not several:
        raise UsageError("no log is given")
    recordings: list[Recording] = []
    for item in several:
        say(str(item) if isinstance(item, str | Path) else item.source)
        log = item if isinstance(item, Recording) else open_log(Path(item))
        if kind not in log or log[kind].value.shape[1] != 3 or not len(log[kind]):
            raise UsageError(f"{log.source} has no {kind} about x, y and z")
        recordings.append(log)
    stated = recordings[0].provenance.get("environment") or {}
    if kind == "gyro":
        return _gyro(recordings)
    if kind == "accelerometer":
        size = gravity or float(
            stated.get("gravity") or recordings[0].provenance.get("gravity") or GRAVITY
        )
        return _accelerometer(recordings, size)
    vector = stated.get("magnetic_field")
    known = field if field is not None else float(np.linalg.norm(vector)) if vector else None
    return _magnetometer(recordings, known or None)


@dataclass(frozen=True)
class Rest:
    """A stretch in which a sensor stands still."""

    start: int
    """First sample,"""
    stop: int
    """one past the last."""


def rests(series: Series) -> list[Rest]:
    """Stretches at rest of at least `SHORTEST`, by the scatter of all columns over `WINDOW`."""
    size = max(round(WINDOW * series.rate), 4)
    count = len(series) // size
    if count < 2:
        return []
    windows = series.value[: count * size].reshape(count, size, -1)
    scatter, level = windows.std(axis=1), windows.mean(axis=1)
    calm = np.maximum(np.quantile(scatter, 0.1, axis=0), 1e-12)
    still = np.all(scatter < STILL * calm, axis=1)
    jumps = np.any(np.abs(np.diff(level, axis=0)) > STILL * calm, axis=1)
    result: list[Rest] = []
    first: int | None = None
    for place in range(count + 1):
        ends = place == count or not still[place] or (place > 0 and jumps[place - 1])
        if first is not None and ends:
            result.append(Rest(first * size, place * size))
            first = None
        if place < count and still[place] and first is None:
            first = place
    long = SHORTEST * series.rate
    result = [rest for rest in result if rest.stop - rest.start >= long]
    if series.unit != "rad/s" or not result:
        return result
    # a steady turn scatters no more than a rest
    longest = max(result, key=lambda rest: rest.stop - rest.start)
    bias = series.value[longest.start : longest.stop].mean(axis=0)
    means = [series.value[rest.start : rest.stop].mean(axis=0) for rest in result]
    near = [bool(np.all(np.abs(mean - bias) < TURNING)) for mean in means]
    return [rest for rest, keep in zip(result, near, strict=True) if keep]


def _transform(numbers: Array) -> tuple[Array, Array]:
    """T (3, 3) and b of (6,) or (9,) numbers: bias, scale errors, and what is not square."""
    matrix = np.diag(1.0 + numbers[3:6])
    for (i, j), value in zip(PAIRS, numbers[6:], strict=False):
        matrix[i, j] = matrix[j, i] = value
    return matrix, numbers[:3]


def corrected(shown: Array, numbers: Array) -> Array:
    """The truth (m, 3) of what a sensor with these errors shows (m, 3)."""
    matrix, bias = _transform(numbers)
    return (shown - bias) @ np.linalg.inv(matrix).T


def _accelerometer(recordings: Sequence[Recording], gravity: float) -> Calibration:
    poses: list[Array] = []
    weights: list[float] = []
    for log in recordings:
        series = log["accelerometer"]
        for rest in rests(series):
            part = series.value[rest.start : rest.stop]
            mean = part.mean(axis=0)
            weights.append(float(len(part)))
            poses.append(mean)
    means = _distinct_poses(poses, weights)
    if len(means) < FEWEST_POSES:
        raise UsageError(
            f"the logs hold {len(means)} poses at rest of at least {SHORTEST:g} s; an "
            f"accelerometer needs {FEWEST_POSES}: each axis up and down, or "
            f"{ALL_POSES} in general directions"
        )
    _check_directions(means, "accelerometer")
    count = 9 if len(means) >= ALL_POSES and _tells_skew(means) else 6
    numbers, covariance, quantile = _ellipsoid(means, gravity, count, None)
    remarks = [f"{len(means)} poses, gravity {gravity:g} m/s^2"]
    if len(means) <= count:
        remarks.append(
            "no further pose checks the fit: intervals come from the sensor's noise alone"
        )
        white = [noise_of(log["accelerometer"]) for log in recordings]
        noise = np.sqrt(np.mean(np.square(white)))
        error = float(noise) / np.sqrt(float(np.min(weights)))
        covariance, quantile = covariance * error**2, 1.96
    return _calibration(
        "accelerometer", recordings, means, numbers, covariance, quantile, gravity, remarks
    )


def _distinct_poses(poses: Sequence[Array], weights: Sequence[float]) -> Array:
    """(m, 3) means of the poses, rests in the same direction taken together."""
    sums: list[tuple[Array, float]] = []
    for pose, weight in zip(poses, weights, strict=True):
        for place, (total, whole) in enumerate(sums):
            mean = total / whole
            cosine = float(mean @ pose) / max(
                float(np.linalg.norm(mean) * np.linalg.norm(pose)), 1e-300
            )
            if np.arccos(np.clip(cosine, -1.0, 1.0)) < SAME_POSE:
                sums[place] = total + weight * pose, whole + weight
                break
        else:
            sums.append((weight * pose, weight))
    return np.array([total / whole for total, whole in sums]).reshape(-1, 3)


def _check_directions(shown: Array, kind: str) -> None:
    spread = np.linalg.svd(shown - shown.mean(axis=0), compute_uv=False)
    if not len(spread) or spread[-1] < COVERED * spread[0]:
        raise UsageError(
            f"the logs turn the {kind} too little: its readings lie near a plane or a line; turn "
            "it so that each axis points up and down"
        )


def _tells_skew(means: Array) -> bool:
    """Whether poses lie off the axes, so that axes that are not square show."""
    unit = means / np.linalg.norm(means, axis=1, keepdims=True)
    products = np.stack([unit[:, i] * unit[:, j] for i, j in PAIRS], axis=1)
    return bool(np.all(np.sum(np.square(products), axis=0) > 0.2))


def _ellipsoid(
    shown: Array, length: float, count: int, blocks: NDArray[np.intp] | None
) -> tuple[Array, Array, float]:
    """Bias and scale, and what is not square, by the length of what is shown.

    Args:
        shown: (m, 3).
        length: of the truth.
        count: 6 or 9 numbers.
        blocks: (m,) of samples that scatter together; None: each by itself.

    Returns:
        (9,) the numbers, (9, 9) their covariance, and the quantile of 95 %.
    """
    middle = 0.5 * (shown.min(axis=0) + shown.max(axis=0))
    start = np.concatenate([middle / length, np.zeros(count - 3)])

    def residual(x: Array) -> Array:
        numbers = np.concatenate([length * x[:3], x[3:]])
        return np.linalg.norm(corrected(shown, numbers), axis=1) / length - 1.0

    reach = np.ptp(shown, axis=0) / length
    most = np.concatenate([start[:3] + reach, np.full(count - 3, LARGEST_ERROR)])
    least = np.concatenate([start[:3] - reach, np.full(count - 3, -LARGEST_ERROR)])
    solved = least_squares(
        residual, start, bounds=(least, most), x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    if np.any(solved.active_mask):
        raise UsageError(
            "the readings lie on no ellipsoid: either the sensor was turned too little, or what it "
            "shows is not of constant length (iron, currents or motion nearby)"
        )
    slope, left = np.asarray(solved.jac), np.asarray(solved.fun)
    inverse = np.linalg.pinv(slope.T @ slope)
    if blocks is None:
        degrees = len(shown) - count
        spread = inverse * (float(left @ left) / degrees if degrees > 0 else 1.0 / length**2)
    else:
        scores = np.stack([slope[blocks == k].T @ left[blocks == k] for k in np.unique(blocks)])
        degrees = len(scores) - count
        spread = inverse @ (scores.T @ scores) @ inverse * len(scores) / max(degrees, 1)
    numbers, covariance = np.zeros(9), np.zeros((9, 9))
    size = np.concatenate([np.full(3, length), np.ones(count - 3)])
    numbers[:count] = size * solved.x
    covariance[:count, :count] = spread * np.outer(size, size)
    return numbers, covariance, float(student.ppf(0.975, max(degrees, 1)))


def _magnetometer(recordings: Sequence[Recording], field: float | None) -> Calibration:
    shown = np.concatenate([log["magnetometer"].value for log in recordings])
    blocks: list[NDArray[np.intp]] = []
    for log in recordings:
        series = log["magnetometer"]
        first = blocks[-1].max() + 1 if blocks else 0
        blocks.append((first + (series.time - series.time[0]) // BLOCK).astype(np.intp))
    block = np.concatenate(blocks)
    good = np.isfinite(shown).all(axis=1)
    shown, block = shown[good], block[good]
    if len(np.unique(block)) < FEWEST_BLOCKS:
        raise UsageError(
            f"the logs hold {len(np.unique(block))} stretches of {BLOCK:g} s; a magnetometer needs "
            f"{FEWEST_BLOCKS}: turn it through all attitudes for half a minute or more"
        )
    _check_directions(shown, "magnetometer")
    remarks = [f"{len(shown)} samples in {len(np.unique(block))} stretches of {BLOCK:g} s"]
    length = field or _mean_radius(shown)
    numbers, covariance, quantile = _ellipsoid(shown, length, 9, block)
    if field is None:
        # one factor of field and scale is open: the mean scale is 1
        mean = float(numbers[3:6].mean())
        length *= 1.0 + mean
        numbers[3:6] = (1.0 + numbers[3:6]) / (1.0 + mean) - 1.0
        numbers[6:] /= 1.0 + mean
        less = np.eye(9)
        less[3:6, 3:6] -= 1.0 / 3.0
        covariance = less @ covariance @ less.T
        remarks.append(
            f"the field's strength is not stated: {1e6 * length:.2f} uT is taken, by which the "
            "mean scale error is 0; state it with --field"
        )
    else:
        remarks.append(f"field {1e6 * length:.2f} uT")
    return _calibration(
        "magnetometer", recordings, shown, numbers, covariance, quantile, length, remarks
    )


def _mean_radius(shown: Array) -> float:
    """Of the sphere that fits best: |y|^2 = 2 y . c + r^2 - |c|^2."""
    columns = np.column_stack([2.0 * shown, np.ones(len(shown))])
    scale = np.linalg.norm(columns, axis=0)
    solved = np.linalg.lstsq(columns / scale, np.sum(np.square(shown), axis=1), rcond=None)[0]
    centre = (solved / scale)[:3]
    return float(np.mean(np.linalg.norm(shown - centre, axis=1)))


def _calibration(
    kind: Kind,
    recordings: Sequence[Recording],
    shown: Array,
    numbers: Array,
    covariance: Array,
    quantile: float,
    length: float,
    remarks: Sequence[str],
) -> Calibration:
    half = quantile * np.sqrt(np.diag(covariance))
    names = [
        *((f"bias_{axis}", UNITS[kind]) for axis in "xyz"),
        *((f"scale_error_{axis}", "1") for axis in "xyz"),
        *((f"skew_{'xyz'[i]}{'xyz'[j]}", "rad") for i, j in PAIRS),
    ]
    known = [
        CalibratedNumber(name, unit, Interval(float(v), float(v - h), float(v + h)))
        for (name, unit), v, h in zip(names, numbers, half, strict=True)
        if h > 0.0
    ]
    white = np.sqrt(np.mean([np.square(noise_of(log[kind])) for log in recordings], axis=0))
    known += [
        CalibratedNumber(f"noise_{axis}", UNITS[kind], Interval(float(v), np.nan, np.nan))
        for axis, v in zip("xyz", white, strict=True)
    ]
    right = corrected(shown, numbers)
    before, after = (
        float(np.sqrt(np.mean(np.square(np.linalg.norm(values, axis=1) - length))))
        for values in (shown, right)
    )
    sources = tuple(log.source for log in recordings)
    return Calibration(
        kind, sources, tuple(known), before, after, shown, right, length, None, tuple(remarks)
    )


def _gyro(recordings: Sequence[Recording]) -> Calibration:
    first = recordings[0]
    series, stops = (
        first["gyro"],
        [(log, rest) for log in recordings for rest in rests(log["gyro"])],
    )
    numbers: list[CalibratedNumber] = []
    remarks: list[str] = []
    allan: SlowNoise | None = None
    bias = np.zeros(3)
    if stops:
        log, rest = max(stops, key=lambda item: item[1].stop - item[1].start)
        series = log["gyro"]
        still = series.value[rest.start : rest.stop]
        allan = slow_noise(series.time[rest.start : rest.stop], still)
        # the bias wanders: its mean over a rest is as good as the Allan deviation at that length
        bias, spread = still.mean(axis=0), allan.deviation[-1] / np.sqrt(2.0)
        longest = float(series.time[rest.stop - 1] - series.time[rest.start])
        remarks.append(f"at rest for {longest:.1f} s, the longest of {len(stops)} stretches")
        numbers += _triple("bias", "rad/s", bias, 1.96 * spread)
        for name, values, unit in (
            ("random_walk", allan.random_walk, "rad/s^0.5"),
            ("bias_instability", allan.bias_instability, "rad/s"),
            ("rate_random_walk", allan.rate_random_walk, "rad/s^1.5"),
        ):
            share = _allan_share(allan)
            for axis, value in zip("xyz", values.tolist(), strict=True):
                if np.isfinite(value):
                    ends = Interval(value, value * (1.0 - share), value * (1.0 + share))
                    numbers.append(CalibratedNumber(f"{name}_{axis}", unit, ends))
        if not np.isfinite(allan.bias_instability).any():
            remarks.append("the rest is too short to show a bias instability")
    else:
        remarks.append(f"no stretch at rest of {SHORTEST:g} s: no Allan deviation")
    with_attitude = [log for log in recordings if "attitude" in log]
    if with_attitude:
        result = compare_gyro(with_attitude[0])
        remarks.append(f"scale and axes against the attitude of {with_attitude[0].source}")
        names = {"gyro_scale_factor": "scale_error", "gyro_misalignment": "misalignment"}
        names |= {"gyro_axes_not_square": "skew", "gyro_bias": "bias_moving", "clock_lag": "lag"}
        for (fault, column), value, half in zip(
            NAMES, result.value.tolist(), result.half_width.tolist(), strict=True
        ):
            if np.isfinite(half):
                name = f"{names[fault.name]}_{column}".rstrip("_")
                ends = Interval(value, value - half, value + half)
                numbers.append(CalibratedNumber(name, fault.unit, ends))
    else:
        turned = _whole_turns(recordings, bias)
        for axis, errors in turned.items():
            mean, count = float(np.mean(errors)), len(errors)
            half = 1.96 * TURN_ERROR / (2.0 * np.pi) / np.sqrt(count)
            numbers.append(
                CalibratedNumber(
                    f"scale_error_{axis}", "1", Interval(mean, mean - half, mean + half)
                )
            )
        if turned:
            axes = ", ".join(f"{len(errors)} about {axis}" for axis, errors in turned.items())
            remarks.append(
                f"whole turns: {axes}; ASSUMED that a hand ends one within "
                f"{np.degrees(TURN_ERROR):g} deg (1 sigma)"
            )
    if not numbers:
        raise UsageError(
            "the logs show nothing of the gyro: leave it at rest for some minutes, turn it by "
            "whole turns about its axes between two rests, or record an attitude beside it"
        )
    sources = tuple(log.source for log in recordings)
    nothing = np.zeros((0, 3))
    return Calibration(
        "gyro",
        sources,
        tuple(numbers),
        np.nan,
        np.nan,
        nothing,
        nothing,
        np.nan,
        allan,
        tuple(remarks),
    )


def _triple(name: str, unit: str, value: Array, half: Array) -> list[CalibratedNumber]:
    return [
        CalibratedNumber(f"{name}_{axis}", unit, Interval(float(v), float(v - h), float(v + h)))
        for axis, v, h in zip("xyz", value, half, strict=True)
    ]


def _allan_share(allan: SlowNoise) -> float:
    """Half a 95 % interval of a deviation, as a share: by the averages at a middle length."""
    averages = (allan.stop - allan.start) / allan.tau[len(allan.tau) // 2]
    return float(1.96 / np.sqrt(2.0 * max(averages - 1.0, 1.0)))


def _whole_turns(recordings: Sequence[Recording], bias: Array) -> dict[str, list[float]]:
    """Scale errors by turns of 360 deg between two rests, by axis."""
    result: dict[str, list[float]] = {}
    for log in recordings:
        series = log["gyro"]
        places = rests(series)
        for before, after in zip(places, places[1:], strict=False):
            part = slice(before.stop - 1, after.start + 1)
            rate, time = series.value[part] - bias, series.time[part]
            path = np.asarray(np.trapezoid(rate, time, axis=0))
            length = np.asarray(np.trapezoid(np.abs(rate), time, axis=0))
            axis = int(np.argmax(length))
            turns = round(abs(path[axis]) / (2.0 * np.pi))
            if not turns or length[axis] < TURN_SHARE * float(np.linalg.norm(length)):
                continue
            share = abs(path[axis]) / (2.0 * np.pi * turns)
            if abs(share - 1.0) < WHOLE_TURN:
                result.setdefault("xyz"[axis], []).append(float(share - 1.0))
    return dict(sorted(result.items()))
