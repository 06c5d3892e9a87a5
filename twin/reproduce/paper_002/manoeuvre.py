"""The experiment that the paper simulates: thrusters turn a body of simple mass properties, wheels
make a machine of the same follow it (Fig. 3 and 4), and their torques then turn the machine of
Table 1, of which nobody knows the mass properties.
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.clock import SimulatedClock
from twin.controller import AnyController, Controller, load_controller
from twin.estimators.estimator import Passthrough
from twin.loop import fly
from twin.plant.initial import InitialState, hanging
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.predict.logs import attitude_of_start
from twin.recording import Recording
from twin.reference import Hold, Reference
from twin.signals import Command, Estimate, Target
from twin.stream.recorder import MemoryRecorder

Array = NDArray[np.float64]

NOISE = 4.7e-3
"""[rad/s] of the gyro, 1 sigma: paper, what its moving average leaves; 95 % lie within 0.0091."""
DURATION = 60.0
"""[s], ASSUMED."""
RATE = 50.0
"""[Hz] of every sensor: paper, "a step-size of 0.02 s"."""
TORQUE = np.array([0.11, 0.11, 0.16])
"""[N m] of the thrusters about x, y, z, ASSUMED: the data reach the paper's 0.1 rad/s."""
PERIOD = np.array([6.0, 7.5, 30.0])
"""[s] of their square waves, ASSUMED: Fig. 3 has a basic torque profile, and no numbers."""
FINE = 0.01
"""[s] step of the reference body's own integration."""


def square(time: Array) -> Array:
    """(m, 3) torque of the thrusters at instants (m,) [N m]; its mean rate is none."""
    return TORQUE * np.where((time[:, None] / PERIOD + 0.25) % 1.0 < 0.5, 1.0, -1.0)


@dataclass(frozen=True)
class ThrustedBody(Reference):
    """A rigid body that thrusters turn, free of gravity; known at whole steps of `FINE`."""

    inertia: Array
    """(3,) principal moments [kg m^2]."""

    @cached_property
    def _path(self) -> Target:
        count = round((DURATION + 20.0) / FINE)
        attitude, rate = np.zeros((count + 1, 4)), np.zeros((count + 1, 3))
        attitude[0, 0] = 1.0
        middles = FINE * (np.arange(count + 1, dtype=np.float64) + 0.5)
        push = square(np.asarray(middles, dtype=np.float64))
        for i in range(count):
            attitude[i + 1], rate[i + 1] = self._after(attitude[i], rate[i], push[i])
        return Target(attitude, rate, self._turning(rate, push))

    def at(self, time: float | Array) -> Target:
        """As integrated, at the nearest step."""
        path = self._path
        at = np.clip(np.rint(np.asarray(time) / FINE).astype(np.intp), 0, len(path.rate_body) - 1)
        return Target(path.attitude[at], path.rate_body[at], path.acceleration_body[at])

    def _turning(self, rate: Array, push: Array) -> Array:
        return (push - rotation.cross(rate, self.inertia * rate)) / self.inertia

    def _after(self, attitude: Array, rate: Array, push: Array) -> tuple[Array, Array]:
        middle = rate + 0.5 * FINE * self._turning(rate, push)
        turn = rotation.from_rotation_vector(FINE * middle)
        return rotation.multiply(attitude, turn), rate + FINE * self._turning(middle, push)


@dataclass(frozen=True)
class RecordedCommands(Controller[None]):
    """Commands as they were recorded, whatever the machine does."""

    stream: str
    value: Array
    """(ticks, width), or (ticks, n, width)."""

    def init(self, platform: Platform, n: int) -> None:
        """Nothing is remembered."""

    def update(
        self, state: None, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, None]:
        """The row of this tick."""
        row = self.value[min(round(time * RATE), len(self.value) - 1)]
        return {
            self.stream: np.broadcast_to(row, (len(estimate.valid), row.shape[-1])).copy()
        }, None


def machine(*, inertia: Array | None = None, moment: Array | None = None) -> Platform:
    """`whorl1` as Table 1 has it, every sensor exact and at the step of the simulation.

    Args:
        inertia: (3, 3) in place of Table 1's.
        moment: (3,) m r in place of Table 1's.
    """
    stated = load_platform("whorl1:table1")
    exact = {
        name: replace(
            stated.sensors[name],
            rate=RATE,
            noise=np.zeros(3),
            bias=np.zeros(3),
            range=np.inf,
        )
        for name in ("gyro", "attitude", "wheel_speed")
    }
    return replace(
        stated,
        sensors=exact,
        inertia=stated.inertia if inertia is None else inertia,
        center_of_mass_offset=stated.center_of_mass_offset if moment is None else moment,
    )


def as_guessed() -> Platform:
    """What an identification is told: the simple mass properties, hanging straight down."""
    truth = machine()
    down = np.array([0.0, 0.0, -float(np.linalg.norm(truth.center_of_mass_offset))])
    return machine(inertia=np.diag(np.diag(truth.inertia)), moment=down)


def flown(
    platform: Platform,
    law: AnyController,
    *,
    reference: Reference | None = None,
    start: Array | None = None,
    runs: int = 1,
    seed: int = 0,
) -> list[Recording]:
    """Fly a batch from rest.

    Args:
        platform: the machine.
        law: what drives it.
        reference: what the law follows.
        start: (4,) attitude; level unless given.
        runs: how many.
        seed: of the sensors' noise.
    """
    first = InitialState() if start is None else InitialState(attitude=start)
    plant = SimulatedPlant(platform, runs=range(runs), seed=seed, initial=first)
    recorder = MemoryRecorder(plant.platform, {"platform": platform.name, "source": "paper 002"})
    fly(
        plant,
        Passthrough(),
        law,
        reference or Hold(),
        SimulatedClock(),
        duration=DURATION,
        observers=[recorder],
    )
    return [recorder.recording(run) for run in range(runs)]


@cache
def tracked() -> Recording:
    """Fig. 4: the machine of simple mass properties follows the body on thrusters."""
    simple = np.diag(np.diag(machine().inertia))
    platform = machine(inertia=simple, moment=np.zeros(3))
    law = load_controller("mrp_tracking")
    (log,) = flown(platform, law, reference=ThrustedBody(np.diag(simple)))
    return log


@cache
def ideal() -> Recording:
    """What perfect sensors see of the machine of Table 1, hanging at rest until its wheels turn."""
    platform = machine()
    (log,) = flown(platform, wheels(), start=hanging(platform.center_of_mass_offset))
    return log


def wheels() -> RecordedCommands:
    """The wheels' torques of Fig. 4."""
    return RecordedCommands("command_wheel_torque", tracked()["command_wheel_torque"].value)


def measured(log: Recording, sigma: float, rng: np.random.Generator) -> Recording:
    """With noise on the gyro [rad/s], and with the attitude that is integrated from it."""
    gyro = log["gyro"]
    noisy = replace(gyro, value=gyro.value + rng.normal(0.0, sigma, gyro.value.shape))
    streams = {**log.streams, "gyro": noisy, "attitude": attitude_of_start(noisy, log["attitude"])}
    return replace(log, streams=streams)
