"""One run in one thread: our closed loop, and Basilisk's at the step of equal accuracy."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.util import find_spec

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import median, seconds, spread, table
from benchmarks.sensors import perfect
from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.model import compile_model
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.reference import Hold
from twin.rotation import conjugate, multiply, to_rotation_vector

Array = NDArray[np.float64]

DURATION = 300.0
"""Of a run [s]."""
ROUNDS = 5

STEPS = (0.05, 0.025, 0.0125, 0.01)
"""[s] that divide the control period of 50 ms."""
FINEST = 0.00125
"""[s], 8 times finer than the finest of them: what counts as the truth."""
RATE = np.array([0.05, -0.04, 0.03])
"""Start of the free gyrostat that tells the accuracy [rad/s, body]."""
SPEED = np.array([100.0, -80.0, 60.0])
"""Of its wheels [rad/s]."""
PROPORTIONAL, DERIVATIVE = 10.0, 8.0
"""Basilisk's gains: per MRP, which is half a quaternion's vector part, [N m]; per rate [N m s]."""

LOOPS = (
    ("ours, perfect sensors, passed through", "passthrough", True),
    ("ours, shipped sensors, passed through", "passthrough", False),
    ("ours, shipped sensors, attitude filter", "filter", False),
)


def run() -> None:
    """Print one table, or with Basilisk two."""
    platform = load_platform("sads")
    flights: dict[str, Callable[[], float]] = {
        name: partial(_ours, perfect(platform) if ideal else platform, estimator)
        for name, estimator, ideal in LOOPS
    }
    against = list(flights)[0]
    if find_spec("Basilisk") is None:
        print(
            "Basilisk is not installed; `.venv/bin/uv sync --frozen --extra peers` adds it, then "
            "`.venv/bin/python -m benchmarks single` compares\n"
        )
    else:
        step = equal_accuracy(platform)
        against = f"Basilisk, simpleNav, mrpFeedback, RK4 {step * 1e3:g} ms"
        flights[against] = partial(basilisk_flight, platform, step, DURATION)
    speeds: dict[str, list[float]] = {name: [] for name in flights}
    for _ in range(ROUNDS):
        for name, flight in flights.items():
            speeds[name].append(DURATION / flight())
    rows = [
        (
            name,
            f"{median(speed):.0f}",
            spread([a / b for a, b in zip(speed, speeds[against], strict=True)], ".2f"),
            _target(name) if "Basilisk" in against else "",
        )
        for name, speed in speeds.items()
    ]
    table(("closed loop, n = 1", "simulated s per s", f"ratio to {against}", "target"), rows)
    print(
        f"\nthree wheels, control at {platform.control_rate:g} Hz, RK4 {platform.step * 1e3:g} ms, "
        f"{DURATION:.0f} s; {ROUNDS} rounds in turns, the machine already built;\n"
        "ratios: median round by round (lowest to highest)"
    )


def _target(name: str) -> str:
    return {LOOPS[0][0]: ">= 1", LOOPS[2][0]: ">= 0.5"}.get(name, "")


def _ours(platform: Platform, estimator: str) -> float:
    with SimulatedPlant(platform, initial=InitialState(rate_body=RATE)) as plant:
        law = load_controller("quaternion_pd")
        filters = load_estimator(estimator)
        fly_it = partial(fly, plant, filters, law, Hold(), SimulatedClock(), duration=DURATION)
        return seconds(fly_it)


def basilisk_flight(platform: Platform, step: float, duration: float) -> float:
    """Wall time [s] of Basilisk's closed loop over `duration` [s]."""
    from benchmarks.basilisk import Spacecraft

    peer = Spacecraft(platform, step, RATE, np.zeros(3))
    peer.close_loop(PROPORTIONAL, DERIVATIVE)
    return seconds(partial(peer.ready(), duration))


def equal_accuracy(platform: Platform) -> float:
    """The largest step with which Basilisk errs no more than we do at the platform's own."""
    from benchmarks.basilisk import Spacecraft

    def theirs(step: float) -> Array:
        peer = Spacecraft(platform, step, RATE, SPEED)
        peer.ready()(DURATION)
        return peer.attitude

    truths = [free_gyrostat(platform, FINEST), theirs(FINEST)]
    errors = {
        step: [
            _angle(free_gyrostat(platform, step), truths[0]),
            _angle(theirs(step), truths[1]),
        ]
        for step in STEPS
    }
    table(
        ("step, ms", "our error, deg", "Basilisk's error, deg"),
        [(f"{step * 1e3:g}", *(f"{e:.1e}" for e in pair)) for step, pair in errors.items()],
    )
    print(
        f"\nfree gyrostat, {DURATION:.0f} s, wheels at {SPEED.tolist()} rad/s, each against itself "
        f"at {FINEST * 1e3:g} ms;\nboth at {FINEST * 1e3:g} ms differ by "
        f"{_angle(*truths):.1e} deg\n"
    )
    allowed = errors[platform.step][0]
    return max((step for step in STEPS if errors[step][1] <= allowed), default=min(STEPS))


def free_gyrostat(platform: Platform, step: float) -> Array:
    """Attitude (4,) at the end, without gravity, torque or contact, by our model."""
    machine = compile_model(replace(platform, step=step, gravity=0.0))
    machine.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data = mujoco.MjData(machine.model)
    data.qvel[machine.base_dof] = RATE
    data.qvel[machine.wheel_dof] = SPEED
    mujoco.mj_step(machine.model, data, round(DURATION / step))
    return data.qpos[machine.base_qpos].copy()


def _angle(one: Array, other: Array) -> float:
    """Between two attitudes [deg]."""
    return float(np.degrees(np.linalg.norm(to_rotation_vector(multiply(conjugate(one), other)))))
