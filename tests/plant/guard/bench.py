"""A machine that shows what it is told to show, behind its guard, and the ticks of its loop."""

from dataclasses import replace

import numpy as np

from twin.plant.guard.guarded import Guarded, GuardPhase
from twin.plant.guard.rules import GuardSettings
from twin.plant.plant import Plant
from twin.platform import Platform, load_platform
from twin.signals import Command, Reading, Samples

SETTINGS = GuardSettings(
    max_balance_step=0.05, tilt_cutout=np.radians(20.0), stroke_margin=5e-3, stale_cycles=5
)


class Scripted(Plant):
    """Shows what it is told to show, and keeps what it is told to do."""

    def __init__(self, platform: Platform) -> None:
        self.platform, self.n, self.stopped = platform, 1, {}
        self.shown = {
            "attitude": np.array([1.0, 0.0, 0.0, 0.0]),
            "gyro": np.zeros(3),
            "stage_position": np.zeros(len(platform.stages)),
            "wheel_speed": np.zeros(len(platform.wheels)),
            "gimbal_angle": np.zeros(len(platform.gimbals)),
            "floating": np.ones(1),
        }
        if "inclinometer" in platform.sensors:
            self.shown["inclinometer"] = np.zeros(2)
        self.silent: set[str] = set()
        self.told: list[Command] = []
        self.safe: list[tuple[Command, bool]] = []

    def read(self, until: float) -> Reading:
        stamp = np.full((1, 1), until)
        return Reading(
            until,
            {
                name: Samples(
                    value.reshape(1, 1, -1).astype(float),
                    stamp,
                    np.isfinite(value).all(keepdims=True).reshape(1, 1),
                )
                for name, value in self.shown.items()
                if value.size and name not in self.silent
            },
        )

    def write(self, command: Command) -> Command:
        self.told.append({name: value.copy() for name, value in command.items()})
        return dict(command)

    def safe_stop(self, rest: Command, *, floating: bool) -> None:
        self.safe.append((rest, floating))


class Bench:
    """A guarded machine, and the ticks of its loop."""

    def __init__(self, name: str = "sads", settings: GuardSettings = SETTINGS, **changes) -> None:
        self.platform = replace(load_platform(name), **changes)
        self.plant = Scripted(self.platform)
        self.guard = Guarded(self.plant, settings, calibrated=True)
        self.tick = 0
        self.read()

    def read(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self.guard.read(self.tick * self.platform.tick)
            self.tick += 1

    def armed(self) -> "Bench":
        self.guard.arm("arm")
        return self

    def tell(self, **command) -> Command:
        """Read and write once; what was applied, (columns,) each."""
        self.read()
        wish = {f"command_{name}": np.array([value]) for name, value in command.items()}
        return {name: value[0] for name, value in self.guard.write(wish).items()}

    def is_safe(self, sentence: str) -> bool:
        """Stopped for that reason, told once, and nothing leaves any more."""
        count = len(self.plant.told)
        self.tell()
        return (
            self.guard.phase is GuardPhase.stopped
            and sentence in self.guard.safe_reason
            and self.guard.stopped == {0: self.guard.safe_reason}
            and len(self.plant.safe) == 1
            and len(self.plant.told) == count
        )
