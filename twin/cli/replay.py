"""`twin replay`: one run of a campaign again, to the same bits."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from twin.campaigns.replay import Replayed
    from twin.campaigns.spec import Spec


@dataclass(frozen=True)
class Replay:
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
        from twin.campaigns.folder import Folder
        from twin.campaigns.read import read_spec
        from twin.campaigns.replay import replay
        from twin.cli.output import check_writable, print_json

        folder = Folder(self.folder)
        if self.rrd is not None:
            check_writable(self.rrd, ".rrd")
        spec = read_spec(folder.spec)
        folder.check_spec()
        told = replay(spec, folder, self.run_number, self.rrd)
        if self.json:
            same = None if told.differs is None else not told.differs
            print_json(
                {
                    "run": told.run,
                    "arm": told.arm,
                    "ended": told.came.ended,
                    "reason": told.came.reason or None,
                    "duration": told.came.duration,
                    "factors": told.values,
                    "metrics": told.came.metrics,
                    "same_bits": same,
                    "recording": self.rrd,
                }
            )
        else:
            print("\n".join(self._report(told, spec)))
        return 1 if told.differs else 0

    def _report(self, told: "Replayed", spec: "Spec") -> list[str]:
        from twin.campaigns.merit import METRICS
        from twin.units import printed

        units = {factor.name: factor.unit for factor in spec.factors}
        end = f"run {told.run}, {told.arm}: {told.came.ended} after {told.came.duration:g} s"
        lines = [f"{end}: {told.came.reason}" if told.came.reason else end]
        lines += [f"  {name} {printed(v, units[name])}" for name, v in told.values.items()]
        lines += [
            f"  {name} {printed(v, METRICS[name].unit) if v == v else 'none'}"
            for name, v in told.came.metrics.items()
        ]
        if told.differs is None:
            lines.append("the campaign has not written this run yet")
        elif told.differs:
            lines.append("not what the campaign wrote: " + ", ".join(told.differs))
        else:
            lines.append("to the last bit what the campaign wrote")
        if self.rrd is not None:
            lines.append(f"recorded in {self.rrd}: look at it with `twin view {self.rrd}`")
        return lines
