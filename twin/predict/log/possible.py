"""Whether a log can be of its machine at all: its parts, clocks, sensors and stop."""

import numpy as np
from numpy.typing import NDArray

from twin.errors import UsageError
from twin.noise.cleaning import dead_words, is_needed
from twin.noise.stuck import OF_AXES, dead_axes
from twin.platform import Platform
from twin.predict.log.motion import Motion
from twin.predict.log.usable import turns_about_all_axes
from twin.recording import Recording
from twin.signals import OF_MOTION

Array = NDArray[np.float64]

OF_PARTS = {
    "wheels": ("wheel_speed", "command_wheel_torque", "command_wheel_speed", "command_wheel_duty"),
    "stages": ("stage_position", "command_stage_position"),
    "gimbals": ("gimbal_angle", "gimbal_rate", "command_gimbal_rate"),
    "thrusters": ("command_thruster",),
    "magnetorquers": ("command_dipole",),
}
"""Streams that only a machine with such parts has."""

BEYOND = 10.0
"""Times what a part can do at which its unit is doubted."""
BEYOND_STOP = np.radians(1.0)
"""By how much a stop may give way, or a level be off, before a log cannot be true of it [rad]."""

LOOK = "`twin show` tells what is read wrongly"
"""What to do about a lean that was none."""


class ImpossibleLog(UsageError):
    """A log that cannot be of its machine, both as they stand."""


def check_possible(recording: Recording, platform: Platform) -> None:
    """Whether a log can be of a machine, before anything is made of it.

    Raises:
        ImpossibleLog: parts did ten times what they can, streams share no time, or a sensor of the
            motion was off.
    """
    _check_sizes(recording, platform)
    _check_clocks(recording, platform)
    _check_alive(recording)
    if turns_about_all_axes(platform):
        _check_axes(recording)


def _check_sizes(recording: Recording, platform: Platform) -> None:
    """No part gives ten times what it can: then it is the unit."""
    torque = [wheel.torque_limit for wheel in platform.wheels]
    travel = [max(np.abs(stage.travel)) for stage in platform.stages]
    limits = {
        "command_wheel_torque": torque,
        "stage_position": travel,
        "command_stage_position": travel,
    }
    for name, most in limits.items():
        if name not in recording or not len(recording[name]):
            continue
        series = recording[name]
        reached, able = float(np.abs(series.value).max()), float(max(most, default=np.inf))
        if reached > BEYOND * able:
            raise ImpossibleLog(
                f"{recording.source}: {name} reaches {reached:.3g} {series.unit}, where "
                f"{platform.name} can at most {able:.3g} {series.unit}: it looks like "
                f"m{series.unit}, read as {series.unit}; state its unit in log.toml"
            )


def _check_clocks(recording: Recording, platform: Platform) -> None:
    """All that the prediction uses must share time with what shows the motion."""
    hinge = platform.base.kind == "hinge"
    shown = [s for s in (OF_MOTION[3:] if hinge else OF_MOTION[:3]) if s in recording]
    shown = [s for s in shown if len(recording[s])]
    if not shown:
        return
    shows = max(shown, key=lambda s: recording[s].time[-1] - recording[s].time[0])
    for name in (*OF_MOTION, *platform.commands, *(s for two in OF_PARTS.values() for s in two)):
        if name == shows or name not in recording or len(recording[name]) == 0:
            continue
        if said := apart(recording, name, shows):
            raise ImpossibleLog(f"{recording.source}: {said}")


def apart(recording: Recording, name: str, other: str) -> str:
    """That two streams share no time, as a sentence; empty where they do."""
    time, main = recording[name].time, recording[other].time
    # what was commanded before still holds
    if time[0] <= main[-1] and (time[-1] >= main[0] or name.startswith("command_")):
        return ""
    return (
        f"{name} runs from {time[0]:.6g} to {time[-1]:.6g} s, {other} from {main[0]:.6g} to "
        f"{main[-1]:.6g} s; they share no time: bring them to one clock"
    )


def check_within_stop(
    recording: Recording, platform: Platform, motion: Motion, look: str = LOOK
) -> None:
    """A motion that goes on beyond the stop is not that of a body which the stop holds.

    Args:
        recording: for its name.
        platform: with its stop.
        motion: of the log.
        look: where to look if the body never leaned so far.

    Raises:
        ImpossibleLog: it leans further than that, and where.
    """
    if platform.base.kind != "ball" or not np.isfinite(platform.stop_angle):
        return
    lean = platform.lean(motion.position)
    most = int(np.argmax(lean))
    if lean[most] > platform.stop_angle + BEYOND_STOP:
        raise ImpossibleLog(
            f"{recording.source}: {platform.name} leans {np.degrees(lean[most]):.3g} deg at "
            f"{motion.time[most]:.4g} s, and platform.toml has a stop at "
            f"{np.degrees(platform.stop_angle):.3g} deg: set the angle of [tilt_stop] to where it "
            f"touches, or leave the stop out; if it never leaned so far, {look}"
        )


def _check_alive(recording: Recording) -> None:
    for name in OF_MOTION:
        if name in recording and recording[name].stands_still:
            raise ImpossibleLog(
                f"{recording.source}: {name} is the same in all {len(recording[name])} rows, "
                "which tells nothing of a machine that moves; if the sensor was off, leave the "
                "stream out"
            )


def _check_axes(recording: Recording) -> None:
    """No sensor that alone shows the motion has a dead axis."""
    for name in OF_AXES:
        if name not in recording or not is_needed(name, recording):
            continue
        if dead := dead_axes(recording[name]):
            raise ImpossibleLog(
                f"{recording.source}: {dead_words(name, dead)}; that axis was off, and no "
                "attitude shows the motion instead: record it again, or add the attitude"
            )
