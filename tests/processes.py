"""Processes that tests start, each of which ends and hears signals, and waits that end."""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from tests.signals import hear

PATIENCE = 100.0
"""For what takes seconds on a free computer [s]; shorter than the time limit of a test."""


@contextmanager
def running(
    command: Sequence[Any], limit: float = PATIENCE, **options: Any
) -> Iterator["subprocess.Popen[Any]"]:
    """A process in a session of its own, killed with its children when the block or time [s] ends.

    It hears signals, wherever the tests were started.

    So each read of its output and each wait for it ends: at the limit a read finds the end of the
    file, and the return code is that of a kill.
    """
    options = {"start_new_session": True, "preexec_fn": hear} | options
    with subprocess.Popen(command, **options) as process:
        watchdog = threading.Timer(limit, _kill, [process])
        watchdog.daemon = True
        watchdog.start()
        try:
            yield process
        finally:
            watchdog.cancel()
            _kill(process)


def wait_until(so: Callable[[], object], seconds: float = PATIENCE, what: str = "") -> None:
    """Look again and again until something is so.

    Raises:
        AssertionError: it is not so after that time [s].
    """
    end = time.monotonic() + seconds
    while not so():
        assert time.monotonic() < end, f"not within {seconds} s: {what or so}"
        time.sleep(0.01)


def _kill(process: "subprocess.Popen[Any]") -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
