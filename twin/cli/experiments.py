"""The verbs of experiments and routine procedures: `twin isolate` and others."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from twin.shown import Shown


def _arg(metavar: str) -> object:
    return tyro.conf.arg(metavar=metavar)


def _show(result: "Shown", *, json: bool, html: Path | None) -> None:
    """Print a result, and write its page."""
    from twin.cli.output import print_json

    print_json(result.document()) if json else print(result)
    if html is not None:
        result.save(html)
        print(f"wrote {html}", file=sys.stderr if json else sys.stdout)


@dataclass(frozen=True)
class Isolate:
    """What a planned experiment could detect, and which causes it could not tell apart.

    The run is simulated with the machine's sensors as stated; J, m r, the sensors' constant errors
    and the initial states stay free, as in `twin diagnose`. Sizes are those of the linearised model
    at which a cause has the evidence asked for.
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    reference: Annotated[str | None, _arg("REFERENCE")] = None
    """As of `twin run`; by default the machine's usual excitation."""
    controller: Annotated[str | None, _arg("LAW")] = None
    """By default the first law that makes the machine follow a reference."""
    sensors: Annotated[tuple[str, ...], _arg("STREAM ...")] = ()
    """Streams that are measured; by default all that the platform states."""
    duration: Annotated[float, _arg("SECONDS")] = 60.0
    """Of the experiment."""
    evidence: Annotated[float, _arg("NUMBER")] = 60.0
    """At which a cause counts as detectable."""
    brief: bool = False
    """Leave out the comparison with other sensors and motions, which takes most of the time."""
    seed: int = 0
    """Of the sensors' noise."""
    html: Annotated[Path | None, _arg("OUT.html")] = None
    """Write a page with the matrix; an existing file is overwritten."""
    json: bool = False
    """Print one JSON document instead of a table."""

    def run(self) -> int:
        """Simulate, weigh, print."""
        from twin import isolate
        from twin.cli.output import progress
        from twin.files import check_writable

        if self.html is not None:
            check_writable(self.html, ".html")
        with progress() as say:
            result = isolate(
                self.platform,
                reference=self.reference,
                controller=self.controller,
                sensors=self.sensors or None,
                duration=self.duration,
                evidence=self.evidence,
                advise=not self.brief,
                seed=self.seed,
                say=say,
            )
        _show(result, json=self.json, html=self.html)
        return 0


@dataclass(frozen=True)
class Excite:
    """The motion within a machine's limits that tells most of what is asked.

    A multisine of roll, pitch and yaw that a shipped law follows; of a machine that no law turns at
    will, the attitude and rate to let it go from. It is simulated with the machine's actuators and
    sensors throughout, keeps a fifth of the way to each limit free, and its forecast is held
    against flights with other noise.
    """

    platform: Annotated[str, tyro.conf.Positional, _arg("PLATFORM")]
    """A shipped name (see `twin platforms`) or a folder; `:VARIANT` may follow."""
    out: Annotated[Path | None, tyro.conf.Positional, _arg("OUT.csv")] = None
    """Write the reference into this file, for `twin run --reference`."""
    wanted: Annotated[str, tyro.conf.arg(name="for", metavar="inertia|CAUSE|CAUSE,CAUSE")] = (
        "inertia"
    )
    """What the experiment is for: J; the size of an effect (`twin effects`), as in
    `wheel_friction:w1`; or to tell two effects apart."""
    duration: Annotated[float, _arg("SECONDS")] = 60.0
    """Of the experiment."""
    evaluations: Annotated[int, _arg("N")] = 90
    """Simulated trials of the search."""
    flights: Annotated[int, _arg("N")] = 8
    """With other noise, which the forecast is held against; 0: none."""
    seed: int = 0
    """Of the search and of the noise."""
    html: Annotated[Path | None, _arg("OUT.html")] = None
    """Write a page; an existing file is overwritten."""
    json: bool = False
    """Print one JSON document instead of sentences."""

    def run(self) -> int:
        """Search, check, write, print."""
        from twin import excite
        from twin.cli.output import progress
        from twin.files import check_writable

        if self.html is not None:
            check_writable(self.html, ".html")
        with progress() as say:
            result = excite(
                self.platform,
                self.wanted,
                duration=self.duration,
                evaluations=self.evaluations,
                flights=self.flights,
                out=self.out,
                seed=self.seed,
                say=say,
            )
        _show(result, json=self.json, html=self.html)
        return 0
