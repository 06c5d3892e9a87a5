"""Whether logs are ground enough for a verdict: of this machine, long enough, and moved."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.explanation import Explanation
from twin.errors import UsageError
from twin.identify.excitation import BLIND
from twin.identify.prediction_error import NORMAL
from twin.platform import Platform
from twin.predict.body import Body
from twin.predict.log.possible import OF_PARTS, check_possible
from twin.predict.log.ranges import within_range
from twin.predict.parameters.base import BaseParameters
from twin.recording import Recording
from twin.signals import OF_MOTION
from twin.units import printed

Array = NDArray[np.float64]

OF_RATE = ("gyro", "joint_rate")
"""Streams of motion whose sensors have a range that a machine can leave."""

CLIPPED = 0.02
"""Share of all rows that must be at an end to speak of it."""
ENOUGH = 60
"""Numbers that logs must hold for each unknown. With fewer, the noise and the motion along which
causes are weighed are themselves uncertain, and what is named is chance."""
STRETCH = 5
"""Rows in a row of which at least two stretches must be there."""


def check_logs(recordings: Sequence[Recording], platform: Platform) -> None:
    """Look at logs before anything is fitted to them.

    Raises:
        UsageError: a log is of a machine with other or far smaller parts, a sensor of its motion
            was off or at the end of a range that nobody stated, or streams share no time.
    """
    for whole in recordings:
        recording, said = within_range(whole, platform)
        empty = [name for name, series in recording.items() if not len(series)]
        if empty:
            raise UsageError(
                f"{recording.source}: {'; '.join(said)}; nothing is left of "
                f"{', '.join(empty)}: look at its unit, or at the range in platform.toml"
            )
        _check_parts(recording, platform)
        _check_alive(recording)
        _check_ranges(recording)
        check_possible(recording, platform)


def check_numbers(bodies: Sequence[Body], base: BaseParameters) -> None:
    """Whether there is far more to predict than to find: noise and motion are of the same logs.

    Raises:
        UsageError: there is not.
    """
    held = sum(body.samples for body in bodies)
    sought = len(base.names) + sum(len(body.bias_scale) + body.start.width for body in bodies)
    if held < ENOUGH * sought:
        raise UsageError(
            f"the logs are too short: they hold {held} numbers of what {base.machine.platform.name}"
            f" did, for {sought} unknowns (base, biases and start); record some ten seconds or more"
        )


def check_seen(plain: Explanation) -> None:
    """Whether a model that leaves only noise has shown anything.

    Raises:
        UsageError: the logs leave every moment of inertia open, so that any torque could hide.
    """
    names, scale = plain.base.names, plain.base.scale
    half = NORMAL * np.sqrt(np.diag(plain.covariance))[: len(names)]
    moments = [i for i, name in enumerate(names) if name in ("J", "Jxx", "Jyy", "Jzz")]
    if moments and all(half[i] > BLIND * scale[i] for i in moments):
        platform = plain.base.machine.platform.name
        raise UsageError(
            f"these logs show no more than the sensors' noise: {platform} hardly moves in them, or "
            f"not for long enough to tell {', '.join(names[i] for i in moments)} to half of what "
            "is stated, and what a cause would do could not be seen either; that is no verdict on "
            "the model: record a run in which the machine turns about all its axes, with what "
            "drives it"
        )


def _check_parts(recording: Recording, platform: Platform) -> None:
    for parts, streams in OF_PARTS.items():
        if getattr(platform, parts):
            continue
        for name in streams:
            if name in recording and bool(np.any(recording[name].value)):
                raise UsageError(
                    f"{recording.source} has {name}, but {platform.name} has no {parts}: name "
                    "the log's own machine, or add the parts to its folder"
                )


def _check_alive(recording: Recording) -> None:
    for name in OF_MOTION:
        if name not in recording or len(recording[name]) < 2:
            continue
        value = recording[name].value
        if bool((value == value[:1]).all()):
            raise UsageError(
                f"{recording.source}: {name} is the same in all {len(value)} rows, which tells "
                "nothing of a machine that moves; if the sensor was off, leave the stream out"
            )


def _check_ranges(recording: Recording) -> None:
    """A rate that stays where no other value is beyond, again and again, is not the body's."""
    for name in OF_RATE:
        if name not in recording or not len(recording[name]):
            continue
        series = recording[name]
        for column, values in zip(series.columns, series.value.T, strict=True):
            for end in (float(values.max()), float(values.min())):
                at = values == end
                if abs(end) < 0.5 * float(np.abs(values).max()) or not _clipped(values, at):
                    continue
                size = printed(abs(end), series.unit)
                raise UsageError(
                    f"{recording.source}: {np.count_nonzero(at)} of {len(at)} rows of {name} "
                    f"{column} are exactly {printed(end, series.unit)} and none is beyond: it "
                    f"looks like the end of the sensor's range. State `range` = {abs(end):.6g} "
                    f"({size}) under [sensors.{name}] in platform.toml, and such rows are left out"
                )


def _clipped(values: Array, at: NDArray[np.bool_]) -> bool:
    """Whether rows at one end are many, in stretches, and more than a grid of values has there."""
    other = np.unique(values[~at], return_counts=True)[1].max(initial=1)
    lengths = np.diff(np.flatnonzero(np.diff(np.r_[False, at, False].astype(int))))[::2]
    many = np.count_nonzero(at) > max(CLIPPED * len(at), 10.0 * float(other))
    return bool(many and np.count_nonzero(lengths >= STRETCH) >= 2)
