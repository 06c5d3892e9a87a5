"""`twin view`: a log in the Rerun viewer."""

import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from twin.platform import Platform
    from twin.recording import Recording

_VIEWER = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
"""In place of `-m rerun_cli`, which ends with 0 whatever became of the viewer."""


@dataclass(frozen=True)
class View:
    """Open a log in the Rerun viewer; returns when the viewer is closed."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG")]
    """A recording (.rrd) or a folder with a log.toml."""

    def kept(self) -> str:
        """Of a viewer that was closed with this program."""
        return "the viewer was closed"

    def run(self) -> int:
        """Show it; the exit code."""
        from twin.cli.output import LogPart
        from twin.stream.runfile import write_recording

        recording = LogPart().open(self.log)
        for repair in recording.repairs:
            print(f"repaired: {repair}", file=sys.stderr)
        if self.log.suffix == ".rrd" and not recording.repairs:
            return _show(self.log)
        with TemporaryDirectory() as folder:
            copy = Path(folder) / f"{self.log.resolve().stem}.rrd"
            write_recording(recording, copy, _platform(recording))
            return _show(copy)


def _platform(recording: "Recording") -> "Platform | None":
    """The machine, if it can be found; without it there are plots but no 3D view."""
    from twin.errors import TwinError
    from twin.platform import platform_of

    try:
        return platform_of(recording)
    except TwinError as problem:
        print(f"the machine cannot be drawn: {problem}", file=sys.stderr)
        return None


def _show(path: Path) -> int:
    from twin.errors import TwinError
    from twin.processes import run

    code = run([sys.executable, "-c", _VIEWER, str(path)])
    if code:
        raise TwinError(
            f"the viewer ended with code {code}, and says why above; "
            "without a display, open the file where there is one"
        )
    return 0
