"""A campaign's shard against the job done another way: a plain Python loop, and Basilisk.

The plain loop is what a lab writes in an afternoon: one run after the other, `mujoco.mj_step`, and
sensors, law and figures of merit in NumPy on vectors of three and four numbers. It flies the same
machine with the same noise, gains and reference, so its figures must come out as ours.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.batch import bare_batch
from benchmarks.campaign import RUNS, SADS, Case, spec_of
from benchmarks.measure import median, seconds, spread, table
from benchmarks.single import basilisk_flight, equal_accuracy
from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.spec import Spec
from twin.controller import load_controller
from twin.model import Machine, compile_model
from twin.platform import Platform
from twin.reference import Multisine

Array = NDArray[np.float64]

DURATION = 60.0
"""Of a run [s]; the tracking error counts from half of it on."""
ALONE = 6
"""Runs of the plain loop in a turn."""
ROUNDS = 4


@dataclass(frozen=True)
class Laboratory:
    """One run at a time: everything that does not change from run to run."""

    platform: Platform
    machine: Machine
    duration: float
    seed: int
    proportional: float
    derivative: float

    def fly(self, run: int) -> tuple[float, float]:
        """Rms tracking error of a run at its end, and its largest tilt [rad]."""
        platform, machine = self.platform, self.machine
        model, step = machine.model, platform.step
        data = mujoco.MjData(model)
        gyro, fix = platform.sensors["gyro"], platform.sensors["attitude"]
        random = np.random.default_rng([self.seed, run])
        bias = gyro.bias * random.standard_normal(3)
        share = -np.linalg.pinv(np.array([wheel.axis for wheel in platform.wheels]).T)
        limit = np.array([wheel.torque_limit for wheel in platform.wheels])
        steps = round(platform.tick / step)
        gyro_every, fix_every = round(1.0 / (gyro.rate * step)), round(1.0 / (fix.rate * step))
        ticks = round(self.duration / platform.tick) + 1
        target = Multisine().at(platform.tick * np.arange(ticks, dtype=float))
        rate, attitude = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        squares, counted, tilt_max = 0.0, 0, 0.0
        for tick in range(ticks):
            if tick:
                for number in range((tick - 1) * steps + 1, tick * steps + 1):
                    mujoco.mj_step(model, data)
                    if number % gyro_every == 0:
                        true = data.qvel[machine.base_dof]
                        rate = true + bias + gyro.noise * random.standard_normal(3)
                    if number % fix_every == 0:
                        turn = fix.noise * random.standard_normal(3)
                        attitude = _times(data.qpos[machine.base_qpos], _small(turn))
            error = _times(_conjugate(target.attitude[tick]), attitude)
            if error[0] < 0.0:
                error = -error
            rate_error = rate - _matrix(error).T @ target.rate_body[tick]
            torque = -self.proportional * error[1:] - self.derivative * rate_error
            data.ctrl[machine.wheel_actuator] = np.clip(share @ torque, -limit, limit)
            true = data.qpos[machine.base_qpos]
            tilt_max = max(tilt_max, 2.0 * np.arcsin(min(np.hypot(true[1], true[2]), 1.0)))
            if tick * platform.tick >= 0.5 * self.duration:
                off = _times(_conjugate(target.attitude[tick]), true)
                squares += (2.0 * np.arcsin(min(np.linalg.norm(off[1:]), 1.0))) ** 2
                counted += 1
        return float(np.sqrt(squares / counted)), tilt_max


def run() -> None:
    """Print the table; with Basilisk where it is installed."""
    passed, filtered = (
        spec_of(Case(name, *SADS, name), RUNS, DURATION) for name in ("passthrough", "filter")
    )
    platform = passed.arms[0].platform
    law = load_controller(passed.arms[0].controller)
    gains = {name: float(getattr(law, name)) for name in ("proportional", "derivative")}
    laboratory = Laboratory(platform, compile_model(platform), DURATION, passed.seed, **gains)
    errors: dict[str, list[float]] = {"plain": [], "ours": []}
    alone = "plain Python loop over mj_step, law and sensors"
    jobs: dict[str, Callable[[], float]] = {
        "bare Batch.step, 256 runs": partial(_bare, platform),
        "campaign, law and sensors": partial(_campaign, passed, errors["ours"]),
        "campaign, with the attitude filter": partial(_campaign, filtered, []),
        alone: partial(_plain, laboratory, errors["plain"]),
    }
    peer = ""
    if find_spec("Basilisk") is None:
        print("Basilisk is not installed; the extra `peers` brings it\n")
    else:
        step = equal_accuracy(platform)
        peer = f"Basilisk, simpleNav, mrpFeedback, RK4 {step * 1e3:g} ms"
        jobs[peer] = partial(_basilisk, platform, step)
    speeds: dict[str, list[float]] = {name: [] for name in jobs}
    for turn in range(ROUNDS + 1):
        for name, job in jobs.items():
            speed = job()
            if turn:
                speeds[name].append(speed)
    head = ["one core", "simulated s per s", "ratio to the plain loop"]
    table(
        [*head, "ratio to Basilisk"] if peer else head,
        [
            [name, f"{median(own):.0f}", _ratio(own, speeds[alone])]
            + ([_ratio(own, speeds[peer])] if peer else [])
            for name, own in speeds.items()
        ],
    )
    plain, ours = (np.degrees(errors[name]) for name in ("plain", "ours"))
    print(
        f"\nsads, {DURATION:g} s of a multisine, control at {platform.control_rate:g} Hz, RK4 "
        f"{platform.step * 1e3:g} ms; {ROUNDS} rounds in turns, ratios: median\n"
        "round by round (lowest to highest). Rms tracking error, mean over runs: plain loop "
        f"{plain.mean():.4f} deg, campaign {ours.mean():.4f} deg\n"
        f"(standard deviations {plain.std():.4f} and {ours.std():.4f})."
    )


def _ratio(one: list[float], other: list[float]) -> str:
    return spread([a / b for a, b in zip(one, other, strict=True)], ".3g")


def _bare(platform: Platform) -> float:
    ticks = 200
    step = bare_batch(platform, RUNS, 1)
    return RUNS * ticks * platform.tick / seconds(partial(step, ticks))


def _campaign(spec: Spec, errors: list[float]) -> float:
    drawn = draw(spec, range(RUNS))

    def fly() -> None:
        came = flown(spec, drawn)
        errors.extend(item.metrics["tracking_error_rms"] for item in came.values())

    return RUNS * spec.duration / seconds(fly)


def _plain(laboratory: Laboratory, errors: list[float]) -> float:
    def fly() -> None:
        errors.extend(laboratory.fly(run)[0] for run in range(ALONE))

    return ALONE * laboratory.duration / seconds(fly)


def _basilisk(platform: Platform, step: float) -> float:
    duration = 300.0
    return duration / basilisk_flight(platform, step, duration)


def _times(p: Array, q: Array) -> Array:
    vector = p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    return np.concatenate([[p[0] * q[0] - p[1:] @ q[1:]], vector])


def _conjugate(q: Array) -> Array:
    return np.array([q[0], -q[1], -q[2], -q[3]])


def _small(turn: Array) -> Array:
    q = np.concatenate([[1.0], 0.5 * turn])
    return q / np.linalg.norm(q)


def _matrix(q: Array) -> Array:
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, q)
    return out.reshape(3, 3)
