"""A Dask scheduler and its workers as processes of this machine."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

PATIENCE = 120.0
"""For a process to come up on a machine that has other things to do [s]."""


BARE = """
import runpy, sys
sys.modules["twin"] = None
module = sys.argv.pop(1)
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""
"""Runs a module as on a machine that has Dask and nothing of ours."""


class Processes:
    """What was started; ends with the `with`."""

    def __init__(self, folder: Path, **settings: str) -> None:
        """Start a scheduler, with Dask's settings as its environment has them."""
        self.workers: list[subprocess.Popen[bytes]] = []
        self._folder = folder
        self._file = folder / "scheduler.json"
        environment = {**os.environ, **settings}
        self.scheduler = subprocess.Popen(
            [
                *_bare("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"),
                *("--scheduler-file", str(self._file), "--idle-timeout", "10 minutes"),
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment,
        )

    def __enter__(self) -> "Processes":
        return self

    def __exit__(self, *_: object) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait(PATIENCE)

    @property
    def address(self) -> str:
        """Of the scheduler, as soon as it has one."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            try:
                return json.loads(self._file.read_text(encoding="utf-8"))["address"]
            except (OSError, ValueError):
                time.sleep(0.05)
        raise TimeoutError("the scheduler did not come up")

    def worker(self, *, bare: bool = False, **settings: str) -> subprocess.Popen[bytes]:
        """One more, in a folder of its own and without anybody to start it again.

        Args:
            bare: it has nothing of ours.
            settings: of its environment.
        """
        start = _bare if bare else _python
        folder = self._folder / f"worker-{len(self.workers)}"
        folder.mkdir()
        process = subprocess.Popen(
            [
                *start("dask_worker", self.address, "--nthreads", "1", "--no-nanny"),
                *("--no-dashboard", "--local-directory", str(folder), "--death-timeout", "20"),
            ],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **settings},
        )
        self.workers.append(process)
        return process


def _python(command: str, *words: str) -> list[str]:
    return [sys.executable, "-m", f"distributed.cli.{command}", *words]


def _bare(command: str, *words: str) -> list[str]:
    return [sys.executable, "-c", BARE, f"distributed.cli.{command}", *words]
