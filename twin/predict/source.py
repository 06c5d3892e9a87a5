"""A log by its path, and the platform it was made on."""

from dataclasses import replace
from pathlib import Path

from twin.errors import UsageError
from twin.platform import Platform, load_platform
from twin.recording.open import open_log as open_any
from twin.recording.recording import Recording


def open_log(path: str | Path) -> Recording:
    """Read a measured log (folder) or a recording (.rrd); `provenance` has its `source`.

    Raises:
        LogError, RecordingError: it cannot be read.
    """
    recording = open_any(path)
    return replace(recording, provenance={"source": str(path), **recording.provenance})


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
