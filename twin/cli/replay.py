"""`twin replay`: one run of a campaign again, to the same bits."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class ReplayVerb:
    """Fly one run of a campaign alone, to the same bits, and record it in full."""

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Of the campaign."""
    run_number: Annotated[int, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Its number, from 0."""
    rrd: Annotated[Path | None, tyro.conf.arg(metavar="OUT.rrd")] = None
    """Record into this file; one that exists is written anew."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Fly; 1 where it is not what the campaign wrote."""
        from twin.api import replay
        from twin.cli.output import print_json

        replayed = replay(self.folder, self.run_number, rrd=self.rrd)
        if self.json:
            print_json({**replayed.document(), "recording": self.rrd})
        else:
            print(replayed)
            if self.rrd is not None:
                print(f"recorded in {self.rrd}: look at it with `twin view {self.rrd}`")
        return 1 if replayed.differs else 0
