"""The process that writes a recording: `python -m twin.stream.child`, fed by `RecordingWriter`.

A thread empties the pipe from the first moment on, so that the loop's rows are safe here while
Rerun is still being imported. When the pipe closes, be it that the loop is done or that it was
killed, what has come is written and the file is closed.
"""

import argparse
import os
import pickle
import queue
import struct
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from twin.recording.lock import mark_finishing

if TYPE_CHECKING:
    from collections.abc import Callable

    from twin.stream.runfile import RunFile

DRAWING_PERIOD = 0.25
"""Between updates of plots and scene [s of the wall]."""

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
        from twin.stream.runfile import RunFile

        _write(lambda: RunFile(arguments.file, viewer=arguments.viewer), frames)
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


def _write(open_file: "Callable[[], RunFile]", frames: Frames) -> None:
    """Write what has come, all of it at once: a writer that lags catches up in larger groups.

    The streams are safe in the file first; what is drawn from them follows a few times a second.
    """
    from twin.stream.rows import Block

    file: RunFile | None = None
    closed = ended = False
    drawn = time.monotonic()
    while not ended:
        blocks: dict[str, list[Block]] = {}
        payloads = [frames.get()]
        while not frames.empty():
            payloads.append(frames.get())
        for payload in payloads:
            kind, *content = ("ended",) if payload is None else pickle.loads(payload)
            if kind == "start":
                file = open_file()
                file.start(*content)
            elif kind == "declare" and file is not None:
                file.declare(*content)
            elif kind == "rows":
                for stream, block in content[0].items():
                    blocks.setdefault(stream, []).append(Block(*block))
            else:
                closed |= kind == "close"
                ended |= kind == "ended"
        if file is None:
            continue
        file.write_blocks(blocks)
        if time.monotonic() - drawn >= DRAWING_PERIOD:
            drawn = time.monotonic()
            file.draw()
    if file is None:
        return
    if not closed:
        file.ending("the process that recorded ended without closing the recording")
    file.close()


if __name__ == "__main__":
    sys.exit(main())
