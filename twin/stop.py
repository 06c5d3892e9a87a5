"""One way to end: SIGINT, SIGTERM and SIGHUP set a request, and every loop polls it.

A signal never raises an exception where it happens to arrive: a library may hold a lock there, or a
file may be half written. The handler notes the request. Loops call `check` where their work may be
left, which raises `Stopped`; the control loop ends after the tick in hand instead.

The command line's process (`listen`) that has not ended `GRACE` seconds after the request, or that
is asked a second time, is ended at once by a thread that waits for this: partial files are removed,
child processes killed, and the exit status is that of an orderly end. Called from Python
(`listening`), a second Ctrl-C raises KeyboardInterrupt as usual. A signal that was ignored when the
process started (`nohup`, a background job of a script) stays ignored.
"""

import contextlib
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from socket import socket

GRACE = 4.0
"""Longest time between a request and the end of the process [s]."""

SHIELDED = 10.0
"""Longest time that a forced end waits for a machine's safe state [s]."""

_OVER = 0
"""In place of a signal's number: nothing is left to do."""

LOOK = 0.1
"""Longest time between two polls of a wait [s]."""

_NAMES = {"SIGINT": "Ctrl-C", "SIGTERM": "SIGTERM", "SIGHUP": "SIGHUP"}

SIGNALS = tuple(getattr(signal, name) for name in _NAMES if hasattr(signal, name))
"""Requests to stop; Windows has no SIGHUP."""


class Stopped(KeyboardInterrupt):
    """Raised by `check` after a request to stop; its text names the signal."""

    run: Any = None
    """What there is of a flight that had not begun (`twin.flight.Run`)."""

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by {name_of(number)}")
        self.number = number

    @property
    def status(self) -> int:
        """Exit status of the process, as shells count signals."""
        return 128 + self.number


class _State:
    """Of this process; signals belong to the process, so there is one."""

    listens = False
    request: int | None = None
    pipe: "socket | None" = None
    """Takes each request's number, for the thread that enforces the end."""
    shields = 0
    kept: Callable[[], str] | None = None
    last: list[Callable[[], None]]


_state = _State()
_state.last = []


def name_of(number: int) -> str:
    """What a person calls that signal."""
    name = signal.Signals(number).name
    return _NAMES.get(name, name)


def requested() -> int | None:
    """Number of the signal that asked this process to stop; None: nobody has."""
    return _state.request


def check() -> None:
    """Raise where work may be left.

    Raises:
        Stopped: a stop was requested.
    """
    if _state.request is not None:
        raise Stopped(_state.request)


def request(number: int = signal.SIGINT) -> None:
    """Ask this process to stop, as the signal of that number does; nothing is raised."""
    if _state.request is None:
        _state.request = number
    if _state.pipe is not None:
        with contextlib.suppress(OSError):
            _state.pipe.send(bytes([number]))


def sleep(seconds: float) -> None:
    """Wait [s].

    Raises:
        Stopped: a stop was requested meanwhile.
    """
    until(lambda: False, seconds)


def until(ready: Callable[[], object], seconds: float = float("inf")) -> bool:
    """Whether `ready` becomes true within a time [s]; it is asked ten times a second.

    A `ready` that itself waits up to 0.1 s may do so.

    Raises:
        Stopped: a stop was requested meanwhile.
    """
    end = time.monotonic() + seconds
    while True:
        check()
        started = time.monotonic()
        if ready():
            return True
        now = time.monotonic()
        if now >= end:
            return False
        time.sleep(max(min(started + LOOK, end) - now, 0.0))


def keeps(words: Callable[[], str]) -> None:
    """Say, in a sentence, what an interrupted verb has kept and how to go on."""
    _state.kept = words


def kept() -> str:
    """That sentence; empty where nobody has said it."""
    return "" if _state.kept is None else _state.kept()


@contextmanager
def at_last(action: Callable[[], None]) -> Generator[None, None, None]:
    """A process that is ended at once while this block lasts does `action` before it."""
    _state.last.append(action)
    try:
        yield
    finally:
        _state.last.remove(action)


@contextmanager
def shield() -> Generator[None, None, None]:
    """A forced end waits, at most `SHIELDED`, for the end of this block.

    For a machine on its bench, which is to be left in its safe state.
    """
    _state.shields += 1
    try:
        yield
    finally:
        _state.shields -= 1


@contextmanager
def blocked() -> Generator[None, None, None]:
    """A process started in this block does not see the signals before it decides what they do."""
    if sys.platform == "win32":
        yield
        return
    from multiprocessing import resource_tracker

    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    # the first process of its kind starts this one too, which lifts the mask
    resource_tracker.ensure_running()
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore() -> None:
    """Ignore the signals in a process whose parent hears them and ends it."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)


def listen() -> None:
    """Take requests from now on until this process ends, and enforce them.

    For the main thread of a program of ours; it also bounds the interpreter's own end.
    """
    from socket import socketpair

    # unlike a pipe's, its ends can be polled on Windows too
    reader, _state.pipe = socketpair()
    threading.Thread(target=_enforce, args=(reader,), name="stop", daemon=True).start()
    _install()


def over(status: int) -> None:
    """The work is done: a signal no longer changes the status, with which the process ends soon."""
    for number in SIGNALS:
        # a handler of ours would give way to the default before the interpreter ends
        signal.signal(number, signal.SIG_IGN)
    if _state.pipe is not None:
        with contextlib.suppress(OSError):
            _state.pipe.send(bytes([_OVER, status]))


@contextmanager
def listening() -> Generator[None, None, None]:
    """Take requests in this block; within another such block, or in a thread, it does nothing."""
    if _state.listens or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = _install()
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _state.listens, _state.request, _state.kept = False, None, None


def _install() -> "dict[int, Any]":
    """Install the handlers; those before, by signal."""
    _state.listens, _state.request, _state.kept = True, None, None
    before: dict[int, Any] = {}
    for number in SIGNALS:
        handler = signal.getsignal(number)
        # None: a handler that was not installed from Python, which cannot be put back
        if handler not in (signal.SIG_IGN, None):
            before[number] = handler
            signal.signal(number, _note)
    return before


def _note(number: int, frame: FrameType | None) -> None:
    """The handler. It takes no lock; only a second signal to a caller's own process raises."""
    del frame
    if _state.pipe is None and _state.request is not None:
        raise Stopped(number)
    request(number)


def _enforce(reader: "socket") -> None:
    """Wait for a request, then for a second one or the end of the grace."""
    with reader as requests:
        first = requests.recv(1)[0]
        if first != _OVER and (not _second_request(requests) or requests.recv(1)[0] != _OVER):
            _end_at_once(first)
        status = requests.recv(1)[0]
    time.sleep(GRACE)
    os._exit(status)


def _second_request(requests: "socket") -> bool:
    """Whether something comes before the grace is over, which begins anew after a shield."""
    started = time.monotonic()
    end = started + GRACE
    while (left := end - time.monotonic()) > 0.0:
        if select.select([requests], [], [], min(left, LOOK))[0]:
            return True
        if _state.shields:
            end = min(time.monotonic() + GRACE, started + SHIELDED)
    return False


def _end_at_once(number: int) -> NoReturn:
    end = time.monotonic() + SHIELDED
    while _state.shields and time.monotonic() < end:
        time.sleep(0.02)
    for action in reversed(_state.last):
        with contextlib.suppress(Exception):
            action()
    words = f"twin: stopped at once by {name_of(number)}"
    with contextlib.suppress(Exception):
        words += f"; {kept()}" if _state.kept else ""
    with contextlib.suppress(OSError):
        os.write(2, f"{words}\n".encode())
    os._exit(128 + number)
