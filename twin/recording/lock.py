"""Who writes a recording, so that a reader who comes while it is being finished waits for it.

While a run goes on its writer holds a shared lock on the file; once the run has ended, by whatever
end, an exclusive one until the file is complete. Where the system has no such locks (Windows) every
file counts as finished.
"""

import sys
import time
from pathlib import Path
from typing import IO

if sys.platform != "win32":
    import fcntl

FINISHING_TIMEOUT = 20.0
"""[s] a reader waits for a file that is being finished."""

_GRACE = 0.5
"""[s] in which a writer notices that the run has ended."""


def mark_running(file: IO[bytes]) -> bool:
    """Hold the shared lock for as long as `file`, or a copy of it in a child process, is open.

    False: somebody else is writing that file.
    """
    if sys.platform != "win32":
        if not _lockable(file, fcntl.LOCK_EX):
            return False
        fcntl.flock(file, fcntl.LOCK_SH)
    return True


def mark_finishing(descriptor: int) -> None:
    """Exchange the shared lock for the exclusive one."""
    if sys.platform != "win32":
        fcntl.flock(descriptor, fcntl.LOCK_EX)


def wait_until_finished(path: Path) -> bool:
    """Wait for a writer that is finishing `path`; False when the recording still goes on."""
    if sys.platform == "win32":
        return True
    started = time.monotonic()
    with path.open("rb") as file:
        while not _lockable(file, fcntl.LOCK_EX):
            waited = time.monotonic() - started
            if waited > FINISHING_TIMEOUT:
                return False
            if waited > _GRACE and _lockable(file, fcntl.LOCK_SH):
                return False
            time.sleep(0.01)
    return True


def _lockable(file: IO[bytes], kind: int) -> bool:
    try:
        fcntl.flock(file, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    fcntl.flock(file, fcntl.LOCK_UN)
    return True
