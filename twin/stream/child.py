"""The process that writes a recording: `python -m twin.stream.child`, fed by `RecordingWriter`.

A thread empties the pipe from the first moment on, so that the loop never waits for the disk. When
the pipe closes, be it that the loop is done or that it was
killed, what has come is written and the file is closed.
"""

import argparse
import os
import queue
import struct
import sys
import threading
from pathlib import Path
from typing import BinaryIO

from twin.recording.read import mark_finishing

NICENESS = 10
"""Waking this process must not preempt the loop that has just written to it."""

_LENGTH = struct.Struct("<Q")

Frames = queue.SimpleQueue[bytes | None]


def main() -> int:
    """Write until the pipe closes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--file", type=Path)
    parser.add_argument("--lock", type=int)
    parser.add_argument("--viewer", action="store_true")
    arguments = parser.parse_args()
    if hasattr(os, "nice"):
        os.nice(NICENESS)
    frames: Frames = queue.SimpleQueue()
    reader = threading.Thread(target=_read, args=(sys.stdin.buffer, frames, arguments.lock))
    reader.start()
    try:
        # takes a second to import
        from twin.stream.outputs import write

        write(arguments.file, arguments.viewer, frames)
    except Exception as problem:
        print(f"{type(problem).__name__}: {problem}", file=sys.stderr, flush=True)
        # The reader may hang on a pipe that is still open; the loop learns of it by our end.
        os._exit(1)
    return 0


def _read(pipe: BinaryIO, frames: Frames, lock: int | None) -> None:
    """Empty the pipe; a frame that was not sent whole is none."""
    while True:
        head = pipe.read(_LENGTH.size)
        if len(head) < _LENGTH.size:
            break
        (length,) = _LENGTH.unpack(head)
        payload = pipe.read(length)
        if len(payload) < length:
            break
        frames.put(payload)
    if lock is not None:
        mark_finishing(lock)
    frames.put(None)


if __name__ == "__main__":
    sys.exit(main())
