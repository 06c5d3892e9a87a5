"""The part of a log that a verb reads: --start, --stop and --rate of those that read logs."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from twin.recording import Recording


@dataclass(frozen=True)
class Part:
    """Which rows of each log are read."""

    start: Annotated[float | None, tyro.conf.arg(metavar="S")] = None
    """Leave out what was before, in the log's own time as `twin show` prints it."""
    stop: Annotated[float | None, tyro.conf.arg(metavar="S")] = None
    """Leave out what was after."""
    rate: Annotated[float | None, tyro.conf.arg(metavar="HZ")] = None
    """Of measured streams that are faster take every second, third ... row only."""

    def open(self, path: Path) -> "Recording":
        """A log, or the part of it; a person who waits for it sees how far it is read."""
        from twin.cli.output import progress
        from twin.errors import UsageError
        from twin.recording import open_log, restricted

        for name, value in (("start", self.start), ("stop", self.stop), ("rate", self.rate)):
            if value is not None and not abs(value) < float("inf"):
                raise UsageError(f"--{name} is {value:g}; give a finite number")
        if self.rate is not None and self.rate <= 0.0:
            raise UsageError(f"--rate is {self.rate:g} Hz; it must be above 0")
        with progress() as say:
            recording = open_log(path, say)
        return restricted(recording, start=self.start, stop=self.stop, rate=self.rate)


Restricted = Annotated[Part, tyro.conf.arg(name="")]
"""The type of a verb's field whose arguments these are."""
