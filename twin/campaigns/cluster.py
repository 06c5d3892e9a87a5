"""Shards flown by the workers of a Dask scheduler, wherever they are; the extra `cluster`.

A campaign in one piece: what a machine without its files needs to fly any of its shards.
The specification as it was read, with the files of its machines and of its laws, and what else its
bits depend on, so that a machine with another version of it can be told.

What a worker of a cluster does: fly a shard of a campaign that was sent, and send back its rows.
The worker may be any machine with this package; nothing of the campaign is written there.

A worker is sent the campaign and the number of a shard, and sends back its rows: it needs no
folder, and this process alone writes. A shard whose worker dies is given to another one by the
scheduler.
"""

import hashlib
import logging
import pickle
import re
import socket
import time
import zlib
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from threading import Lock
from typing import TYPE_CHECKING, cast
from uuid import uuid4

import pyarrow as pa

import twin
from twin.campaigns.folder import Folder, arithmetic, hash_of, versions
from twin.campaigns.results import write_rows
from twin.campaigns.spec import Arm, Spec
from twin.campaigns.worker import Done, rows_of_shard
from twin.effects import file_of
from twin.errors import CampaignError, TwinError, UsageError
from twin.library import find_controller
from twin.platform import Platform, files_of
from twin.stop import sleep, until

if TYPE_CHECKING:
    from distributed import Client, Future


LARGEST = 1 << 25
"""Bytes of all files: they travel with each shard."""

_SHIPPED = ("models", "controllers")
"""In an installed package; in a checkout they are next to it, and a campaign sends its own."""


class OtherVersions(TwinError):
    """A machine on which the same runs might not come to the same bits."""


def packed(spec: Spec) -> bytes:
    """The campaign, to be sent.

    Raises:
        CampaignError: its machines' files are more than can travel.
    """
    files: dict[str, bytes] = {}
    arms = [_packed_arm(spec, arm, files) for arm in spec.arms]
    total = sum(map(len, files.values()))
    if total > LARGEST:
        raise CampaignError(
            spec.path,
            f"its machines' files hold {total / 1e6:.0f} MB, which would travel with each shard",
            f"make the meshes and textures that its MJCF names smaller, below "
            f"{LARGEST / 1e6:.0f} MB in all",
        )
    # apart, so that it is opened only where its classes are those that it was made of
    inner = pickle.dumps(replace(spec, arms=tuple(arms)))
    return zlib.compress(pickle.dumps((code_of(), _effects_of(spec), files, inner)))


def unpacked(data: bytes, folder: Path) -> Spec:
    """The campaign, with its files laid out in a folder.

    Raises:
        OtherVersions: this machine's packages are not those that it was packed with, or it lacks
            an effect's file.
    """
    made_by: dict[str, str]
    effects: dict[Path, str]
    files: dict[str, bytes]
    made_by, effects, files, inner = pickle.loads(zlib.decompress(data))
    here = code_of()
    for name, wanted in made_by.items():
        if (result := here.get(name)) != wanted:
            raise OtherVersions(
                f"{name} is {result} there and {wanted} here; install the same, for others come to "
                "other bits"
            )
    for path, wanted in effects.items():
        if not path.is_file() or hash_of(path) != wanted:
            what = "another file there" if path.is_file() else "not there"
            raise OtherVersions(
                f"the effect {path} is {what}; effects of one's own do not travel: put the same "
                "file in the same place"
            )
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    spec: Spec = pickle.loads(inner)
    return replace(spec, arms=tuple(_laid_out(arm, folder) for arm in spec.arms))


def code_of() -> dict[str, str]:
    """What runs depend on besides files: versions of packages, and the hash of our code."""
    root = Path(twin.__file__).parent
    sources = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        name = path.relative_to(root)
        if name.parts[0] not in _SHIPPED:
            sources.update(f"{name.as_posix()}\0".encode() + path.read_bytes() + b"\0")
    return {**versions(), "code of airbearing-twin": sources.hexdigest()[:12]}


def _effects_of(spec: Spec) -> dict[Path, str]:
    """Files of effects that are not part of the package."""
    files = (file_of(effect.kind) for arm in spec.arms for effect in arm.effects)
    return {path: hash_of(path) for path in files if path is not None}


def _packed_arm(spec: Spec, arm: Arm, files: dict[str, bytes]) -> Arm:
    """The arm with paths from where its files are laid out; those are added to `files`."""
    platform = _packed_platform(arm.platform, files)
    known = replace(arm.known, folder=platform.folder, model_path=platform.model_path)
    if spec.procedure == "balance":
        return replace(arm, platform=platform, known=known)
    content = (law := find_controller(arm.controller)).read_bytes()
    name = f"laws/{hashlib.sha256(content).hexdigest()[:12]}/{law.name}"
    files[name] = content
    return replace(arm, platform=platform, known=known, controller=name)


def _packed_platform(platform: Platform, files: dict[str, bytes]) -> Platform:
    mark = hashlib.sha256(str(platform.folder).encode()).hexdigest()[:12]
    place = Path("machines") / mark / platform.folder.name
    for name, path in files_of(platform).items():
        files[(place / name).as_posix()] = path.read_bytes()
    model = place / platform.model_path.relative_to(platform.folder)
    return replace(platform, folder=place, model_path=model)


def _laid_out(arm: Arm, folder: Path) -> Arm:
    def moved(platform: Platform) -> Platform:
        return replace(
            platform, folder=folder / platform.folder, model_path=folder / platform.model_path
        )

    law = folder / arm.controller
    return replace(
        arm,
        platform=moved(arm.platform),
        known=moved(arm.known),
        controller=str(law) if law.is_file() else arm.controller,
    )


_REMEMBERED = 2
"""Campaigns whose files are kept."""

_connecting = Lock()
"""Flights of one process share caches; a worker with threads flies no faster for them."""


@dataclass(frozen=True)
class Sent:
    """A shard that is flown and not yet written."""

    done: Done
    rows: pa.Table
    arithmetic: str
    """The mark of who flew it."""


@dataclass(frozen=True)
class ShardRefused:
    """Why it cannot be flown there, and where that is."""

    host: str
    sentence: str


def fly_sent(campaign: bytes, shard: int) -> Sent | ShardRefused:
    """Fly a shard of a packed campaign."""
    try:
        with _connecting:
            return Sent(*rows_of_shard(_opened(campaign), shard), arithmetic())
    except (TwinError, OSError) as problem:
        return ShardRefused(socket.gethostname(), str(problem))


_campaigns: OrderedDict[bytes, tuple[Spec, TemporaryDirectory[str]]] = OrderedDict()
"""Opened ones by what was sent, the one used last at the end."""


def _opened(campaign: bytes) -> Spec:
    """Once a process; its folder is there as long as the campaign is remembered."""
    if campaign not in _campaigns:
        folder = TemporaryDirectory(prefix="twin-campaign-", ignore_cleanup_errors=True)
        try:
            spec = unpacked(campaign, Path(folder.name))
        except BaseException:
            folder.cleanup()
            raise
        _campaigns[campaign] = spec, folder
    _campaigns.move_to_end(campaign)
    while len(_campaigns) > _REMEMBERED:
        _, (_, oldest) = _campaigns.popitem(last=False)
        oldest.cleanup()
    return _campaigns[campaign][0]


PATIENCE = 10.0
"""For an answer of the scheduler [s]."""
AHEAD = 2
"""Shards asked for of each worker: one that it flies and one that it then finds. No more travel or
wait in this process, however many there are."""
LOOK = 5.0
"""Interval between checks that the cluster has workers [s]."""

_ADDRESS = re.compile(r"(tcp|tls)://([^\s:/\[\]]+|\[[0-9a-fA-F:.]+\]):([0-9]{1,5})")


class ClusterError(TwinError):
    """A cluster that is not there, goes away, or cannot fly a campaign."""


class Cluster:
    """A scheduler that answers, with the workers that it has now and those that come later."""

    def __init__(self, address: str, client: "Client") -> None:
        """See `connected`."""
        self.address = address
        self.arithmetics: set[str] = set()
        """Marks of those who flew; see `twin.campaigns.folder.arithmetic`."""
        self._client = client

    def fly(
        self, spec: Spec, folder: Folder, shards: Sequence[int], say: Callable[[str], None]
    ) -> Iterator[Done]:
        """Shards as they are done and written.

        Args:
            spec: the campaign.
            folder: of its results.
            shards: those to fly.
            say: takes a sentence while the cluster has no worker.

        Raises:
            ClusterError: the scheduler went away, a shard killed its workers, or a worker cannot
                fly the campaign.
        """
        campaign, task = packed(spec), _task()
        name = f"campaign-{uuid4().hex[:8]}"
        self._refuse_threads()
        waiting = list(reversed(shards))
        submitted: dict[str, tuple[int, Future[Sent | ShardRefused]]] = {}
        came: SimpleQueue[Future[Sent | ShardRefused]] = SimpleQueue()
        try:
            while waiting or submitted:
                with self._reachable():
                    workers = len(self._threads())
                    while waiting and len(submitted) < max(AHEAD * workers, 1):
                        shard = waiting.pop()
                        key = f"{name}-shard-{shard}"
                        future = self._client.submit(task, campaign, shard, key=key, pure=False)
                        submitted[key] = shard, future
                        future.add_done_callback(came.put)
                if not until(lambda: not came.empty(), LOOK):
                    if not workers:
                        say(f"no worker is connected to {self.address}; waiting for one")
                    continue
                future = came.get()
                key = str(future.key)
                shard, _ = submitted[key]
                sent = self._result(spec, shard, future)
                del submitted[key]
                self.arithmetics.add(sent.arithmetic)
                write_rows(sent.rows, folder.shard(shard))
                yield sent.done
        finally:
            self._client.cancel([future for _, future in submitted.values()], force=True)

    def _result(self, spec: Spec, shard: int, future: "Future[Sent | ShardRefused]") -> Sent:
        from distributed import KilledWorker

        try:
            with self._reachable():
                got: Sent | ShardRefused = future.result()
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
        if isinstance(got, ShardRefused):
            raise ClusterError(f"a worker on {got.host} cannot fly the campaign: {got.sentence}")
        return got

    def _threads(self) -> dict[str, int]:
        """Of each worker, by address."""
        return cast(dict[str, int], self._client.nthreads())

    def _refuse_threads(self) -> None:
        with self._reachable():
            threads = self._threads()
        for worker, count in threads.items():
            if count > 1:
                raise ClusterError(
                    f"worker {worker} has {count} threads, which fly no faster than one; start "
                    f"{count} processes in its place: dask worker {self.address} --nthreads 1 "
                    f"--nworkers {count}"
                )

    @contextmanager
    def _reachable(self) -> Generator[None]:
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
    result = _ADDRESS.fullmatch(address)
    if result is None or int(result[3]) > 65535:
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
        _listen(result[2].strip("[]"), int(result[3]), greets=result[1] == "tcp")
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as problem:
        raise ClusterError(
            f"no Dask scheduler answers at {address} ({_words(problem)}); is it up (dask "
            "scheduler), and is its port open?"
        ) from None
    with client:
        yield Cluster(address, client)


def _task() -> Callable[[bytes, int], Sent | ShardRefused]:
    """A function that travels as its code, for it has no name that could be imported: a scheduler
    then needs nothing of ours, and a worker without it says so where it would die of a name."""
    return lambda campaign, shard: import_module("twin.campaigns.cluster").fly_sent(campaign, shard)


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
    reason = problem.strerror if isinstance(problem, OSError) else None
    return " ".join((reason or str(problem)).split()) or type(problem).__name__
