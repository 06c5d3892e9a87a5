"""Worker processes that end with their parent, and programs that end when this one is to stop."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait as wait_for
from multiprocessing.process import BaseProcess
from typing import Any, ParamSpec, Self, TypeVar

from twin import stop

ENDS = 1.0
"""A process that has not ended this long after it was asked to is killed [s]."""

_P = ParamSpec("_P")
_T = TypeVar("_T")


class Pool:
    """Processes that do what is submitted; leaving the block ends them, whatever they do."""

    def __init__(
        self,
        workers: int,
        initializer: Callable[..., None] | None = None,
        initargs: tuple[object, ...] = (),
    ) -> None:
        """Processes start as work is submitted.

        Args:
            workers: how many at most.
            initializer: called once in each with `initargs`.
            initargs: as they travel by pickle.
        """
        with beginning():  # its queues' locks start a process too
            self._pool = ProcessPoolExecutor(
                workers,
                mp_context=get_context("spawn"),
                initializer=_begin,
                initargs=(initializer, initargs),
            )
        self._forced = ExitStack()
        self._forced.enter_context(stop.at_last(self._kill))

    def submit(self, work: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Have a worker do it.

        Raises:
            BrokenProcessPool: one of them has died.
        """
        # work of the caller's script needs that script, which then asks whether it is `__main__`
        with stop.blocked() if work.__module__ == "__main__" else beginning():
            return self._pool.submit(work, *args, **kwargs)

    def end(self) -> None:
        """End the workers; those that still work `ENDS` seconds later are killed."""
        workers = self._workers()
        self._pool.shutdown(wait=False, cancel_futures=True)
        if not _gone(workers):
            for worker in workers:
                with contextlib.suppress(ValueError):  # the pool has closed it
                    worker.kill()
            _gone(workers)
        self._forced.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.end()

    def _workers(self) -> list[BaseProcess]:
        # before Python 3.14 a pool neither names nor kills its processes
        return list((getattr(self._pool, "_processes", None) or {}).values())

    def _kill(self) -> None:
        for worker in self._workers():
            worker.kill()


@contextlib.contextmanager
def beginning() -> Generator[None]:
    """Processes that are started within hear no signal before they say so, and do not run the
    caller's script again: it may do its work without asking whether it is `__main__`.

    What such a process is sent may therefore be of no class of that script.
    """
    main = sys.modules["__main__"]
    script = getattr(main, "__spec__", None) is None and hasattr(main, "__file__")
    file = main.__dict__.pop("__file__") if script else None
    try:
        with stop.blocked():
            yield
    finally:
        if script:
            main.__dict__["__file__"] = file


def first_completed(futures: Iterable[Future[_T]]) -> set[Future[_T]]:
    """Those of some futures that are complete, as soon as one is.

    Raises:
        Stopped: a stop was requested meanwhile.
    """
    asked = list(futures)
    ended: set[Future[_T]] = set()

    def ready() -> bool:
        ended.update(wait(asked, timeout=stop.LOOK, return_when=FIRST_COMPLETED).done)
        return bool(ended)

    stop.until(ready)
    return ended


def end_with_parent() -> None:
    """Of a worker: ignore requests to stop, which its parent hears, and end when that has ended."""
    stop.ignore()
    parent = parent_process()
    if parent is not None:
        watch = threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True)
        watch.start()


def run(command: Sequence[str], **options: Any) -> int:
    """Exit code of another program; when this process is to stop, it ends with all it has started.

    Args:
        command: the program and its arguments.
        options: of `subprocess.Popen`.

    Raises:
        Stopped: a stop was requested meanwhile; the program has ended.
    """
    process = subprocess.Popen(command, start_new_session=True, **options)
    try:
        with stop.at_last(lambda: _signal(process, "SIGKILL")):
            stop.until(lambda: process.poll() is not None)
            return process.returncode
    finally:
        for name in ("SIGTERM", "SIGKILL"):
            if process.poll() is None:
                _signal(process, name)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(ENDS)


def _signal(process: "subprocess.Popen[Any]", name: str) -> None:
    """To the program and all that it has started."""
    if sys.platform == "win32":
        process.kill()
        return
    with contextlib.suppress(OSError):
        os.killpg(process.pid, getattr(signal, name))


def _gone(workers: Sequence[BaseProcess]) -> bool:
    """Whether all end within `ENDS`."""
    end = time.monotonic() + ENDS
    while any(map(_alive, workers)):
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def _alive(worker: BaseProcess) -> bool:
    try:
        return worker.is_alive()
    except ValueError:  # the pool has closed it
        return False


def _begin(initializer: Callable[..., None] | None, initargs: tuple[object, ...]) -> None:
    """In a worker."""
    end_with_parent()
    if initializer is not None:
        initializer(*initargs)


def _end_with(sentinel: int) -> None:
    wait_for([sentinel])
    os._exit(1)
