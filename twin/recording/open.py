"""Any log, by its path: a recording (`.rrd`) or a folder with a log.toml."""

from dataclasses import replace
from pathlib import Path

from twin.errors import LogError, RecordingError
from twin.recording.formats import ENDINGS, Say, silent
from twin.recording.log import read_log
from twin.recording.read import read_recording, which
from twin.recording.recording import Recording
from twin.stop import check


def open_log(path: str | Path, say: Say = silent) -> Recording:
    """Read an `.rrd`, a folder that holds a log.toml, or that log.toml; its `provenance` has the
    path as its `source`. `say` takes a line of progress where that takes more than a moment.

    Raises:
        RecordingError: no such thing, or an `.rrd` that cannot be read.
        LogError: a folder that cannot be read, or a file that belongs into one.
        Stopped: a stop was requested.
    """
    check()
    path = Path(path)
    if path.is_dir() or path.name == "log.toml":
        return _from(path, read_log(path, say))
    if not which(path)[0].exists():
        raise RecordingError(
            path, "there is no such log", "name an .rrd, or a folder that holds a log.toml"
        )
    if path.suffix.lower() in ENDINGS:
        raise LogError(
            path,
            "is a file of numbers that does not say what they are",
            "put it into a folder with a log.toml that does (docs/logs.md), and name the folder",
        )
    return _from(path, read_recording(path))


def _from(path: Path, recording: Recording) -> Recording:
    return replace(recording, provenance={**recording.provenance, "source": str(path)})
