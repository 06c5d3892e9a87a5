"""A host in a process of its own, killed where it stands."""

import subprocess
import sys
import time
from pathlib import Path

from tests.processes import running


def killed(code: str, port: Path, word: str, after: float = 0.0) -> None:
    """Run a host on a port until it has said a word, and so much longer [s]; then `kill -9`."""
    command = [sys.executable, "-c", code, str(port)]
    here = Path(__file__).parents[3]
    with running(command, stdout=subprocess.PIPE, text=True, cwd=here) as host:
        assert host.stdout is not None
        assert host.stdout.readline() == f"{word}\n"
        time.sleep(after)
        host.kill()
