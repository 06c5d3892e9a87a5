"""A host in a process of its own, killed where it stands."""

import subprocess
import sys
import time
from pathlib import Path


def killed(code: str, port: Path, word: str, after: float = 0.0) -> None:
    """Run a host on a port until it has said a word, and so much longer [s]; then `kill -9`."""
    host = subprocess.Popen(
        [sys.executable, "-c", code, str(port)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[3],
    )
    assert host.stdout is not None
    assert host.stdout.readline() == f"{word}\n"
    time.sleep(after)
    host.kill()
    host.wait()
    host.stdout.close()
