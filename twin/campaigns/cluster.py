"""Shards flown by the workers of a Dask scheduler, wherever they are; the extra `cluster`.

A worker is sent the campaign and the number of a shard, and sends back its rows: it needs no
folder, and this process alone writes. A shard whose worker dies is given to another one by the
scheduler.
"""

import logging
import re
import socket
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from importlib import import_module
from queue import SimpleQueue
from typing import TYPE_CHECKING, cast
from uuid import uuid4

from twin.campaigns.folder import Folder
from twin.campaigns.guest import Refused, Sent
from twin.campaigns.parcel import packed
from twin.campaigns.rows import write_rows
from twin.campaigns.spec import Spec
from twin.campaigns.worker import Done
from twin.errors import TwinError, UsageError
from twin.stop import sleep, until

if TYPE_CHECKING:
    from distributed import Client, Future

PATIENCE = 10.0
"""For an answer of the scheduler [s]."""
AHEAD = 2
"""Shards asked for of each worker: one that it flies and one that it then finds. No more travel or
wait in this process, however many there are."""
LOOK = 5.0
"""Between looks at whether there are workers at all [s]."""

_ADDRESS = re.compile(r"(tcp|tls)://([^\s:/\[\]]+|\[[0-9a-fA-F:.]+\]):([0-9]{1,5})")


class ClusterError(TwinError):
    """A cluster that is not there, goes away, or cannot fly a campaign."""


class Cluster:
    """A scheduler that answers, with the workers that it has now and those that come later."""

    def __init__(self, address: str, client: "Client") -> None:
        """See `connected`."""
        self.address = address
        self.arithmetics: set[str] = set()
        """Marks of those who flew; see `twin.campaigns.arithmetic`."""
        self._client = client

    def fly(
        self, spec: Spec, folder: Folder, shards: Sequence[int], say: Callable[[str], None]
    ) -> Iterator[Done]:
        """Shards as they are done and written.

        Args:
            spec: the campaign.
            folder: of its results.
            shards: those to fly.
            say: is told that nobody is there to fly.

        Raises:
            ClusterError: the scheduler went away, a shard killed its workers, or a worker cannot
                fly the campaign.
        """
        campaign, task = packed(spec), _task()
        name = f"campaign-{uuid4().hex[:8]}"
        self._refuse_threads()
        waiting = list(reversed(shards))
        asked: dict[str, tuple[int, Future[Sent | Refused]]] = {}
        came: SimpleQueue[Future[Sent | Refused]] = SimpleQueue()
        try:
            while waiting or asked:
                with self._there():
                    workers = len(self._threads())
                    while waiting and len(asked) < max(AHEAD * workers, 1):
                        shard = waiting.pop()
                        key = f"{name}-shard-{shard}"
                        future = self._client.submit(task, campaign, shard, key=key, pure=False)
                        asked[key] = shard, future
                        future.add_done_callback(came.put)
                if not until(lambda: not came.empty(), LOOK):
                    if not workers:
                        say(f"no worker is connected to {self.address}; waiting for one")
                    continue
                future = came.get()
                key = str(future.key)
                shard, _ = asked[key]
                sent = self._result(spec, shard, future)
                del asked[key]
                self.arithmetics.add(sent.arithmetic)
                write_rows(sent.rows, folder.shard(shard))
                yield sent.done
        finally:
            self._client.cancel([future for _, future in asked.values()], force=True)

    def _result(self, spec: Spec, shard: int, future: "Future[Sent | Refused]") -> Sent:
        from distributed import KilledWorker

        try:
            with self._there():
                got: Sent | Refused = future.result()
        except KilledWorker as lost:
            runs = spec.runs_of(shard)
            deaths = lost.allowed_failures + 1
            raise ClusterError(
                f"shard {shard} (runs {runs[0]} to {runs[-1]}) lost its worker {deaths} "
                f"time{'s' if deaths > 1 else ''}: has it memory enough, or does its queue's time "
                "end? --resume goes on"
            ) from None
        except ImportError as problem:
            raise ClusterError(
                f"a worker of {self.address} cannot import {problem.name}; install "
                "the extra `cluster` where the workers run"
            ) from None
        if isinstance(got, Refused):
            raise ClusterError(f"a worker on {got.host} cannot fly the campaign: {got.sentence}")
        return got

    def _threads(self) -> dict[str, int]:
        """Of each worker, by address."""
        return cast(dict[str, int], self._client.nthreads())

    def _refuse_threads(self) -> None:
        with self._there():
            threads = self._threads()
        for worker, count in threads.items():
            if count > 1:
                raise ClusterError(
                    f"worker {worker} has {count} threads, which fly no faster than one; start "
                    f"{count} processes in its place: dask worker {self.address} --nthreads 1 "
                    f"--nworkers {count}"
                )

    @contextmanager
    def _there(self) -> Generator[None]:
        """What is raised where the scheduler is not there any more, as a sentence."""
        try:
            yield
        except (CancelledError, OSError) as problem:
            raise ClusterError(
                f"the scheduler at {self.address} went away ({_words(problem)}); what was flown is "
                "written: start it again, and --resume goes on"
            ) from None


@contextmanager
def connected(address: str) -> Generator[Cluster]:
    """The cluster of a Dask scheduler.

    Args:
        address: `tcp://HOST:PORT`.

    Raises:
        UsageError: that is no such address, or Dask is not installed.
        ClusterError: no scheduler answers there.
    """
    found = _ADDRESS.fullmatch(address)
    if found is None or int(found[3]) > 65535:
        raise UsageError(
            f"cluster is {address!r}; give the address of a Dask scheduler: tcp://HOST:PORT"
        )
    try:
        from distributed import Client
    except ImportError:
        raise UsageError(
            "a cluster needs Dask, which is not installed: pip install '.[cluster]'"
        ) from None
    # it tells connections that come and go line by line; what matters of them is told here
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        _listen(found[2].strip("[]"), int(found[3]), greets=found[1] == "tcp")
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as problem:
        raise ClusterError(
            f"no Dask scheduler answers at {address} ({_words(problem)}); is it up (dask "
            "scheduler), and is its port open?"
        ) from None
    with client:
        yield Cluster(address, client)


def _task() -> Callable[[bytes, int], Sent | Refused]:
    """A function that travels as its code, for it has no name that could be imported: a scheduler
    then needs nothing of ours, and a worker without it says so where it would die of a name."""
    return lambda campaign, shard: import_module("twin.campaigns.guest").fly_sent(campaign, shard)


def _listen(host: str, port: int, *, greets: bool) -> None:
    """Wait for who is there; Dask's client would wait for ever where it is no scheduler.

    Args:
        host: its name or number.
        port: of TCP.
        greets: whether a scheduler speaks first there; over TLS it does not.

    Raises:
        OSError: nobody, or somebody else.
    """
    latest = time.monotonic() + PATIENCE
    while True:
        try:
            with socket.create_connection((host, port), timeout=PATIENCE) as line:
                if greets and not line.recv(1):
                    raise ConnectionError("who is there hangs up")
            return
        except ConnectionRefusedError:  # it may be on its way up
            if time.monotonic() > latest:
                raise
            sleep(0.2)
        except TimeoutError:
            raise TimeoutError(f"nothing is heard within {PATIENCE:g} s") from None


def _words(problem: BaseException) -> str:
    told = problem.strerror if isinstance(problem, OSError) else None
    return " ".join((told or str(problem)).split()) or type(problem).__name__
