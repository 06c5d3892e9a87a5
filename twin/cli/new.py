"""`twin new NAME`: a folder for a lab's own machine, which flies at once."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class New:
    """Write a platform folder to begin a lab's own machine with.

    It passes `twin check` and flies with `twin run` as it is. Put in your own masses, parts and
    sensors, and a source beside each number; `twin check` tells what does not fit together.
    """

    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")]
    """The machine's name, or a path that ends in it."""
    kind: Annotated[str, tyro.conf.arg(metavar="table|pendulum|free")] = "table"
    """A table on a ball bearing, a pendulum on a hinge, or a body that is thrown."""

    from_log: Annotated[Path | None, tyro.conf.arg(metavar="LOG")] = None
    """Begin with the sensors of this log, their rates and their noise."""

    def run(self) -> int:
        """Write it; the exit code."""
        from twin.api import new
        from twin.cli.output import LogPart
        from twin.scaffold import KINDS

        log = None if self.from_log is None else LogPart().open(self.from_log)
        folder = Path(self.name)
        new(folder, self.kind, log)
        print(f"{folder}: {KINDS[self.kind]}")
        print((folder / "README.md").read_text(encoding="utf-8").split("```")[1].strip())
        return 0
