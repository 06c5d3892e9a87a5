"""How a machine could be excited next: a small library, each a flight that a lab can repeat."""

import shlex
from dataclasses import dataclass, replace

import numpy as np

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.errors import ControllerError
from twin.estimators import load_estimator, usual_estimator
from twin.flight import Flight
from twin.library import library
from twin.loop import Ended
from twin.metrics import Metrics
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform, variants_of
from twin.recording import Recording
from twin.reference import parse_reference
from twin.rotation import from_euler_zyx
from twin.stream.recorder import MemoryRecorder

Angles = tuple[float, float, float]

TRACKERS = ("quaternion_pd", "cmg_pd")
"""Laws that follow any reference, the first that the machine can take."""
BALANCERS = ("mass_magnetic_pid", "mass_pid")
"""Laws that bring a machine without those back to level."""
MOTIONS = ("multisine:5", "multisine:15", "slew:10,-10,120@5")
"""What a tracker is to follow."""
TILTED: Angles = (5.0, 3.0, 0.0)
"""Where a table floats free from [deg]."""
SPINNING: Angles = (0.0, 0.0, 5.0)
"""And how fast it turns there [deg/s]."""
SWINGS = (30.0, 100.0)
"""Where a pendulum swings free from [deg]."""
NEAR = 0.95
"""Share of the way to its stop that a run may use."""
TO_FILE = "next.rrd"


@dataclass(frozen=True)
class Excitation:
    """One run of `twin run`."""

    platform: Platform
    """The machine as its files state it, or a variant that differs in its field."""
    controller: str
    duration: float
    """[s]."""
    reference: str = "hold"
    attitude: Angles = (0.0, 0.0, 0.0)
    """At the start [deg]."""
    rate: Angles = (0.0, 0.0, 0.0)
    """Likewise [deg/s]."""

    @property
    def command(self) -> str:
        """The line that flies it."""
        words = ["twin", "run", _name(self.platform), "--controller", self.controller]
        if self.controller != "free_float":
            words += ["--reference", self.reference]
        for key, angles in (("--attitude", self.attitude), ("--rate", self.rate)):
            if any(angles):
                words += [key, *(f"{angle:g}" for angle in angles)]
        words += ["--duration", f"{self.duration:g}", "--plant", "sim", "--rrd", TO_FILE]
        return shlex.join(words)

    @property
    def words(self) -> str:
        """Its name for people: `quaternion_pd following multisine:5`."""
        if self.controller == "free_float":
            return f"{_name(self.platform)} floating free"
        return f"{self.controller} following {self.reference}"

    def flown(self, machine: Platform, *, seed: int = 0) -> Recording | None:
        """What a machine like `platform` would record; None where it hits a stop or its limits.

        Raises:
            TwinError: the machine cannot fly it.
        """
        law = load_controller(self.controller)
        roll, pitch, yaw = np.radians(self.attitude)
        rate = np.radians(self.rate)
        initial = InitialState(
            attitude=from_euler_zyx(yaw, pitch, roll),
            rate_body=rate,
            joint_angle=float(roll),
            joint_rate=float(rate[0]),
        )
        memory, metrics = MemoryRecorder(machine), Metrics(machine)
        with SimulatedPlant(machine, seed=seed, initial=initial) as plant:
            flight = Flight(
                plant,
                load_estimator(usual_estimator(machine)),
                law,
                parse_reference(self.reference),
                self.duration,
                initial,
            )
            outcome = flight.fly(SimulatedClock(), [memory, metrics])
        found = metrics.rows()
        if outcome.ended is not Ended.done:
            return None
        if np.any(np.isfinite(found.get("wheel_saturated_at_s", np.nan))):
            return None
        log = memory.recording()
        if "truth_attitude" in log and machine.base.kind != "hinge":
            lean = float(machine.lean(log["truth_attitude"].value).max())
            if lean > NEAR * machine.stop_angle:
                return None
        return log.without_truth()


def excitations(platform: Platform, duration: float) -> list[Excitation]:
    """The library for a machine; empty where nothing excites it."""
    if platform.base.kind == "free":
        return []
    if platform.base.kind == "hinge":
        swings = [(angle, 0.0, 0.0) for angle in SWINGS]
        return [Excitation(platform, "free_float", duration, attitude=one) for one in swings]
    found: list[Excitation] = []
    tracker = _first_able(TRACKERS, platform)
    balancer = _first_able(BALANCERS, platform)
    if tracker:
        found += [Excitation(platform, tracker, duration, motion) for motion in MOTIONS]
    elif balancer:
        found.append(Excitation(platform, balancer, duration, attitude=TILTED))
    free = Excitation(platform, "free_float", duration, attitude=TILTED, rate=SPINNING)
    found.append(free)
    found += [replace(free, platform=other) for other in _other_fields(platform)]
    return found


def _first_able(laws: tuple[str, ...], platform: Platform) -> str:
    """The first law that drives a machine; empty where none does."""
    for name in laws:
        try:
            load_controller(name).init(platform, 1)
        except ControllerError:
            continue
        return name
    return ""


def _other_fields(platform: Platform) -> list[Platform]:
    """Variants of a machine in another magnetic field, its mass properties the same."""
    others = [load_platform(f"{platform.folder}:{name}") for name in variants_of(platform.folder)]
    return [
        other
        for other in others
        if not np.array_equal(other.magnetic_field, platform.magnetic_field)
        and np.array_equal(other.inertia, platform.inertia)
        and np.array_equal(other.center_of_mass_offset, platform.center_of_mass_offset)
    ]


def _name(platform: Platform) -> str:
    """A machine as a command line names it."""
    if platform.folder.resolve() == (library("models") / platform.folder.name).resolve():
        stem = platform.folder.name
    else:
        stem = str(platform.folder)
    _, _, variant = platform.name.partition(":")
    return f"{stem}:{variant}" if variant else stem
