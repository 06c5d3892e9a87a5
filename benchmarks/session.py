"""Sessions on the bench by the wall's clock: what a tick costs, how late it comes, what is skipped.

`cubesat` over its emulated board, which is another process behind a pseudo-terminal. At 100 Hz its
sensors are as quick as the loop. The last session shares the computer with processes that never
rest: there ticks are missed, and what counts is that each is accounted for.
"""

import json
import shutil
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from benchmarks.measure import table
from twin.platform import load_platform
from twin.recording import open_log

SESSIONS = ((20.0, 300.0, 0), (100.0, 300.0, 0), (100.0, 90.0, 4))
"""Ticks a second, duration [s], processes that never rest beside it."""
BUSY = "import time; time.sleep(30)\nwhile True: pass"
"""When the machine has been armed: one that is late already is not."""
RATE = "rate = 20.0"
KIND = 'kind = "microcontroller"'
BAUD = 1_000_000
"""As over USB: at 115,200 four streams at 100 Hz do not fit."""


def run() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [_session(Path(folder), *session) for session in SESSIONS]
    table(
        ("Hz", "s", "beside it", "a tick takes, ms", "of which read", "write", "record",
         "late, ms", "ticks", "skipped", "ticks that the recording lacks", "ended"),
        rows,
    )  # fmt: skip
    print("\nTimes: median, 99 %, the longest.")


def _session(folder: Path, rate: float, duration: float, beside: int) -> list[str]:
    machine, out = _machine(folder, rate), folder / f"{rate:g}-{beside}.rrd"
    words = ["run", str(machine), "--controller", "mass_magnetic_pid", "--plant", "pty",
             "--arm", "floating", "--duration", str(duration), "--rrd", str(out),
             "--json"]  # fmt: skip
    with ExitStack() as stack:
        for _ in range(beside):
            busy = subprocess.Popen([sys.executable, "-c", BUSY])
            stack.callback(busy.kill)
        done = subprocess.run(
            [sys.executable, "-m", "twin", *words], capture_output=True, text=True, check=False
        )
    told = json.loads(done.stdout)
    cycle = open_log(out)["loop_time"]
    late, read, estimate, control, write, record = 1e3 * cycle.value.T
    # what recording took is told by the tick after
    took = (read + estimate + control + write)[:-1] + record[1:]
    number = np.round(cycle.time * rate).astype(int)
    gaps = int(np.sum(np.diff(number) - 1)) + int(number[0])
    missing = round(told["duration"] * rate) - int(number[-1])
    return [
        f"{rate:g}", f"{duration:g}", f"{beside} busy processes" if beside else "nothing",
        _spread(took), _spread(read), _spread(write), _spread(record[1:]), _spread(late),
        str(len(cycle)), str(told["overruns"]),
        str(missing + gaps - told["overruns"]), told["ended"],
    ]  # fmt: skip


def _machine(folder: Path, rate: float) -> Path:
    """The platform at another rate."""
    there = folder / f"cubesat_{rate:g}"
    if not there.exists():
        shutil.copytree(load_platform("cubesat").model_path.parent, there)
        file = there / "platform.toml"
        text = file.read_text(encoding="utf-8").replace(RATE, f"rate = {rate:.1f}")
        text = text.replace(KIND, f"{KIND}\nbaud = {BAUD}")
        file.write_text(text, encoding="utf-8")
    return there


def _spread(values: np.ndarray) -> str:
    middle, high, most = np.percentile(values, [50.0, 99.0, 100.0])
    return f"{middle:.2f}, {high:.2f}, {most:.2f}"
