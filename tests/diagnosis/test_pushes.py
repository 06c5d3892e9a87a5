"""A push from outside is told with its time, and spoils no verdict on the machine."""

from dataclasses import dataclass

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.diagnosis import diagnose
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.pushes import PushInterval, but_for, pushes_of
from twin.effects import BodyEffect, Domain, Effect, effect_named, parameter, with_effects
from twin.effects.on_body import State, TorqueLaw
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.predict.response import LONGEST
from twin.recording import Recording
from twin.recording.pauses import part_of
from twin.reference import Multisine
from twin.report.diagnosed import diagnosed
from twin.stream.recorder import MemoryRecorder

LENGTH = 5.0 * LONGEST


@dataclass(frozen=True)
class Shove(BodyEffect):
    """A torque for a moment."""

    name = "shove"
    domain = Domain.torque
    observable = "a hand"
    streams = ("gyro", "attitude")

    start: float = parameter("when it begins", "s", 0.0, source="any")
    lasts: float = parameter("how long", "s", 0.3, source="any")
    torque_body: tuple[float, float, float] = parameter("torque", "N m", (0.0,) * 3, source="any")

    def torque(self, platform: Platform) -> TorqueLaw:
        """See above."""

        def law(state: State) -> np.ndarray:
            on = (state.time >= self.start) & (state.time < self.start + self.lasts)
            return np.asarray(on, dtype=np.float64)[..., None] * np.array(self.torque_body)

        return law


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


@pytest.fixture
def draw(drawn_seed: int) -> np.random.Generator:
    """Of the test's seed."""
    return np.random.default_rng(drawn_seed)


def flown(
    platform: Platform, draw: np.random.Generator, *effects: Effect, length: float = LENGTH
) -> Recording:
    memory = MemoryRecorder(platform)
    fly(
        SimulatedPlant(with_effects(platform, effects), seed=int(draw.integers(1 << 30))),
        load_estimator("passthrough"),
        load_controller("quaternion_pd"),
        Multisine(),
        SimulatedClock(),
        duration=length,
        observers=[memory],
    )
    return memory.recording().without_truth()


def a_shove(draw: np.random.Generator, middle: float | None = None) -> Shove:
    """Of 0.1 to 1 N m s, somewhere, or about some time."""
    lasts = float(draw.uniform(0.1, 0.6))
    way = draw.standard_normal(3)
    size = float(np.exp(draw.uniform(np.log(0.1), np.log(1.0)))) / lasts
    torque = tuple((size * way / np.linalg.norm(way)).tolist())
    start = float(draw.uniform(6.0, LENGTH - 7.0)) if middle is None else middle - 0.5 * lasts
    return Shove(start=start, lasts=lasts, torque_body=torque)


@pytest.mark.parametrize(
    ("length", "middle"),
    [
        (LENGTH, None),
        (LENGTH, 2.0 * LONGEST),
        (4.0 * LONGEST, 2.0 * LONGEST),
        (4.0 * LONGEST, 1.5 * LONGEST),
        (2.4 * LONGEST, 1.3 * LONGEST),
    ],
    ids=["anywhere", "between segments", "of few", "between those half a segment later", "of two"],
)
def test_the_moment_of_a_push_is_found(sads, draw, length, middle):
    shove = a_shove(draw, middle)
    print(shove)
    (push,) = pushes_of([flown(sads, draw, shove, length=length)], sads)
    assert push.start < shove.start + shove.lasts
    assert shove.start < push.stop
    assert push.stop - push.start < 5.0


def test_segments_apart_are_fitted_on_where_the_undamped_step_leads_nowhere(sads):
    """Of this flight the parts beside a push: their fit once stopped at 1.7, and so a second push
    seemed to be in the first part."""
    draw = np.random.default_rng(313377158040094721088050582100102598602)
    log = flown(sads, draw, a_shove(draw, 1.3 * LONGEST), length=2.4 * LONGEST)
    parts = [part_of(log, 5.0, 12.75), part_of(log, 18.0, 24.0)]
    scatter = 1.0 / baseline_of(parts, sads, follows=False).prediction.weights
    assert scatter.max() < 1.2


def test_what_is_at_work_all_the_time_is_no_push(sads, draw):
    drag = effect_named("bearing_viscous_friction")(damping=0.1)
    for effects in ((), (drag,)):
        log = flown(sads, draw, *effects, length=3.0 * LONGEST)
        assert not pushes_of([log], sads)


def test_what_is_left_of_a_log_are_its_parts_between_pushes_long_enough_to_be_logs(sads, draw):
    log = flown(sads, draw)
    pushes = [
        PushInterval(0, "a", 20.0, 20.5),
        PushInterval(0, "a", 22.0, 23.0),
        PushInterval(0, "a", 58.0, 58.5),
    ]
    first, second = but_for(pushes, [log])
    assert first["gyro"].time[-1] <= 20.0
    assert second["gyro"].time[0] >= 23.0
    assert second["gyro"].time[-1] <= 58.0
    assert but_for(pushes, [log, log])[2] is log, "of another log nothing is left out"


@pytest.mark.slow(50)
def test_the_verdict_is_on_the_rest_and_the_push_is_told(sads, draw):
    shove = a_shove(draw, 1.1 * LONGEST)
    found = diagnose([flown(sads, draw, shove, length=2.2 * LONGEST)], sads)
    assert found.verdict == "unexplained"
    assert not found.causes
    (push,) = found.pushes
    assert push.start < shove.start + shove.lasts
    assert shove.start < push.stop
    said = "\n".join(diagnosed(found))
    assert "once something happened that no cause explains" in said
    assert f"from {push.start:.2f} to {push.stop:.2f} s" in said
