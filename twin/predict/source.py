"""Open what a user names: a folder log or an `.rrd`, and the platform it was made on."""

from pathlib import Path

from twin.errors import LogError, UsageError
from twin.platform import Platform, load_platform
from twin.recording.log import read_log
from twin.recording.read import read_recording
from twin.recording.recording import Recording


def open_log(path: str | Path) -> Recording:
    """Read a measured log (folder) or a recording (.rrd); `provenance` has `source`.

    Raises:
        LogError, RecordingError: it cannot be read.
    """
    path = Path(path)
    if path.suffix == ".rrd":
        recording = read_recording(path)
        facts = {"source": str(path), **recording.provenance}
        return Recording(recording.streams, facts, recording.repairs)
    if path.is_file() and path.name != "log.toml":
        raise LogError(path, "is neither a log's folder nor an .rrd", "name one of these")
    return read_log(path)


def platform_of(recording: Recording) -> Platform:
    """The platform that a recording names.

    Raises:
        UsageError: it names none.
        UnknownName: it names one that is not there.
    """
    name = recording.provenance.get("platform")
    if not isinstance(name, str):
        raise UsageError(f"{recording.provenance.get('source', 'the log')} names no platform")
    return load_platform(name)
