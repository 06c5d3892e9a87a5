"""Effects hidden at random in simulated logs, as large as a wanted evidence makes them.

The evidence that a perfect method would have is the squared length of the effect's whitened
signature, the base projected out. The machine that is simulated is not the one that is believed:
its J and m r are off, and it moves on half the step.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.diagnose import diagnosis
from twin.diagnose.candidates import Candidate, candidates_of
from twin.diagnose.weighing import Weighing
from twin.effects import (
    BodyEffect,
    Domain,
    Effect,
    State,
    able,
    parameter,
    with_effects,
)
from twin.effects.errors import EffectError
from twin.effects.on_body import TorqueLaw
from twin.estimators import load_estimator, usual_estimator
from twin.loop import fly
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, Sensor, load_platform
from twin.predict.effect_columns import amplitudes
from twin.recording import Recording
from twin.reference import parse_reference
from twin.stream.recorder import MemoryRecorder

GRADES = {"fine": (1e-4, 1e-4), "middle": (1e-3, 1e-3), "coarse": (4.4e-3, 3.5e-2)}
"""1 sigma of gyro [rad/s] and attitude [rad]."""
FIELD = np.array([2.2e-5, 0.0, -4.2e-5])
"""Of a cage, that a dipole may be felt [T]."""
SHAPED = ("flexible_appendage", "liquid_slosh", "room_draft")
"""Effects that have a frequency, which a size alone does not make visible."""
OFF = 0.05
"""Share by which the believed J and m r may be wrong."""


@dataclass(frozen=True)
class Bench:
    """A machine, how it is moved, and how well it is measured."""

    platform: str = "sads"
    controller: str = "quaternion_pd"
    grade: str = "middle"
    rate: float = 50.0
    duration: float = 120.0


@dataclass(frozen=True)
class Hidden:
    """A log with a secret."""

    bench: Bench
    seed: int
    effects: tuple[Effect, ...]
    log: Recording
    believed: Platform
    """The machine as its owners think it is."""


def machine(bench: Bench) -> Platform:
    """In a field, its sensors of the wanted grade and rate."""
    platform = load_platform(bench.platform)
    gyro, attitude = GRADES[bench.grade]
    noise = {"gyro": gyro, "attitude": attitude}

    def graded(name: str, sensor: Sensor) -> Sensor:
        if name not in noise:
            return sensor
        return replace(sensor, noise=np.full_like(sensor.noise, noise[name]), rate=bench.rate)

    sensors = {name: graded(name, sensor) for name, sensor in platform.sensors.items()}
    return replace(platform, sensors=sensors, magnetic_field=FIELD)


def flown(bench: Bench, effects: tuple[Effect, ...], seed: int) -> Recording:
    """A run of the true machine."""
    platform = machine(bench)
    platform = replace(platform, step=0.5 * platform.step)
    for effect in effects:
        platform = able(platform, effect)
    law = load_controller(bench.controller)
    memory = MemoryRecorder(platform, {"source": f"seed {seed}"})
    plant = SimulatedPlant(with_effects(platform, effects), seed=seed)
    fly(
        plant,
        load_estimator(usual_estimator(platform)),
        law,
        parse_reference(law.reference),
        SimulatedClock(),
        duration=bench.duration,
        observers=[memory],
    )
    return memory.recording().without_truth()


def believed(bench: Bench, rng: np.random.Generator) -> Platform:
    """The machine with J and m r a little wrong."""
    platform = machine(bench)
    scale = 1.0 + OFF * rng.uniform(-1.0, 1.0, 3)
    inertia = platform.inertia * np.sqrt(np.outer(scale, scale))
    shift = OFF * np.linalg.norm(platform.center_of_mass_offset) * rng.uniform(-1.0, 1.0, 3)
    return replace(
        platform,
        inertia=inertia,
        center_of_mass_offset=platform.center_of_mass_offset + shift,
    )


@cache
def yardstick(bench: Bench) -> tuple[Weighing, tuple[Candidate, ...]]:
    """What each cause's signature is on this bench, from a run with nothing hidden."""
    platform = machine(bench)
    plain = diagnosis.plain_of([flown(bench, (), seed=0)], platform)
    asked = candidates_of(plain.bodies).asked
    return plain.weighing(asked), asked


def drawn(bench: Bench, label: str, evidence: float, rng: np.random.Generator) -> Effect | None:
    """An effect in a random direction, of a size with that evidence; None beyond its bounds."""
    weighing, asked = yardstick(bench)
    index = [candidate.label for candidate in asked].index(label)
    effect = asked[index].effect
    size = amplitudes(effect)
    low, high = effect.bounds()
    scale = effect.scale()[size]
    direction = rng.uniform(0.3, 1.0, len(scale)) * scale
    two_sided = low[size] < 0.0
    direction = direction * np.where(two_sided, rng.choice([-1.0, 1.0], len(scale)), 1.0)
    shown = float(np.linalg.norm(weighing.signature(index, direction)))
    values = effect.values
    values[size] = direction * np.sqrt(evidence) / shown
    if np.any(values < low) or np.any(values > high):
        return None
    return effect.with_values(values)


@dataclass(frozen=True)
class Nameless(BodyEffect):
    """A torque about x in proportion to the rates about x and z: no cause of the catalogue."""

    name = "nameless"
    domain = Domain.torque
    observable = "nothing that the catalogue knows"
    streams = ("gyro", "attitude")

    size: float = parameter("torque per product of rates", "N m s^2", 3.0, source="any")

    def torque(self, platform: Platform) -> TorqueLaw:
        """See above."""

        def law(state: State) -> np.ndarray:
            torque = np.zeros_like(state.rate)
            torque[:, 0] = self.size * state.rate[:, 0] * state.rate[:, 2]
            return torque

        return law


def any_of(bench: Bench, evidence: float, rng: np.random.Generator) -> Effect:
    """Any effect that this bench shows, of a size with that evidence."""
    weighing, asked = yardstick(bench)
    labels = [one.label for index, one in enumerate(asked) if weighing.shown(index)]
    kinds = sorted({label.partition(":")[0] for label in labels} - set(SHAPED))
    while True:
        kind = rng.choice(kinds)
        label = rng.choice([one for one in labels if one.partition(":")[0] == kind])
        found = drawn(bench, label, evidence, rng)
        if found is not None:
            return found


def hide(bench: Bench, effects: tuple[Effect, ...], seed: int) -> Hidden | None:
    """A log with these effects; None where the machine cannot have them."""
    try:
        log = flown(bench, effects, seed)
    except EffectError:
        return None
    return Hidden(bench, seed, effects, log, believed(bench, np.random.default_rng([seed, 1])))
