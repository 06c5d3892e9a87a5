"""The machine that a log was made on."""

from twin.errors import UsageError
from twin.platform.load import load_platform
from twin.platform.parts import Platform
from twin.recording import Recording


def platform_of(recording: Recording) -> Platform:
    """The platform that a recording names.

    Raises:
        UsageError: it names none.
        UnknownName: it names one that is not there.
        PlatformError: its platform.toml is wrong.
    """
    name = recording.provenance.get("platform")
    if not isinstance(name, str):
        raise UsageError(f"{recording.provenance.get('source', 'the log')} names no platform")
    return load_platform(name)
