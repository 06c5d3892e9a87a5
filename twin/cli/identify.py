"""`twin identify LOG...`: inertia and mass moment, with intervals and what the logs cannot tell."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from twin.cli.output import LogPart, Restricted

Method = Literal[
    "prediction-error",
    "momentum",
    "torque",
    "energy",
    "filtered",
    "integrated",
    "recursive",
    "levenberg-marquardt",
    "ekf",
    "ukf",
    "equilibria",
    "all",
]


@dataclass(frozen=True)
class Identify:
    """Identify inertia and mass moment from logs of one machine, all together.

    prediction-error fits the predicted motion to every sample, with first states and the sensors'
    constant errors; its 95 % intervals hold. The other methods are those of the field's papers, as
    they stand there: noise biases most of them, and their intervals do not know it.

    torque, momentum, energy, filtered and integrated are least squares on the balance of angular
    momentum; recursive forgets the past; levenberg-marquardt fits one trajectory from start to
    end; ekf and ukf estimate state and base together; equilibria needs rests at several positions
    of the sliding masses. all prints one table.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG [LOG ...]")]
    """Folders with a log.toml, or .rrd recordings."""
    method: Method = "prediction-error"
    """How."""
    form: Literal["integrated", "natural"] = "integrated"
    """Of torque, momentum and energy: from the start on, or with differentiated rates."""
    shift: Annotated[int, tyro.conf.arg(metavar="SAMPLES")] = 0
    """Of momentum: between the two ends of a difference; 0 fits the constant instead."""
    corner: Annotated[float, tyro.conf.arg(metavar="RAD/S")] = 0.5
    """Of filtered: the low-pass filter's."""
    forgetting: Annotated[float, tyro.conf.arg(metavar="0..1")] = 0.99
    """Of recursive: weight that a step of 0.2 s leaves to what came before."""
    physical: bool = False
    """Give the nearest rigid body; prediction-error always does."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine, by name or folder; default: the one that the first log names."""
    part: Restricted = LogPart()
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Identify and print."""
        from twin.api import identify, identify_by_all
        from twin.cli.output import print_json, tell
        from twin.errors import TwinError, UsageError
        from twin.identification import Settings
        from twin.report import compared

        if not self.logs:
            raise UsageError("no log is named; give a folder with a log.toml or an .rrd")
        settings = Settings(self.form, self.shift, self.corner, self.forgetting)
        logs = [self.part.open(path) for path in self.logs]
        if self.method != "all":
            result = identify(
                logs,
                self.platform,
                method=self.method,
                settings=settings,
                physical=self.physical,
                say=tell,
            )
            print_json(result.document()) if self.json else print(result)
            return 0
        by_method = identify_by_all(
            logs, self.platform, settings=settings, physical=self.physical, say=tell
        )
        if self.json:
            print_json(
                [
                    {"method": name, "failed": str(item)}
                    if isinstance(item, TwinError)
                    else item.document()
                    for name, item in by_method.items()
                ]
            )
        else:
            print("\n".join(compared(by_method)))
        return 0
