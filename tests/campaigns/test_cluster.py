"""A cluster flies what this machine would have flown, to the same bytes, whoever dies meanwhile."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.campaigns.conftest import GOOD, shards, silent
from tests.campaigns.dask_processes import PATIENCE, Processes
from tests.signals import hear
from twin.campaigns import cluster as clusters
from twin.campaigns.cluster import Cluster, ClusterError, connected
from twin.campaigns.execute import execute
from twin.campaigns.folder import Folder
from twin.campaigns.read import read_spec
from twin.cli.main import main
from twin.errors import UsageError
from twin.files import trust_folders
from twin.library import library

REPOSITORY = Path(__file__).parents[2]

FATAL = """
import os
if os.environ.get("FATAL_HERE"):
    os.kill(os.getpid(), 9)
"""
"""The end of a law that nobody survives who has that variable."""


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("spec") / "spec.toml"
    path.write_text(GOOD.replace("shard = 6", "shard = 2"), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def dask(tmp_path_factory) -> Generator[Processes]:
    with Processes(tmp_path_factory.mktemp("dask")) as processes:
        processes.worker()
        yield processes


def test_command_line_flies_on_a_cluster_and_goes_on_there(
    dask, undisturbed, file, tmp_path, capsys
):
    out = tmp_path / "out"
    words = ["campaign", str(file), str(out), "--cluster", dask.address, "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["ended"] == {"done": 24}
    assert shards(out) == shards(undisturbed)
    assert main(words) == 1
    assert "say --resume" in capsys.readouterr().err
    Folder(out).shard(3).unlink()
    assert main([*words, "--resume"]) == 0
    assert json.loads(capsys.readouterr().out)["flown"] == 2
    assert shards(out) == shards(undisturbed)


@pytest.mark.skipif(sys.platform == "win32", reason="nobody is killed with -9 there")
def test_a_worker_that_is_killed_in_the_middle_changes_no_byte(dask, undisturbed, file, tmp_path):
    spec, folder = read_spec(file), Folder(tmp_path)
    victim = dask.worker()
    with folder.owned(), connected(dask.address) as cluster:
        wait_for_workers(cluster, 2)
        folder.begin(spec, resume=False)
        flying = cluster.fly(spec, folder, range(spec.shards), silent)
        next(flying)
        victim.send_signal(signal.SIGKILL)
        done = {done.shard for done in flying}
    assert len(done) == spec.shards - 1
    assert shards(tmp_path) == shards(undisturbed)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="nobody is killed with -9 there")
def test_a_shard_that_kills_its_workers_is_told_by_name(tmp_path):
    trust_folders(tmp_path)
    law = tmp_path / "fatal.py"
    law.write_text((library("controllers") / "mass_magnetic_pid.py").read_text() + FATAL)
    file = tmp_path / "spec.toml"
    file.write_text(GOOD.replace('"mass_magnetic_pid"', f'"{law}"'), encoding="utf-8")
    folder = Folder(tmp_path / "out")
    with Processes(tmp_path, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0") as processes:
        processes.worker(FATAL_HERE="1")
        told = r"shard \d \(runs \d+ to \d+\) lost its worker 1 time: "
        with connected(processes.address) as cluster, pytest.raises(ClusterError, match=told):
            execute(read_spec(file), folder, workers=0, tell=silent, cluster=cluster)
    assert shards(folder.path) == {}


@pytest.mark.slow
def test_a_worker_that_has_nothing_of_ours_says_so(file, tmp_path):
    with Processes(tmp_path) as processes:
        processes.worker(bare=True)
        with (
            connected(processes.address) as cluster,
            pytest.raises(ClusterError, match=r"cannot import twin.*the extra `cluster`"),
        ):
            execute(
                read_spec(file), Folder(tmp_path / "o"), workers=0, tell=silent, cluster=cluster
            )


QUEUE = """
from distributed import LocalCluster

class SLURMCluster(LocalCluster):
    def __init__(self, *, queue, account, cores, processes, memory, walltime, interface,
                 local_directory, log_directory, job_script_prologue, worker_extra_args):
        assert processes == cores
        super().__init__(n_workers=0, threads_per_worker=1, dashboard_address=":0")

    def job_script(self):
        return ""

    def adapt(self, *, minimum_jobs, maximum_jobs):
        self.scale(1)
"""
"""In dask-jobqueue's place: a queue of this machine."""


@pytest.mark.slow
def test_the_script_for_slurm_flies_a_campaign(undisturbed, file, tmp_path):
    (tmp_path / "dask_jobqueue.py").write_text(QUEUE)
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, REPOSITORY / "docs/campaigns/slurm.py", file, tmp_path / "out"],
        env={**os.environ, "PYTHONPATH": path},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300.0,
    )
    assert done.returncode == 0, done.stderr
    assert shards(tmp_path / "out") == shards(undisturbed)


@pytest.mark.slow
def test_what_was_flown_when_the_scheduler_goes_away_is_gone_on_with(undisturbed, file, tmp_path):
    spec, folder = read_spec(file), Folder(tmp_path / "out")
    with Processes(tmp_path) as processes:
        processes.worker()
        with folder.owned(), connected(processes.address) as cluster:
            folder.begin(spec, resume=False)
            flying = cluster.fly(spec, folder, range(spec.shards), silent)
            next(flying)
            processes.scheduler.kill()
            with pytest.raises(ClusterError, match="went away .* --resume goes on"):
                list(flying)
    written = shards(folder.path)
    assert 0 < len(written) < spec.shards
    assert written.items() <= shards(undisturbed).items()
    execute(spec, folder, workers=1, tell=silent, resume=True)
    assert shards(folder.path) == shards(undisturbed)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C comes otherwise there")
def test_ctrl_c_takes_back_what_no_worker_has_begun(file, tmp_path):
    with Processes(tmp_path) as processes:
        command = [sys.executable, "-m", "twin", "campaign", str(file), str(tmp_path / "out")]
        command += ["--cluster", processes.address]
        with connected(processes.address) as cluster:
            with subprocess.Popen(command, stderr=subprocess.PIPE, preexec_fn=hear) as campaign:
                wait_until(lambda: tasks(cluster) > 0)
                campaign.send_signal(signal.SIGINT)
                _, said = campaign.communicate(timeout=300.0)
            assert campaign.returncode == 130
            assert b"--resume` goes on" in said
            wait_until(lambda: tasks(cluster) == 0)


def tasks(cluster: Cluster) -> int:
    """That the scheduler knows of."""
    return cluster._client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks))


@pytest.mark.parametrize("address", ["dask", "localhost:8786", "http://lab:8786", "tcp://lab",
                                     "tcp://lab:", "tcp://lab:99999", "tcp://:8786"])  # fmt: skip
def test_what_is_no_address_is_told(address):
    with (
        pytest.raises(UsageError, match=r"give the address of a Dask scheduler: tcp://HOST:PORT"),
        connected(address),
    ):
        pass


def test_a_scheduler_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setattr(clusters, "PATIENCE", 0.1)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        address = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        with pytest.raises(ClusterError, match="nothing is heard"), connected(address):
            pass
    with (
        pytest.raises(ClusterError, match=f"no Dask scheduler answers at {address} .*refused"),
        connected(address),
    ):
        pass


def test_a_campaign_without_dask_says_what_to_install(file, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    words = ["campaign", str(file), str(tmp_path / "out"), "--cluster", "tcp://lab:8786"]
    assert main(words) == 2
    assert "pip install '.[cluster]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main([*words, "--workers", "2"]) == 2
    assert "--cluster does not go with --workers" in capsys.readouterr().err


def test_workers_with_threads_are_refused_with_what_would_do(file, tmp_path):
    class Client:
        def nthreads(self) -> dict[str, int]:
            return {"tcp://10.0.0.1:1": 1, "tcp://10.0.0.2:2": 8}

    cluster = Cluster("tcp://lab:8786", Client())
    spec = read_spec(file)
    with pytest.raises(ClusterError, match=r"10.0.0.2:2 has 8 threads.* --nworkers 8"):
        next(cluster.fly(spec, Folder(tmp_path), [0], silent))


class Here:
    """A cluster's client whose only worker is this process."""

    def nthreads(self) -> dict[str, int]:
        return {"tcp://10.0.0.1:1": 1}

    def submit(self, task, campaign: bytes, shard: int, *, key: str, pure: bool) -> "Here":
        del pure
        self.key, self._task = key, lambda: task(campaign, shard)
        return self

    def add_done_callback(self, call) -> None:
        call(self)

    def result(self) -> object:
        return self._task()

    def cancel(self, futures: list["Here"], *, force: bool) -> None:
        assert not futures


def test_processors_that_round_otherwise_are_told(file, tmp_path, monkeypatch, capsys):
    @contextmanager
    def here(address: str) -> Generator[Cluster]:
        yield Cluster(address, Here())

    monkeypatch.setattr(clusters, "connected", here)
    monkeypatch.setattr(clusters, "AHEAD", 1)
    words = ["campaign", str(file), str(tmp_path / "out"), "--cluster", "tcp://lab:8786"]
    assert main(words) == 0
    assert "another kind" not in capsys.readouterr().err
    monkeypatch.setattr(clusters, "arithmetic", lambda: "otherwise")
    Folder(tmp_path / "out").shard(0).unlink()
    assert main([*words, "--resume"]) == 0
    assert "processors of another kind than this machine's" in capsys.readouterr().err


def wait_for_workers(cluster: Cluster, count: int) -> None:
    wait_until(lambda: len(cluster._threads()) >= count)


def wait_until(come: Callable[[], bool]) -> None:
    until = time.monotonic() + PATIENCE
    while not come():
        assert time.monotonic() < until
        time.sleep(0.05)
