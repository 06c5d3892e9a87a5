"""Simulated logs of `sads` as a lab would hand them in, and the ways in which it misreads them."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from twin.clock import SimulatedClock
from twin.controller import Controller, load_controller
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform
from twin.recording import Recording
from twin.reference import Hold, Multisine
from twin.rotation import from_euler_zyx
from twin.stream.recorder import MemoryRecorder

STREAMS = ("gyro", "attitude", "wheel_speed")
GRADES = {"fine": (1e-4, 1e-4, 0.02), "middle": (1e-3, 1e-3, 0.1), "coarse": (4.4e-3, 3.5e-2, 0.3)}
"""White noise of gyro [rad/s], attitude [rad] and wheel speed [rad/s]."""
MOTIONS = ("multisine", "slow", "still", "hanging", "falling", "unstable", "stages")
"""Tracking a large or a small reference, or holding; floating freely with the CM below the CR, or
above until the stop; tracking with the CM above, and with masses that travel."""
FREE = ("hanging", "falling")
LATENCY = 0.04
"""The stamps of every stream are late by up to this [s]."""


class WithStages(Controller):
    """Another law, while the sliding masses travel to and fro."""

    def __init__(self, law: Controller) -> None:
        self.law = law

    def init(self, platform, n):
        return self.law.init(platform, n)

    def update(self, state, estimate, target, time):
        command, state = self.law.update(state, estimate, target, time)
        position = 2e-3 * np.sin(0.1 * time + np.array([0.0, 1.0, 2.0]))
        shape = (len(estimate.valid), 3)
        return {**command, "command_stage_position": np.broadcast_to(position, shape)}, state


def another_machine(sads: Platform, draw: np.random.Generator, grade: str, motion: str) -> Platform:
    """What really flies: J off by 4 % with products of inertia that nobody told, a few tens of
    micrometres of imbalance, sensors of a grade."""
    sensors = dict(sads.sensors)
    for name, sigma in zip(STREAMS, GRADES[grade], strict=True):
        sensors[name] = dataclasses.replace(sensors[name], noise=np.full(3, sigma))
    inertia = sads.inertia * (1.0 + 0.04 * draw.choice([-1.0, 1.0]))
    products = draw.uniform(-0.3, 0.3, 3)
    inertia[[0, 0, 1], [1, 2, 2]] = inertia[[1, 2, 2], [0, 0, 1]] = products
    offset = sads.mass * draw.uniform(-1.0, 1.0, 3) * 15e-6
    offset[2] += sads.mass * {"hanging": -3e-4, "falling": 3e-4, "unstable": 3e-4}.get(
        motion, -2e-5
    )
    return dataclasses.replace(sads, sensors=sensors, inertia=inertia, center_of_mass_offset=offset)


def flights(
    sads: Platform, draw: np.random.Generator, grade: str, motion: str, count: int
) -> Iterator[Recording]:
    """Logs of one machine, 60 to 120 s."""
    platform = another_machine(sads, draw, grade, motion)
    free = motion in FREE
    law = load_controller("free_float" if free else "quaternion_pd")
    if motion == "stages":
        law = WithStages(law)
    tilt = np.radians(draw.uniform(-3.0, 3.0, (count, 2)) * (0.1 if motion == "falling" else 1.0))
    start = InitialState(
        attitude=from_euler_zyx(draw.uniform(-3.0, 3.0, count) * free, *(tilt * free).T),
        rate_body=draw.uniform(-0.005, 0.005, (count, 3)) * free,
        wheel_speed=draw.uniform(-20.0, 20.0, (count, 3)),
    )
    if motion in ("multisine", "unstable", "stages"):
        reference = Multisine(np.radians(draw.uniform(3.0, 6.0)), draw.uniform(0.008, 0.015))
    elif motion == "slow":
        reference = Multisine(np.radians(0.5), 0.004)
    else:
        reference = Hold()
    memory = MemoryRecorder(platform)
    fly(
        SimulatedPlant(platform, runs=range(count), seed=int(draw.integers(2**31)), initial=start),
        load_estimator("filter"),
        law,
        reference,
        SimulatedClock(),
        duration=float(draw.uniform(60.0, 120.0)),
        observers=[memory],
    )
    for run in range(count):
        recording = memory.recording(run).without_truth()
        for name in STREAMS:
            series = recording[name]
            late = series.time + draw.uniform(0.0, LATENCY)
            recording = misread(recording, name, time=late)
        yield recording


def misread(recording: Recording, stream: str, **changes: np.ndarray) -> Recording:
    """The recording with other times or values in one stream."""
    series = dataclasses.replace(recording[stream], **changes)
    return dataclasses.replace(recording, streams={**recording.streams, stream: series})


@dataclass(frozen=True)
class Mistake:
    """A wrong convention, and how it should be called."""

    stream: str
    kind: str
    name: str
    recording: Recording
    lag: float = 0.0


KINDS = ("unit", "order", "direction", "flipped", "swapped", "time_unit", "clock_lag")


def make_mistake(recording: Recording, draw: np.random.Generator, kind: str) -> Mistake:
    """Read a right log wrongly."""
    stream = str(draw.choice(STREAMS))
    if kind == "unit":
        stream = str(draw.choice(["gyro", "wheel_speed"]))
        unit, factor = ("rpm", 30.0 / np.pi) if stream == "wheel_speed" else ("deg/s", 180 / np.pi)
        wrong = misread(recording, stream, value=recording[stream].value * factor)
        return Mistake(stream, "unit", unit, wrong)
    if kind in ("order", "direction"):
        q = recording["attitude"].value
        wrong = q[:, [1, 2, 3, 0]] if kind == "order" else q * [1.0, -1.0, -1.0, -1.0]
        name = "last" if kind == "order" else "world-to-body"
        return Mistake("attitude", kind, name, misread(recording, "attitude", value=wrong))
    series = recording[stream]
    first = len(series.columns) - 3
    if kind == "flipped":
        axis = int(draw.integers(3))
        value = series.value.copy()
        value[:, first + axis] *= -1.0
        name = f"{series.columns[first + axis]} axis points the other way"
        return Mistake(stream, "axes", name, misread(recording, stream, value=value))
    if kind == "swapped":
        one, other = sorted(draw.permutation(3)[:2] + first)
        value = series.value.copy()
        value[:, [one, other]] = value[:, [other, one]]
        name = f"{series.columns[one]} and {series.columns[other]} axes are swapped"
        return Mistake(stream, "axes", name, misread(recording, stream, value=value))
    if kind == "time_unit":
        wrong = misread(recording, stream, time=series.time * 1e3)
        return Mistake(stream, "time_unit", "ms", wrong)
    lag = float(draw.choice([-0.5, 0.5]))
    wrong = misread(recording, stream, time=series.time + lag)
    return Mistake(stream, "clock_lag", "behind" if lag > 0.0 else "ahead", wrong, lag)
