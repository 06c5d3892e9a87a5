"""Whether a log's streams have the columns that a machine's have."""

from collections.abc import Iterable

from twin.errors import UsageError
from twin.platform import Platform
from twin.recording.recording import Recording


def check_columns(recording: Recording, platform: Platform, streams: Iterable[str]) -> None:
    """Refuse streams of another number of columns: one axis of a gyro, wheels of another machine.

    Args:
        recording: a log.
        platform: the machine that it should be of.
        streams: those that are to be used; what the log lacks is not looked at.

    Raises:
        UsageError: naming the stream, its columns and the machine's.
    """
    for name in streams:
        if name not in recording:
            continue
        has, expected = recording[name].columns, platform.columns(name)
        if len(has) != len(expected):
            raise UsageError(
                f"the log's {name} has {len(has)} columns ({', '.join(has)}), that of "
                f"{platform.name} {len(expected)} ({', '.join(expected) or 'no such part'}): name "
                "the log's own machine, or leave this stream out of log.toml"
            )
