"""Stages homed and brought to their marks, wheels brought to rest; each move read back."""

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench
from twin.errors import SafetyError, UnknownName, UsageError
from twin.plant.devices.mdrive import MDrive
from twin.platform import Platform
from twin.service.session import MOVE, POSITION, Session

Array = NDArray[np.float64]


_FLOOR = 1e-6
"""[m]: no counter of a balance mass is asked for more."""

_SIGN = 10.0
"""Tolerances by which a stage must have gone the wrong way before it is called wrong."""


def home(bench: Bench) -> list[str]:
    """Let every stage that has a home switch seek it, and tell where they then are.

    Args:
        bench: entered, opened as captured.

    Raises:
        SafetyError: it floats, or may.
        UsageError: no stage has a home to seek.
        DeviceError: a drive finds no home.
    """
    bench.watch()
    bench.guard.captured()
    bench.guard.captured_only("homing")
    seeking = {n: d for n, d in bench.hardware.devices.items() if isinstance(d, MDrive)}
    if not seeking:
        raise UsageError(
            f"no device of {bench.platform.name} seeks a home by itself: its counters begin where "
            "the stages stand at power-up; bring them to their marks by hand, then switch it on"
        )
    told: list[str] = []
    for name, drives in seeking.items():
        drives.home(captured=True)
        parts = ", ".join(stage.settings.part for stage in drives.stages)
        told.append(f"{name}: {parts} homed")
    bench.watch_on()
    # where they are now is where they are: no jump
    bench.guard.captured()
    return [*told, _where(bench)]


def gather(bench: Bench, goal: Array, what: str) -> list[str]:
    """Bring all stages to their places, over whatever way that is.

    Args:
        bench: entered, opened as captured.
        goal: (stages,) [m]; the guard's margins hold.
        what: for the sentences: "zero", "park".

    Raises:
        SafetyError: it floats, or may; or a stage does not go where it is told.
        DeviceError: a device refuses.
    """
    carried(bench, MOVE, what)
    session = Session(bench)
    bench.guard.captured_only(what)
    move(session, goal)
    return [f"{what}: {_where(bench)}"]


def move(session: Session, goal: Array) -> None:
    """Until the stages read `goal` (stages,) [m], or where the guard's margins end it.

    Raises:
        SafetyError: one goes the other way, or does not arrive; all hold then.
    """
    platform, guard = session.platform, session.bench.guard
    stages, margin = platform.stages, guard.settings.stroke_margin
    goal = np.clip(
        goal,
        [stage.travel[0] + margin for stage in stages],
        [stage.travel[1] - margin for stage in stages],
    )
    start, allowed = session.places, tolerance(platform)
    way = goal - start
    speed = np.array([stage.speed for stage in stages])
    ramp = np.array([stage.speed / stage.acceleration + stage.response for stage in stages])
    # twice what the drive needs: one on a slow line is told its next piece late
    longest = float(np.max(2.0 * np.abs(way) / speed + ramp)) + 2.0
    begun = session.now
    while np.any(np.abs(goal - session.places) > allowed):
        session.step({MOVE: goal[None]})
        place = session.places
        back = np.flatnonzero((place - start) * np.sign(way) < -_SIGN * allowed)
        late = session.now - begun > longest
        if back.size or late:
            k = int(back[0]) if back.size else int(np.argmax(np.abs(goal - place) / allowed))
            session.step({MOVE: place[None]})
            told = f"stage {stages[k].name} was sent from {in_mm(start[k])} to {in_mm(goal[k])}"
            raise SafetyError(
                f"{told} and went the other way, to {in_mm(place[k])}; all hold"
                if back.size
                else f"{told} and stands at {in_mm(place[k])} after {longest:.1f} s; all hold",
                "correct the sign of its scale in [hardware]"
                if back.size
                else "see whether it is blocked, or is slower than its platform says",
            )
    session.watch({MOVE: goal[None]}, 0.2)


def tolerance(platform: Platform) -> Array:
    """(stages,) within which a stage reads to be where it was sent [m]."""
    sensor = platform.sensors.get(POSITION)
    noise = 0.0 if sensor is None else float(np.max(sensor.noise))
    step = np.array([stage.resolution for stage in platform.stages])
    read = 0.0 if sensor is None else sensor.resolution
    return step + read + 4.0 * noise + _FLOOR


def parked(platform: Platform) -> Array:
    """(stages,) [m]: in the middle, but those that run up and down as low as they go.

    So the CM is as far below the CR as the masses can bring it, and the table hangs when it next
    floats.
    """
    places = np.zeros(len(platform.stages))
    for k, stage in enumerate(platform.stages):
        if abs(stage.axis[2]) > np.sqrt(0.5):
            places[k] = stage.travel[0] if stage.axis[2] > 0.0 else stage.travel[1]
    return places


def stage_named(platform: Platform, name: str) -> int:
    """Its number.

    Raises:
        UnknownName: no such stage.
    """
    names = [stage.name for stage in platform.stages]
    if name not in names:
        raise UnknownName("stage", name, names)
    return names.index(name)


def carried(bench: Bench, stream: str, what: str) -> None:
    """Make sure that a device takes that command.

    Raises:
        UsageError: none does.
    """
    if not any(route.stream == stream for route in bench.hardware.setup.commanded):
        raise UsageError(
            f"{what}: no device of {bench.platform.name} takes {stream}; state which one does in "
            "[hardware.commands]"
        )


def _where(bench: Bench) -> str:
    place = bench.guard.seen.stage_position
    if place is None:
        return "no stage measures its position"
    names = [stage.name for stage in bench.platform.stages]
    return ", ".join(f"{n} at {in_mm(p)}" for n, p in zip(names, place, strict=True))


def in_mm(position: float) -> str:
    """A position or a way, for a sentence."""
    return f"{1e3 * position:.4g} mm"


_TORQUE, _SPEED = "command_wheel_torque", "wheel_speed"

_SHARE = 0.5
"""Of a wheel's torque limit that is used."""

_SLOW = 1.0
"""A wheel below this is left to its friction [rad/s]."""

_LEADS = 3.0
"""Samples of its speed within which a slow wheel would be stopped: less overshoots."""

_PATIENCE = 3.0
"""Periods without a speed after which none is braked any more."""


def spin_down(bench: Bench) -> list[str]:
    """Brake every wheel to rest, and tell what it held.

    Args:
        bench: entered, opened as captured.

    Raises:
        UsageError: the machine has no wheel whose torque a device takes.
        SafetyError: it floats, or may; or a wheel does not slow down.
        DeviceError: a device refuses.
    """
    platform = bench.platform
    if not platform.wheels:
        raise UsageError(f"{platform.name} has no wheels")
    carried(bench, _TORQUE, "spin-down")
    session = Session(bench)
    bench.guard.captured_only("spin-down")
    speed = _speed(session)
    start, names = speed.copy(), [wheel.name for wheel in platform.wheels]
    inertia = np.array([wheel.inertia for wheel in platform.wheels])
    most = _SHARE * np.array([wheel.torque_limit for wheel in platform.wheels])
    sensor = platform.sensors[_SPEED]
    noise = 4.0 * np.broadcast_to(sensor.noise, speed.shape) + sensor.resolution
    still = _SLOW + noise
    gain = inertia / (_LEADS * max(1.0 / sensor.rate, platform.tick))
    longest = 2.0 * float(np.max(inertia * np.abs(start) / most)) + 10.0
    while np.any(np.abs(speed) > still):
        session.step({_TORQUE: np.clip(-gain * speed, -most, most)[None]})
        speed = _speed(session)
        faster = np.flatnonzero(np.abs(speed) > np.abs(start) + still)
        if faster.size or session.now > longest:
            k = int(faster[0]) if faster.size else int(np.argmax(np.abs(speed) - still))
            session.step({_TORQUE: np.zeros((1, len(speed)))})
            told = f"wheel {names[k]} was braked from {start[k]:.0f} rad/s"
            raise SafetyError(
                f"{told} and turns faster, with {speed[k]:.0f} rad/s; it coasts now"
                if faster.size
                else f"{told} and still turns with {speed[k]:.0f} rad/s after {longest:.0f} s",
                "correct the sign of its command or of its speed in [hardware]",
            )
    session.watch({_TORQUE: np.zeros((1, len(speed)))}, 0.2)
    held = inertia * start
    return [
        f"{name} from {was:.1f} to {now:.1f} rad/s: {momentum:.3g} N m s went into what holds the "
        "table"
        for name, was, now, momentum in zip(names, start, _speed(session), held, strict=True)
    ]


def _speed(session: Session) -> Array:
    seen, sensor = session.bench.guard.seen, session.platform.sensors[_SPEED]
    if seen.age(_SPEED) > _PATIENCE / sensor.rate + sensor.latency + session.tick:
        raise SafetyError("no sensor measures the speed of the wheels", "check what measures it")
    return seen.newest[_SPEED][1]
