"""`twin identify LOG...`: inertia and mass moment, with intervals and what the logs cannot tell."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class Identify:
    """Identify inertia and mass moment from logs of one machine, all together.

    prediction-error fits the predicted trajectory to every sample, with initial states and sensor
    biases; momentum is linear least squares on the balance of angular momentum, quicker and
    coarser. Intervals are 95 %.
    """

    logs: tyro.conf.Positional[tuple[Path, ...]]
    """Folders with a log.toml, or .rrd recordings."""
    method: Literal["prediction-error", "momentum"] = "prediction-error"
    """How."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """The machine, by name or folder; default: the one that the first log names."""
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Identify and print."""
        from twin.cli.output import print_json
        from twin.conventions import convention_advice
        from twin.errors import UsageError
        from twin.identify import identify
        from twin.platform import common_platform, load_platform
        from twin.recording import open_log
        from twin.report import identified

        if not self.logs:
            raise UsageError("no log is named; give a folder with a log.toml or an .rrd")
        recordings = [open_log(path) for path in self.logs]
        machine = (
            common_platform(recordings) if self.platform is None else load_platform(self.platform)
        )
        for path, recording in zip(self.logs, recordings, strict=True):
            warning = convention_advice(recording, machine).warning
            if warning:
                print(f"{path}: {warning}", file=sys.stderr)
        found = identify(recordings, machine, self.method)
        if self.json:
            print_json(found.document())
        else:
            print("\n".join(identified(found)))
        return 0
