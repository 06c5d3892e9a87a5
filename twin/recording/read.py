"""An `.rrd` of ours -> `Recording`, to the last bit; its names, and the lock of its writer.

Who writes a recording, so that a reader who comes while it is being finished waits for it.

While a run goes on its writer holds a shared lock on the file; once the run has ended, by whatever
end, an exclusive one until the file is complete. Where the system has no such locks (Windows) every
file counts as finished.
"""

import os
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO

from twin.errors import RecordingError
from twin.processes import Pool, first_completed, run
from twin.recording.recording import Recording
from twin.recording.rrd_reader import NOTHING, Refusal, read_parts

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


_MAGIC = b"RRF"
_CLOSED = b"RRF2FOOT"
_UNFINISHED = "was cut short, or never closed"
_GOING_ON = "is still being written"


def read_recording(path: str | Path) -> Recording:
    """Read a recording; of a file that holds several, the one that begins as what follows a #:
    `two.rrd#4180`; of one with several machines, the machine of that name: `two.rrd#whorl1`.

    Rows come in the order of their times, those of one time as they were written.
    A file that was never closed, or was cut anywhere, is read as far as it is whole, and `repairs`
    says so; the file itself stays as it is. Rerun's reader runs in a process of its own, for some
    damaged files end the process that reads them.

    Raises:
        RecordingError: no such file, not a recording of ours, of a newer schema, nothing in it, or
            several recordings or machines, of which none is chosen.
    """
    path, chosen = which(Path(path))
    if not path.is_file():
        raise RecordingError(path, "there is no such recording", "check the path")
    ended = wait_until_finished(path)
    head, tail = _ends(path)
    if head and not head.startswith(_MAGIC):
        raise RecordingError(path, "is no Rerun recording", "name an .rrd, or a folder log")
    found = _read_in_process(path, path.name, chosen) if _CLOSED in tail else None
    if found is None:
        how = "is damaged; what could be decoded" if _CLOSED in tail else ""
        how = how or f"{_UNFINISHED if ended else _GOING_ON}; what is whole"
        found = _read_mended(path, chosen, f"{path.name} {how} is here")
    if isinstance(found, Recording):
        return found
    refused = RecordingError(path, found.problem, found.remedy)
    refused.machines = found.machines
    raise refused


def which(path: Path) -> tuple[Path, str]:
    """The file, and the beginning of the recording's name in it; empty where none is given."""
    name, mark, chosen = path.name.rpartition("#")
    return (path, "") if not mark or path.exists() else (path.with_name(name), chosen)


def _ends(path: Path) -> tuple[bytes, bytes]:
    with path.open("rb") as file:
        head = file.read(4)
        size = file.seek(0, 2)
        file.seek(max(size - 64, 0))
        return head, file.read()


def _read_mended(path: Path, chosen: str, note: str) -> Recording | Refusal:
    """Read what Rerun's own repair makes of a copy."""
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "mended.rrd"
        command = [sys.executable, "-m", "rerun_cli", "rrd", "merge", "--continue-on-error"]
        command += [str(path), "-o", str(copy)]
        quiet = subprocess.DEVNULL
        if run(command, stdout=quiet, stderr=quiet) != 0 or not copy.exists():
            return Refusal(
                "is damaged beyond what `rerun rrd merge` can mend",
                "copy it again from where it was written",
            )
        # Rerun raises for a file without a single recording, or without a column, in it
        mended = _read_in_process(copy, path.name, chosen, note)
        # a recording that was cut before its first rows is empty, and one all the same
        return NOTHING if mended is None else mended


def _read_in_process(
    path: Path, name: str, chosen: str, note: str = ""
) -> Recording | Refusal | None:
    """What `twin.recording.rrd_reader` finds in a file; None where it cannot be decoded."""
    try:
        reading = _reader().submit(read_parts, path, name, chosen, note)
        first_completed([reading])
        return reading.result()
    except BrokenProcessPool:
        _reader().end()
        _reader.cache_clear()
        return None


@cache
def _reader() -> Pool:
    """The process that reads; what Rerun says of damage is for its developers."""
    return Pool(1, _say_nothing)


def _say_nothing() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
