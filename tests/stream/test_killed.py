"""kill -9 at any moment: the file opens, and holds all but the last second."""

import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.processes import running
from twin.recording import read_recording

VICTIM = Path(__file__).with_name("victim.py")
STREAMS = ("gyro", "estimate_attitude", "reference_attitude", "command_wheel_torque")

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="finds the writer in /proc"),
    pytest.mark.wall_clock,
]


def kill_while_recording(path: Path, after: float, writer_too: bool) -> float:
    """Time of the last tick that the recorder had taken [s]."""
    command = [sys.executable, VICTIM, path]
    with running(command, stdout=subprocess.PIPE, text=True) as victim:
        assert victim.stdout is not None
        said = [victim.stdout.readline()]
        if writer_too:
            # What reaches the writer before it has opened the file is in its memory only.
            while path.stat().st_size == 0 and victim.poll() is None:
                said.append(victim.stdout.readline())
        time.sleep(after)
        children = Path(f"/proc/{victim.pid}/task/{victim.pid}/children").read_text().split()
        os.kill(victim.pid, signal.SIGKILL)
        if writer_too:
            for child in children:
                os.kill(int(child), signal.SIGKILL)
        said += victim.stdout.readlines()
    return float([line for line in said if line.endswith("\n")][-1])


def check(path: Path, after: float, writer_too: bool) -> None:
    reached = kill_while_recording(path, after, writer_too)
    recording = read_recording(path)
    assert recording.repairs, "a recording that was cut short must say so"
    assert recording.provenance["platform"] == "sads"
    for name in STREAMS:
        held = recording[name].time if name in recording else []
        lost = reached - (held[-1] if len(held) else 0.0)
        assert lost <= 1.0, f"{name} lost {lost:.2f} s before the kill, {after:.2f} s after start"


@pytest.mark.parametrize("writer_too", [False, True], ids=["the loop", "the loop and its writer"])
@pytest.mark.parametrize("kills", [2, pytest.param(10, marks=pytest.mark.slow)])
def test_a_killed_recording_opens_and_lacks_at_most_a_second(
    tmp_path: Path, kills: int, writer_too: bool
):
    seed = random.randrange(2**32)
    print(f"seed {seed}")
    moments = random.Random(seed)
    with ThreadPoolExecutor(2) as pool:
        jobs = [
            pool.submit(check, tmp_path / f"{i}.rrd", moments.uniform(0.0, 3.0), writer_too)
            for i in range(kills)
        ]
    for job in jobs:
        job.result()
