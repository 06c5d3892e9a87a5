"""Messages of a `RecordingWriter` -> a file, a viewer, or both."""

import pickle
import queue
import sys
import time
from collections.abc import Callable
from pathlib import Path

from twin.errors import RecordingError
from twin.stream.rows import Block
from twin.stream.runfile import RunFile

DRAWING_PERIOD = 0.25
"""Between updates of plots and scene [s of the wall]."""

READY = "r"
"""What the loop waits for on this process's output before its first tick."""


def write(path: Path | None, viewer: bool, frames: queue.SimpleQueue[bytes | None]) -> None:
    """Write what comes until None does, message by message: in the order of time.

    The streams are safe in the file first; what is drawn from them follows a few times a second.
    """
    outputs: list[RunFile] = []
    closed = ended = False
    drawn = time.monotonic()
    while not ended:
        payload = frames.get()
        kind, *content = ("ended",) if payload is None else pickle.loads(payload)
        if kind == "start":
            outputs = _opened(path, viewer)
            _each(outputs, lambda output, content=content: output.start(*content))
            _each(outputs, lambda output: output.flush())
            print(READY, end="", flush=True)
        elif kind == "declare":
            _each(outputs, lambda output, content=content: output.declare(*content))
        elif kind == "rows":
            blocks = {stream: Block(*block) for stream, block in content[0].items()}
            rows = blocks, content[1]
            _each(outputs, lambda output, rows=rows: output.write_blocks(*rows))
        elif kind == "said":
            _each(outputs, lambda output, content=content: output.say(*content))
        else:
            closed |= kind == "close"
            ended |= kind == "ended"
        if time.monotonic() - drawn >= DRAWING_PERIOD:
            drawn = time.monotonic()
            _each(outputs, lambda output: output.draw())
    ending = "" if closed else "the process that recorded ended without closing the recording"
    _each(outputs, lambda output: output.close(ending))


def _opened(path: Path | None, viewer: bool) -> list[RunFile]:
    """The file and the viewer, as far as each is asked for; a run does without a viewer."""
    outputs = [] if path is None else [RunFile(path)]
    if viewer:
        try:
            outputs.append(RunFile(None))
        except RecordingError as problem:
            print(problem, file=sys.stderr, flush=True)
    return outputs


def _each(outputs: list[RunFile], action: Callable[[RunFile], None]) -> None:
    """Do it with every output; a viewer that has gone is left out from then on, a file never."""
    for output in list(outputs):
        try:
            action(output)
        except RuntimeError as problem:
            if output.path is not None:
                raise
            outputs.remove(output)
            print(f"the Rerun viewer has gone: {problem}", file=sys.stderr, flush=True)
