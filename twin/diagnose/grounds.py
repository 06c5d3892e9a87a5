"""Whether logs are ground enough for a verdict: of this machine, long enough, and moved."""

from collections.abc import Sequence

import numpy as np

from twin.diagnose.explanation import Explanation
from twin.errors import UsageError
from twin.identify.excitation import BLIND
from twin.identify.prediction_error import NORMAL
from twin.platform import Platform
from twin.predict.body import Body
from twin.predict.log.possible import OF_PARTS, check_possible
from twin.predict.log.usable import within_range
from twin.predict.parameters.base import BaseParameters
from twin.recording import Recording

ENOUGH = 60
"""Numbers that logs must hold for each unknown. With fewer, the noise and the motion along which
causes are weighed are themselves uncertain, and what is named is chance."""


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
            why = "".join(f"{sentence}; " for sentence in said)
            raise UsageError(
                f"{recording.source}: {why}nothing is left of {', '.join(empty)}: look at its "
                "unit, or at the range in platform.toml"
                if said
                else f"{recording.source}: {', '.join(empty)} holds no rows; record it again, or "
                "leave the stream out"
            )
        _check_parts(recording, platform)
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
