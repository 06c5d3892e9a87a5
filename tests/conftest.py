"""What tests of many folders share: a pendulum apart from MuJoCo, a short check, a claim kept."""

import gc
import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from tests.seeds import seed_of
from tests.signals import NUMBERS
from tests.wall_clock import patient_drivers, pytest_runtest_protocol  # noqa: F401 (for all)
from twin.check import motion
from twin.clock import SimulatedClock
from twin.effects import parse_effects
from twin.flight import prepare
from twin.plant.initial import InitialState
from twin.platform import Platform, load_platform
from twin.recording import Recording, Series
from twin.stream.recorder import MemoryRecorder

SLOW_LIMIT = 600.0
"""Of a slow test [s]; the limit of all others is in pyproject.toml."""
SLOW_BUDGET = float(os.environ.get("SLOW_TESTS_BUDGET", "inf"))
"""After which no slow test begins [s]: on a computer at a third of the usual speed CI would not
end in its time. What does not run is skipped, and counted."""
STARTED = time.monotonic()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Ways to see how often a test holds whose case is drawn."""
    parser.addoption("--draws", type=int, default=1, help="repeat each test that draws its seed")
    parser.addoption("--seed", type=int, help="draw other cases than the release's")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Repeat tests that draw their seed."""
    draws = metafunc.config.getoption("--draws")
    if draws > 1 and "drawn_seed" in metafunc.fixturenames:
        metafunc.parametrize("drawn_seed", range(draws), indirect=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Slow tests have a longer limit, and those that say how long they take [s] come first."""

    def seconds(item: pytest.Item) -> float:
        mark = item.get_closest_marker("slow")
        return mark.args[0] if mark and mark.args else 0.0

    items.sort(key=seconds, reverse=True)
    for item in items:
        if item.get_closest_marker("slow") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(SLOW_LIMIT))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip slow tests that the budget has no time for."""
    if item.get_closest_marker("slow") and time.monotonic() - STARTED > SLOW_BUDGET:
        pytest.skip(f"the slow tests' {SLOW_BUDGET:.0f} s are over")


def pytest_collection_finish() -> None:
    """Campaigns sweep memory after every shard; thousands of collected tests need no look there."""
    gc.freeze()


@pytest.fixture
def hears() -> Iterator[None]:
    """Signals arrive, though a script may have started the tests deaf to Ctrl-C."""
    before = {number: signal.getsignal(number) for number in NUMBERS}
    for number in NUMBERS:
        usual = number == signal.SIGINT
        signal.signal(number, signal.default_int_handler if usual else signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


FAN = '''
from dataclasses import dataclass

import numpy as np

from twin.effects import BodyEffect, Domain, Push, parameter


@dataclass(frozen=True)
class Fan(BodyEffect):
    """A fan that somebody forgot on the table."""

    name = "fan"
    domain = Domain.torque
    observable = "it turns"
    streams = ("gyro",)

    size: float = parameter("of the fan", "N m", 1e-3, source="measured")

    def pushes(self, platform):
        return (Push(platform.base.body, np.array([0.0, 0.0, 0.0, self.size, 0.0, 0.0])),)
'''
"""The file of an effect that a lab adds."""


@dataclass(frozen=True)
class Swing:
    """What is hidden in a simulated log of the DFKI pendulum."""

    seed: int = 0
    duration: float = 20.0
    inertia: float = 0.1367
    moment: float = 0.273
    """m r [kg m]."""
    dry: float = 0.0
    viscous: float = 0.0
    gain: float = 1.0
    delay: float = 0.0
    angle_noise: float = 1e-3
    rate_noise: float = 2e-2
    torque: float = 1.2


def _simulate(hidden: Swing) -> Recording:
    """RK4 at 1 ms under held random torques, sampled at 200 Hz."""
    generator = np.random.default_rng(hidden.seed)
    rate, fine = 200.0, 5
    count = int(hidden.duration * rate)
    # A new torque every 0.4 s, never in step with the motion.
    levels = generator.uniform(-1.0, 1.0, int(hidden.duration / 0.4) + 2) * hidden.torque
    step = 1.0 / (rate * fine)
    late = round(hidden.delay / step)

    def command(tick: int) -> float:
        return float(levels[max(tick, 0) // round(0.4 / step)])

    def slope(angle: float, speed: float, tick: int) -> tuple[float, float]:
        torque = hidden.gain * command(tick - late) - 9.81 * hidden.moment * np.sin(angle)
        torque -= hidden.dry * np.tanh(speed / 0.02) + hidden.viscous * speed
        return speed, torque / hidden.inertia

    angle, speed = generator.uniform(-1.0, 1.0), 0.0
    angles, speeds = np.empty(count), np.empty(count)
    for sample in range(count):
        angles[sample], speeds[sample] = angle, speed
        for tick in range(sample * fine, (sample + 1) * fine):
            a1, b1 = slope(angle, speed, tick)
            a2, b2 = slope(angle + 0.5 * step * a1, speed + 0.5 * step * b1, tick)
            a3, b3 = slope(angle + 0.5 * step * a2, speed + 0.5 * step * b2, tick)
            a4, b4 = slope(angle + step * a3, speed + step * b3, tick)
            angle += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            speed += step / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
    time = np.arange(count) / rate
    given = np.array([command(sample * fine) for sample in range(count)])
    angles += generator.normal(0.0, hidden.angle_noise, count)
    speeds += generator.normal(0.0, hidden.rate_noise, count)
    streams = {
        "joint_angle": Series(time, angles[:, None], ("pivot",), "rad"),
        "joint_rate": Series(time, speeds[:, None], ("pivot",), "rad/s"),
        "command_joint_torque": Series(time, given[:, None], ("pivot",), "N m"),
    }
    return Recording(streams, {"source": f"swing {hidden.seed}", "platform": "dfki_pendulum"})


@pytest.fixture(scope="session")
def pendulum() -> Platform:
    return load_platform("dfki_pendulum")


@pytest.fixture(scope="session")
def swing() -> Callable[..., Recording]:
    """A log of the pendulum with what the keywords of `Swing` hide in it."""
    return lambda **hidden: _simulate(Swing(**hidden))


@pytest.fixture(scope="session")
def flight_of() -> Callable[..., Recording]:
    """A simulated flight as a log: flight_of(platform, law, reference, duration, seed, hidden,
    initial)."""

    def fly(
        platform: str,
        law: str,
        reference: str | None,
        duration: float,
        seed: int,
        hidden: str = "",
        initial: InitialState | None = None,
    ) -> Recording:
        flight = prepare(
            platform,
            controller=law,
            estimator=None,
            plant="sim",
            reference=reference,
            duration=duration,
            seed=seed,
            effects=parse_effects(hidden) if hidden else [],
            initial=initial,
        )
        memory = MemoryRecorder(flight.platform, {"platform": platform, "source": f"seed {seed}"})
        flight.fly(SimulatedClock(), [memory])
        return memory.recording().without_truth()

    return fly


@pytest.fixture
def drawn_seed(request: pytest.FixtureRequest) -> int:
    """Another one for each test, printed (`tests/seeds.py`).

    `--draws N` repeats each test that takes it, and `--seed N` draws others.
    """
    return seed_of(request)


@pytest.fixture
def brief_check(monkeypatch: pytest.MonkeyPatch) -> None:
    """`twin check` flies a second in place of a minute, where the step is not what is in doubt."""
    monkeypatch.setattr(motion, "STEP_TIME", 1.0)


@pytest.fixture
def agrees(record_property) -> Callable[[str, float, float, str], None]:
    """Hold a deviation to its tolerance; `python -m benchmarks.fidelity` makes a table of both."""

    def check(what: str, deviation: float, tolerance: float, unit: str = "of the size") -> None:
        claim = {"what": what, "deviation": deviation, "tolerance": tolerance, "unit": unit}
        record_property("claim", json.dumps(claim))
        print(f"{what}: {deviation:.1e}, claimed {tolerance:.0e} {unit}")
        assert deviation <= tolerance, what

    return check
