"""Wheels brought to rest, on a captured table: their momentum goes into what holds it."""

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench
from twin.errors import SafetyError, UsageError
from twin.service.session import Session
from twin.service.stages import carried

Array = NDArray[np.float64]

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
        raise SafetyError("nothing tells how fast the wheels turn", "check what measures it")
    return seen.newest[_SPEED][1]
