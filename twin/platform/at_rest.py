"""Where a log and a machine do not meet: parts without a stream, sensors without a place."""

from collections.abc import Sequence

import numpy as np

from twin.platform.parts import Platform
from twin.recording import Recording
from twin.signals import OF_MOTION

PARTS = {
    "wheels": (
        ("wheel_speed", "command_wheel_torque", "command_wheel_duty"),
        "neither their speed nor their torque: taken as at rest",
    ),
    "stages": (
        ("stage_position", "command_stage_position"),
        "neither where they are nor where they are to be: taken as at 0",
    ),
    "gimbals": (
        ("gimbal_angle", "command_gimbal_rate"),
        "neither their angle nor their rate, without which nothing is predicted",
    ),
    "magnetorquers": (("command_dipole",), "no moment of theirs: taken as off"),
    "thrusters": (("command_thruster",), "no force of theirs: taken as shut"),
    "motor": (("command_joint_torque",), "no torque of it: taken as off"),
}
"""Kind of part -> the streams that a prediction takes it from, and what it is without them."""

UNDRIVEN = (
    "{name} has wheel_speed and nothing that says what drove the wheels: their torque is taken as "
    "white noise. That of a law that holds, or slews slowly, is not: J may then be off by several "
    "of its intervals, and a cause that acts alike be named. Add command_wheel_torque or "
    "command_wheel_duty, or turn the machine faster about all axes."
)

FROM_NOTHING = (
    "command_joint_torque",
    "command_wheel_torque",
    "command_wheel_duty",
    "command_dipole",
    "command_thruster",
    "command_gimbal_rate",
)
"""Commands that are nothing until the first of them."""
ONLY_IF_STATED = ("accelerometer", "magnetometer", "inclinometer")
"""Sensors of which one must know where they sit, or what they sense."""
BEYOND = 0.05
"""Share by which a wheel may exceed its stated speed before that is said: limits are rounded."""
LATE = 0.5
"""By how much such a record may begin after the motion's before it is spoken of [s]."""


def taken_as_at_rest(recordings: Sequence[Recording], platform: Platform) -> tuple[str, ...]:
    """A sentence for each kind of part that a measured log has no stream of, or no drive, and for
    each sensor that the platform does not state.

    What no stream says is no motion that the logs explain: its torque would be put down to
    something else. A recording of our own holds all that was commanded, so nothing is said of it.
    """
    said: list[str] = []
    for recording in recordings:
        if recording.provenance.get("kind") != "log":
            continue
        name = "this log"
        if len(recordings) > 1:
            name = str(recording.provenance.get("source", name))
        for kind, (streams, without) in PARTS.items():
            parts = _names(platform, kind)
            if parts and not any(stream in recording for stream in streams):
                said.append(
                    f"{platform.name} has {_listed(kind, parts)}; {name} has {without}. Unless "
                    f"that is so, add {' or '.join(streams[:2])}."
                )
        said += [
            f"{platform.name} states no {stream}: that of {name} has no part in the prediction. "
            f"Add [sensors.{stream}] to platform.toml."
            for stream in ONLY_IF_STATED
            if stream in recording and stream not in platform.sensors
        ]
        wheels, *commands = PARTS["wheels"][0]
        if wheels in recording and not any(stream in recording for stream in commands):
            said.append(UNDRIVEN.format(name=name))
        said += [
            f"{stream} of {name} begins {late:.3g} s after the motion: taken as nothing until "
            "then. If its recorder only started late, cut the log there."
            for stream in FROM_NOTHING
            if (late := begins_late(recording, stream))
        ]
    return tuple(said)


def beyond_stated(recordings: Sequence[Recording], platform: Platform) -> tuple[str, ...]:
    """A sentence for each wheel that ran faster than its platform says that it can."""
    fastest: dict[str, float] = {}
    for recording in recordings:
        if "wheel_speed" not in recording or not len(recording["wheel_speed"]):
            continue
        reached = np.abs(recording["wheel_speed"].value).max(axis=0)
        for wheel, speed in zip(platform.wheels, reached.tolist(), strict=False):
            fastest[wheel.name] = max(fastest.get(wheel.name, 0.0), speed)
    return tuple(
        f"{wheel.name} reaches {fastest[wheel.name]:.4g} rad/s, {fastest[wheel.name] / most:.3g} "
        f"times the {most:.4g} rad/s that platform.toml states (momentum_limit over the inertia "
        "about its axis): look at the unit of wheel_speed, or correct momentum_limit."
        for wheel in platform.wheels
        if np.isfinite(most := wheel.speed_limit)
        and fastest.get(wheel.name, 0.0) > (1.0 + BEYOND) * most
    )


def begins_late(recording: Recording, stream: str) -> float:
    """Time from the first that is seen of the motion to a command's first row, where that is so
    long that nothing was commanded meanwhile; else 0 [s]."""
    shown = [float(recording[s].time[0]) for s in OF_MOTION if s in recording and len(recording[s])]
    if stream not in FROM_NOTHING or stream not in recording or not shown:
        return 0.0
    told = recording[stream].time
    late = float(told[0]) - min(shown) if len(told) else 0.0
    return late if late > LATE else 0.0


def _names(platform: Platform, kind: str) -> tuple[str, ...]:
    if kind == "motor":
        return () if platform.base.actuator is None else (platform.base.actuator,)
    return tuple(part.name for part in getattr(platform, kind))


def _listed(kind: str, names: tuple[str, ...]) -> str:
    first, *others = names
    if not others:
        return f"the {kind.removesuffix('s')} {first}"
    return f"{kind} {first} {'to' if len(others) > 1 else 'and'} {others[-1]}"
