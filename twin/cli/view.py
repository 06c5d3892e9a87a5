"""`twin view`: a log in the Rerun viewer."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from twin.platform import Platform
    from twin.recording import Recording


@dataclass(frozen=True)
class View:
    """Open a log in the Rerun viewer; returns when the viewer is closed."""

    log: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG")]
    """A recording (.rrd) or a folder with a log.toml."""

    def run(self) -> int:
        """Show it; the exit code."""
        from twin.recording import open_log
        from twin.stream.runfile import write_recording

        recording = open_log(self.log)
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
    done = subprocess.run([sys.executable, "-m", "rerun_cli", str(path)], check=False)
    return 0 if done.returncode == 0 else 1
