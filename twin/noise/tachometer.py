"""Wheel speeds that a tachometer gives without a sign, and the signs that the log tells.

A counter of pulses knows no direction: where the wheel runs through zero, the size of its speed
comes down and leaves as steeply as it came. What drives the wheel goes on there, so a command, or
the turning of the body against the wheel, tells the sign on either side. A stretch between two
passages of zero whose sign nothing tells is not used.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.noise.stream import noise_of
from twin.recording import Recording, Series

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DRIVES = ("command_wheel_torque", "command_wheel_duty")
"""Streams that say what drives a wheel, of which a positive one speeds it up."""
NEAR = 5.0
"""Sigmas of noise within which a speed is taken to pass zero."""
FEWEST = 10
"""Rows of a stretch that is looked at."""
SIDE = 12
"""Rows before and after a passage of zero, through which lines are laid."""
ALIKE = 0.35
"""Share of their mean by which the slopes before and after may differ."""
SURE = 6.0
"""Sigmas by which a slope, or the share of the drive in a speed's change, differs from none."""
KINKS = 2
"""Passages of zero, at least, where nothing but the speed itself tells of a lost sign."""


@dataclass(frozen=True)
class _Stretch:
    """Rows first to last of a wheel between two passages of zero."""

    first: int
    last: int
    sign: float
    """By what drives the wheel; 0 where nothing tells."""


def with_signs(recording: Recording, axes: Sequence[Array] = ()) -> tuple[Recording, list[str]]:
    """A log whose wheel speeds have signs, and a sentence on each wheel that had none.

    Args:
        recording: a log.
        axes: of the wheels in body axes, (3,) each; without them no gyro tells a sign.
    """
    series = recording.streams.get("wheel_speed")
    if series is None or len(series) < 4 * FEWEST or (series.value < 0.0).all(axis=0).any():
        return recording, []
    noise = noise_of(series)
    value, lost, said = series.value.copy(), np.zeros(len(series), dtype=np.bool_), list[str]()
    for wheel, name in enumerate(series.columns):
        speed = value[:, wheel]
        if speed.min() < 0.0:
            continue
        passages, unknown = _passages(speed, float(noise[wheel]))
        if not passages:
            continue
        kinks = sum(_is_kink(series.time, speed, row) for row in passages)
        told, by = _stretches(recording, series, wheel, passages, axes)
        signs = {stretch.sign for stretch in told}
        head = f"wheel_speed of {name} is never negative"
        if {-1.0, 1.0} <= signs:
            for stretch in told:
                value[stretch.first : stretch.last, wheel] *= stretch.sign or 1.0
                unknown[stretch.first : stretch.last] |= stretch.sign == 0.0
            lost |= unknown
            count = int(np.count_nonzero(unknown))
            rest = f"; {count} of {len(series)} samples whose sign it does not tell are not used"
            said.append(
                f"{head}, though {by} runs on where it is zero: the tachometer has no sign, and "
                f"{by} gives it{rest if count else ''}"
            )
        elif not signs & {-1.0, 1.0} and kinks >= KINKS:
            said.append(
                f"{head}, and leaves zero {kinks} times as steeply as it came: the tachometer has "
                "no sign, and nothing in the log gives it: wheel_speed is not used; add "
                f"{DRIVES[0]}"
            )
            streams = {key: item for key, item in recording.items() if key != "wheel_speed"}
            return replace(recording, streams=streams), said
    if not said:
        return recording, []
    signed = replace(series, value=value).only(~lost)
    return replace(recording, streams={**recording.streams, "wheel_speed": signed}), said


def _passages(speed: Array, noise: float) -> tuple[list[int], Mask]:
    """Rows of the least speed in each run of rows near zero that has others on both sides; and (n,)
    the rows amid a passage that are not near zero, whose sign nothing gives.

    Runs with fewer than FEWEST rows between them are one passage. One close to an end of the log
    counts too: so few rows beyond it have no sign either.
    """
    steps = np.abs(np.diff(speed))
    near = speed <= max(NEAR * noise, 2.0 * float(np.median(steps)), 1e-9)
    edges = np.flatnonzero(np.diff(np.r_[False, near, False].astype(np.int8))).reshape(-1, 2)
    amid = np.zeros(len(speed), dtype=np.bool_)
    if not len(edges):
        return [], amid
    apart = edges[1:, 0] - edges[:-1, 1] >= FEWEST
    firsts, lasts = edges[np.r_[True, apart], 0], edges[np.r_[apart, True], 1]
    rows: list[int] = []
    for first, last in zip(firsts.tolist(), lasts.tolist(), strict=True):
        amid[first:last] = ~near[first:last]
        if first > 0 and last < len(speed):
            rows.append(first + int(np.argmin(speed[first:last])))
    return rows, amid


def _is_kink(time: Array, speed: Array, row: int) -> bool:
    """Whether a speed comes to zero and leaves it along two lines of one steepness."""
    before, after = slice(max(row - SIDE, 0), row), slice(row + 1, row + 1 + SIDE)
    if len(speed[before]) < SIDE // 2 or len(speed[after]) < SIDE // 2:
        return False
    (down, down_sigma), (up, up_sigma) = (
        _slope(time[side] - time[row], speed[side]) for side in (before, after)
    )
    steep = -down > SURE * down_sigma and up > SURE * up_sigma
    return steep and abs(up + down) < ALIKE * (up - down)


def _slope(time: Array, value: Array) -> tuple[float, float]:
    """Of a line, and its standard deviation."""
    away = time - time.mean()
    slope = float(away @ value / (away @ away))
    left = value - value.mean() - slope * away
    sigma = np.sqrt(left @ left / max(len(time) - 2, 1) / (away @ away))
    return slope, max(float(sigma), 1e-12)


def _stretches(
    recording: Recording,
    series: Series,
    wheel: int,
    passages: Sequence[int],
    axes: Sequence[Array],
) -> tuple[list[_Stretch], str]:
    """The stretches between passages of zero, with the signs that the surest drive gives; and what
    that drive is called."""
    edges = [0, *passages, len(series)]
    best, by = [_Stretch(a, b, 0.0) for a, b in zip(edges, edges[1:], strict=False)], ""
    for name, drive in _drives(recording, series, wheel, axes):
        told = [
            _Stretch(a, b, _sign(series.time[a:b], series.value[a:b, wheel], drive[a:b]))
            for a, b in zip(edges, edges[1:], strict=False)
        ]
        if sum(item.sign != 0.0 for item in told) > sum(item.sign != 0.0 for item in best):
            best, by = told, name
    return best, by


def _drives(
    recording: Recording, series: Series, wheel: int, axes: Sequence[Array]
) -> list[tuple[str, Array]]:
    """What speeds the wheel up, up to a factor, between each row and the next (m,)."""
    result: list[tuple[str, Array]] = []
    for name in DRIVES:
        command = recording.streams.get(name)
        if command is not None and len(command) > 1 and command.value.shape[1] > wheel:
            result.append((name, _mean_held(command, series.time)[:, wheel]))
    gyro = recording.streams.get("gyro")
    if gyro is not None and len(gyro) > FEWEST and wheel < len(axes) and len(gyro.columns) == 3:
        # the body takes what the wheel gives
        about = gyro.interpolated_at(series.time) @ axes[wheel]
        result.append(("gyro", -np.gradient(about, series.time)))
    return result


def _mean_held(command: Series, time: Array) -> Array:
    """(m, k) mean of a held command from each time to the next."""
    steps = command.value[:-1] * np.diff(command.time)[:, None]
    whole = np.concatenate([np.zeros((1, command.value.shape[1])), np.cumsum(steps, axis=0)])
    integral = np.stack([np.interp(time, command.time, item) for item in whole.T], axis=-1)
    past = np.maximum(time - command.time[-1], 0.0)[:, None] * command.value[-1]
    mean = np.diff(integral + past, axis=0) / np.diff(time)[:, None]
    return np.concatenate([mean, mean[-1:]])


def _sign(time: Array, speed: Array, drive: Array) -> float:
    """Of a drive in the change of a speed's size, beside friction; 0 where none is sure."""
    if len(time) < 2 * FEWEST:
        return 0.0
    size = max(len(time) // 60, 2)  # means over some rows have less noise
    count = len(time) // size
    if count < FEWEST:
        size, count = 1, len(time)

    def means(x: Array) -> Array:
        return x[: count * size].reshape(count, size).mean(axis=1)

    at, level, push = means(time), means(speed), means(drive)
    change, middle = np.diff(level) / np.diff(at), 0.5 * (level[1:] + level[:-1])
    mean_push = 0.5 * (push[1:] + push[:-1])
    columns = np.stack([mean_push, middle, np.ones_like(middle)], axis=-1)
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    result, _, rank, _ = np.linalg.lstsq(columns / scale, change, rcond=1e-9)
    if rank < 3 or len(change) <= 3:
        # of a constant drive, the sign is that of a rise, which friction never makes
        pushed = float(mean_push.mean())
        return float(np.sign(pushed)) if (change > 0.0).all() else 0.0
    left = change - columns / scale @ result
    spread = np.linalg.pinv((columns / scale).T @ (columns / scale))
    sigma = float(np.sqrt(left @ left / (len(change) - 3) * spread[0, 0]))
    return float(np.sign(result[0])) if abs(float(result[0])) > SURE * sigma else 0.0
