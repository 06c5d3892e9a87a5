"""A sound machine flies on: nothing that watches it takes noise, faults of a model or a law for
what they are not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.effects import effect_names, parse_effects
from twin.errors import TwinError
from twin.flight import prepare
from twin.loop import Outcome, fly
from twin.plant.devices.device import Sample
from twin.plant.guard.guarded import Guarded, Held
from twin.plant.guard.rules import guard_settings
from twin.plant.initial import InitialState
from twin.plant.plant import Plant
from twin.plant.plausibility import MotionAgreement, SampleChecks, sensor_limits
from twin.rotation import from_euler_zyx
from twin.service.answer import BodyAnswer
from twin.signals import Command, Reading, Samples

FLIGHTS = (
    ("cubesat", "mass_magnetic_pid", None),
    ("cubesat", "magnetic_damping", None),
    ("sads", "quaternion_pd", "multisine"),
    ("sads", "quaternion_pd", "slew:0,0,40"),
    ("tas2", "cmg_pd", "slew:0,0,20"),
    ("whorl1", "mrp_tracking", "multisine"),
    ("whorl2", "quaternion_pd", "slew:0,0,30"),
    ("astros", "vscmg_pd", "slew:0,0,20"),
    ("astros", "thruster_pd", None),
)
"""Machine, law, reference."""


class Judged(Plant):
    """A simulated machine whose samples pass the layer between devices and loop."""

    def __init__(self, plant: Plant) -> None:
        self.platform, self.n, self.stopped = plant.platform, 1, plant.stopped
        self._plant = plant
        limits = {name: sensor_limits(self.platform, name) for name in self.platform.sensors}
        self._checks = SampleChecks("board", limits)
        self._agreement = MotionAgreement(self.platform)
        self.reasons: list[str] = []

    @property
    def doubt(self) -> str:
        return next(iter(self._agreement.doubts.values()), "")

    def read(self, until: float) -> Reading:
        reading = self._plant.read(until)
        streams = {name: self._judged(name, each) for name, each in reading.streams.items()}
        judged = Reading(reading.time, streams)
        self._agreement.take(judged)
        return judged

    def _judged(self, name: str, samples: Samples) -> Samples:
        valid = samples.valid.copy()
        for i in np.flatnonzero(valid[0]):
            sample = Sample(name, tuple(samples.value[0, i].tolist()), float(samples.time[0, i]))
            if reason := self._checks.judged(sample).reason:
                valid[0, i] = False
                self.reasons.append(reason)
        return Samples(samples.value, samples.time, valid)

    def write(self, command: Command) -> Command:
        return self._plant.write(command)

    def truth(self) -> dict[str, Samples]:
        return self._plant.truth()


def flown(
    name: str, law: str, reference: str | None, seed: int, effects: str = "", seconds: float = 40.0
) -> tuple[Outcome, list[str], list[str]]:
    """How it ended, the samples that were not believed, and the remarks."""
    rng = np.random.default_rng(seed)
    roll, pitch, yaw = np.radians(rng.uniform(-2.0, 2.0, 3))
    flight = prepare(
        name,
        controller=law,
        estimator=None,
        plant="sim",
        reference=reference,
        duration=seconds,
        seed=seed,
        effects=parse_effects(effects) if effects else (),
        initial=InitialState(attitude=from_euler_zyx(yaw, pitch, roll)),
    )
    plant = Judged(flight.plant)
    guard = Guarded(plant, guard_settings(flight.platform), calibrated=True)
    remarks: list[str] = []
    bench: Any = SimpleNamespace(
        guard=guard,
        platform=flight.platform,
        in_lockstep=True,
        stop=guard.stop,
        remark=remarks.append,
    )
    tick = flight.platform.tick
    for number in range(-round(1.5 / tick), 0):
        guard.read((number + round(1.5 / tick)) * tick)
    guard.arm("arm", held=Held.floating)
    with BodyAnswer(bench) as answer:
        clock = _Later(round(1.5 / tick) * tick)
        outcome = fly(
            guard,
            flight.estimator,
            flight.controller,
            flight.reference,
            clock,
            duration=seconds,
            observers=[answer],
        )
    return outcome, plant.reasons, remarks


class _Later(SimulatedClock):
    """Its first tick is that time [s]: the machine has been watched before."""

    def __init__(self, start: float) -> None:
        super().__init__()
        self._start = start

    def ticks(self, period: float, duration: float):
        for time in super().ticks(period, duration):
            yield self._start + time


@pytest.mark.parametrize(("name", "law", "reference"), FLIGHTS)
def test_a_shipped_machine_with_drawn_noise_flies_to_its_end(name, law, reference):
    seed = int(np.random.SeedSequence([hash_of(name + law), 1]).generate_state(1)[0])
    print(f"seed {seed}")
    outcome, reasons, _ = flown(name, law, reference, seed, seconds=20.0)
    assert not outcome.reason
    assert not reasons


def hash_of(text: str) -> int:
    return int.from_bytes(text.encode()[:8], "big")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "law", "reference"), FLIGHTS)
def test_it_does_so_with_any_two_effects_of_their_usual_size(name, law, reference):
    """Drawn among those that the machine can have; what leaves it no chance is no false alarm."""
    rng = np.random.default_rng([hash_of(name + law), 0])
    names = effect_names()
    drawn: list[str] = []
    while len(drawn) < 2:
        effect = str(rng.choice(names))
        try:
            prepare(
                name, controller=law, estimator=None, plant="sim", reference=reference,
                duration=1.0, effects=parse_effects(",".join([*drawn, effect])),
            )  # fmt: skip
        except TwinError:
            continue
        drawn.append(effect)
    print(f"effects {drawn}")
    outcome, reasons, remarks = flown(name, law, reference, 0, ",".join(drawn), 60.0)
    assert not outcome.reason or "leans by" in outcome.reason, (drawn, outcome.reason)
    assert len(reasons) < 3, (drawn, reasons[:3])
