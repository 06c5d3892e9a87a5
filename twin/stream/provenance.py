"""Where a recording comes from: enough to repeat it, or to see why it cannot be."""

import hashlib
import platform as computer
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from twin.library import findable
from twin.platform import Platform
from twin.recording.rrd_reader import SINGLE_MACHINE


def provenance(
    platform: Platform, *, seed: int | None, command: Sequence[str] | None = None
) -> dict[str, Any]:
    """The facts that go into a recording's `provenance`.

    Args:
        platform: the machine.
        seed: of all random numbers; None where there are none.
        command: the command line; this process's own unless given.
    """
    return {
        "schema": SINGLE_MACHINE,
        "kind": "run",
        "platform": findable(platform.folder, platform.name),
        "platform_files": hashes_of(platform.folder),
        "control_rate": platform.control_rate,
        "step": platform.step,
        "gravity": platform.gravity,
        "environment": {"magnetic_field": platform.magnetic_field.tolist()},
        "seed": seed,
        "command": list(sys.argv if command is None else command),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {
            "airbearing-twin": version("airbearing-twin"),
            "mujoco": version("mujoco"),
            "numpy": version("numpy"),
            "rerun-sdk": version("rerun-sdk"),
            "python": computer.python_version(),
        },
        "machine": computer.machine(),
    }


def hashes_of(folder: Path) -> dict[str, str]:
    """SHA-256 of each file that makes the platform; its example logs do not."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {
        name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if not (name := path.relative_to(folder).as_posix()).startswith("logs/")
    }
