"""Machines, how they are moved and how well they are measured: where effects are hidden."""

import hashlib
import os
import re
import subprocess
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from twin.diagnosis import diagnosis
from twin.diagnosis.candidates import Candidate, candidate, candidates_of
from twin.diagnosis.experiment import Angles, SimulatedRun
from twin.diagnosis.explanation import Explanation
from twin.diagnosis.screen import LinearScreen
from twin.effects import Effect, Order, SeriesEffect, able, catalogue, with_effects
from twin.errors import PlatformError, UsageError
from twin.model import compile_model
from twin.platform import Platform, Sensor, load_platform
from twin.predict.columns import amplitudes
from twin.recording import Recording

GRADES = {"fine": (1e-4, 1e-4), "middle": (1e-3, 1e-3), "coarse": (4.4e-3, 3.5e-2)}
"""1 sigma of gyro [rad/s] and attitude [rad]."""
FIELD = np.array([2.2e-5, 0.0, -4.2e-5])
"""Where a platform states none, that a dipole may be felt [T]."""
OFF = 0.05
"""Share by which the believed J and m r may be wrong."""
KEPT = Path(__file__).parents[2] / "runs" / "benches"
"""Where yardsticks are kept."""
SHAKEN = str(Path(__file__).parent / "shaken.py")


@dataclass(frozen=True)
class Bench:
    """A machine, how it is moved, and how well it is measured."""

    platform: str = "sads"
    controller: str = "quaternion_pd"
    grade: str = "middle"
    rate: float = 50.0
    """Of gyro and attitude [Hz]."""
    duration: float = 120.0
    """[s]."""
    reference: str = "multisine"
    attitude: Angles = (0.0, 0.0, 0.0)
    """At the start [deg]."""
    turning: Angles = (0.0, 0.0, 0.0)
    """Likewise [deg/s]."""
    depth: float = 0.0
    """Where the machine is made to hang: its m r below the CR [kg m]."""

    @property
    def words(self) -> str:
        """`sads, quaternion_pd, multisine`."""
        law = Path(self.controller).stem
        how = "" if law == "free_float" else f", {self.reference}"
        hung = f", hanging by {self.depth:g} kg m" if self.depth else ""
        return f"{self.platform}, {law}{how}{hung}"

    @property
    def file(self) -> str:
        """A name for a file of it."""
        kind = re.sub(r"[^a-z0-9]+", "-", self.words)
        return f"{kind}-{self.grade}-{self.rate:g}-{self.duration:g}"


LIBRARY = (
    Bench(),
    Bench(reference="slew:10,-10,120@5"),
    Bench(controller="free_float", attitude=(12.0, 8.0, 0.0), turning=(0.0, 0.0, 3.0), depth=0.4),
    Bench(controller=SHAKEN, reference="multisine:2", depth=0.1),
    Bench(controller=SHAKEN),
    Bench("tas2", SHAKEN),
    Bench("cubesat", SHAKEN, reference="hold", attitude=(5.0, 3.0, 0.0)),
    Bench("whorl1", SHAKEN, reference="multisine:2"),
    Bench("whorl1", "thruster_pd", reference="multisine:2"),
    Bench("whorl2", SHAKEN),
    Bench("whorl2", "free_float", attitude=(45.0, 0.0, 0.0)),
    Bench("astros:mode_b", SHAKEN),
    Bench("astros:mode_c", SHAKEN),
)
"""Of 120 s at 50 Hz and the middle grade."""


@cache
def machine(bench: Bench) -> Platform:
    """In a field, its sensors of the wanted grade and rate; effects that it states are left out,
    so that they can be asked for."""
    platform = load_platform(bench.platform)
    gyro, attitude = GRADES[bench.grade]
    noise = {"gyro": gyro, "attitude": attitude}

    def graded(name: str, sensor: Sensor) -> Sensor:
        if name not in noise:
            return sensor
        return replace(sensor, noise=np.full_like(sensor.noise, noise[name]), rate=bench.rate)

    sensors = {name: graded(name, sensor) for name, sensor in platform.sensors.items()}
    offset = platform.center_of_mass_offset
    if bench.depth:
        offset = np.array([*offset[:2], -bench.depth])
    field = platform.magnetic_field if np.any(platform.magnetic_field) else FIELD
    return replace(
        platform,
        sensors=sensors,
        magnetic_field=field,
        center_of_mass_offset=offset,
        effects=(),
    )


def flown(bench: Bench, effects: tuple[Effect, ...], seed: int) -> Recording | None:
    """A run of the true machine on half the step; None where it hits a stop or its limits.

    Raises:
        EffectError: the machine cannot have the effects.
    """
    platform = machine(bench)
    # a window of a step would be another sensor's on half of it
    sensors = {
        name: replace(sensor, window=sensor.window or platform.step) if sensor.site else sensor
        for name, sensor in platform.sensors.items()
    }
    platform = replace(platform, step=0.5 * platform.step, sensors=sensors)
    for effect in effects:
        platform = able(platform, effect)
    excitation = SimulatedRun(
        platform, bench.controller, bench.duration, bench.reference, bench.attitude, bench.turning
    )
    return excitation.flown(with_effects(platform, effects), seed=seed)


def believed(bench: Bench, rng: np.random.Generator) -> Platform:
    """The machine with J and m r a little wrong, as a rigid body has them."""
    platform = machine(bench)
    while True:
        scale = 1.0 + OFF * rng.uniform(-1.0, 1.0, 3)
        inertia = platform.inertia * np.sqrt(np.outer(scale, scale))
        shift = OFF * np.linalg.norm(platform.center_of_mass_offset) * rng.uniform(-1.0, 1.0, 3)
        off = replace(
            platform,
            inertia=inertia,
            center_of_mass_offset=platform.center_of_mass_offset + shift,
        )
        try:
            compile_model(off)
        except PlatformError:
            continue
        return off


@dataclass(frozen=True)
class Yardstick:
    """What the signature of each cause is on a bench, from a run with nothing hidden."""

    bench: Bench
    effects: tuple[Effect, ...]
    """Those that the bench shows, each without size and of its typical shape."""
    screen: LinearScreen
    """Of them, in their order; the base is projected out."""

    @property
    def labels(self) -> list[str]:
        """Of all that the bench shows."""
        return [effect.label for effect in self.effects]

    def beside(self, *others: Effect) -> tuple[LinearScreen, tuple[Candidate, ...]]:
        """All of them, then others at the shapes that they have, those without a trace left out."""
        platform = machine(self.bench)
        every = [candidate(effect.absent(), platform) for effect in (*self.effects, *others)]
        every = [one for one in every if one.perturbations]
        return _plain(self.bench).screen(every), tuple(every)

    def evidence(self, effect: Effect) -> float:
        """That an effect of this size has, in a run with it: a law answers to what rings.

        Raises:
            UsageError: such a run ends at a stop or a limit.
        """
        platform, size = machine(self.bench), amplitudes(effect)
        log = flown(self.bench, (effect,), seed=0)
        if log is None:
            raise UsageError(f"{self.bench.words} ends at a stop or a limit with {effect.words()}")
        found = diagnosis.baseline_of([log], platform)
        if isinstance(effect, SeriesEffect) and effect.order is Order.delay:
            # what it gains as it is: along a slope it would do more than it can
            return found.cost - found.instead((effect,)).cost
        screen = found.screen([candidate(effect, platform)])
        signature = screen.signature(0, effect.values[size])
        return float(signature @ signature)


@cache
def yardstick(bench: Bench) -> Yardstick:
    """Of a bench; kept on disk for as long as machines, laws and effects are the same.

    Raises:
        TwinError: the bench cannot be flown without a stop, or not be diagnosed.
    """
    path = KEPT / f"{bench.file}-{tree()}.npz"
    if not path.exists():
        asked = candidates_of(_plain(bench).bodies).asked
        screen = _plain(bench).screen(asked)
        shown = [i for i in range(len(asked)) if screen.identifiable(i)]
        columns = {
            asked[i].label: np.column_stack(
                [screen.signature(i, unit) for unit in np.eye(len(asked[i].low))]
            )
            for i in shown
        }
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(f".{os.getpid()}.npz")
        np.savez(unfinished, **columns)
        unfinished.rename(path)
    with np.load(path) as kept:
        columns = dict(kept)
    of_name = {kind.name: kind for kind in catalogue()}
    effects = [
        of_name[label.partition(":")[0]].typical(label.partition(":")[2]).absent()
        for label in columns
    ]
    platform = machine(bench)
    traces = [candidate(effect, platform).trace for effect in effects]
    every = np.column_stack(list(columns.values()))
    silent, no_base = np.zeros(len(every)), np.zeros((len(every), 0))
    return Yardstick(bench, tuple(effects), LinearScreen(silent, no_base, every, traces))


@cache
def _plain(bench: Bench) -> Explanation:
    """The base fitted to a run with nothing hidden."""
    log = flown(bench, (), seed=0)
    if log is None:
        raise UsageError(f"{bench.words} ends at a stop or a limit")
    return diagnosis.baseline_of([log], machine(bench))


@cache
def tree() -> str:
    """Of what is flown and asked. How it is predicted changes, and with it by a little how much
    evidence a size has; that is as it was when a yardstick was made."""
    here = Path(__file__).parent
    git = subprocess.run(
        ["git", "rev-parse", "HEAD:models", "HEAD:controllers", "HEAD:twin/effects"],
        cwd=here.parents[1], capture_output=True, check=False,
    )  # fmt: skip
    own = [(here / name).read_bytes() for name in ("benches.py", "shaken.py")]
    return hashlib.sha256(b"".join([git.stdout, *own])).hexdigest()[:8]
