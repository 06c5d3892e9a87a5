"""Signals at drawn moments: does every verb end in time, with its status, and leave nothing half?

    python tests/promises/stops.py --draws 300 --seed 1

Each draw starts a verb in a session of its own and sends SIGINT, SIGTERM or SIGHUP to the process
or to its group, as a terminal does, at a moment between its start and its usual end; a verb that
has ended before the signal is checked as well, but is drawn again and not counted. It prints a line
a draw and a table, and fails where a promise of docs/design.md, section 4.5, is broken.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq

from twin.recording import open_log

MODELS = Path(__file__).parents[2] / "models"
SWING = str(MODELS / "dfki_pendulum" / "logs" / "energy_shaping")

ENDS = 5.0
"""A verb ends so long after the signal [s]."""
CHILDREN = 2.0
"""No process of it is left so long after its end [s]."""
HANGS = 60.0
"""Longest wait for a verb that does not end [s]."""
FIRST = 0.15
"""Earliest moment [s]: before it the interpreter itself starts."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
TAG = "TWIN_STOPS_DRAW"
"""Variable by which the processes of a draw are recognised."""

SPEC = """
platform = "cubesat"
estimator = "passthrough"
controller = "mass_magnetic_pid"
runs = 96
duration = 20.0
seed = 3
shard = 6

[gains]
derivative = { grid = [1e-3, 2e-3] }

[initial]
hangs = true
center_of_mass_offset = { uniform = [[-2e-5, -2e-5, -1.4e-4], [2e-5, 2e-5, -1e-4]] }
"""


@dataclass(frozen=True)
class Verb:
    """A command line of `twin` and how it may end."""

    words: tuple[str, ...]
    latest: float
    """Latest moment of a signal [s]; about its usual end."""
    ends_well: bool = False
    """Whether Ctrl-C is a usual end of it, with status 0."""
    done: tuple[int, ...] = (0,)
    """Statuses of a verb that was done before it heard of the signal."""


VERBS: dict[str, Verb] = {
    "campaign": Verb(("campaign", "spec.toml", "out", "--workers", "2"), 8.0),
    "diagnose": Verb(("diagnose", SWING, "--report", "why.html", "--extend", "new"), 12.0),
    "identify": Verb(("identify", SWING, "--json"), 5.0, done=(0, 1)),
    "compare": Verb(("compare", SWING, "--report", "page.html"), 8.0),
    "balance": Verb(("balance", "cubesat", "--rrd", "balanced.rrd"), 10.0),
    "run": Verb(
        ("run", "sads", "--controller", "quaternion_pd", "--duration", "900", "--rrd", "run.rrd"),
        6.0,
        ends_well=True,
    ),
    "pty": Verb(
        ("run", "cubesat", "--controller", "mass_magnetic_pid", "--plant", "pty")
        + ("--arm", "floating", "--duration", "30", "--rrd", "pty.rrd"),
        10.0,
        ends_well=True,
        done=(0, 1),
    ),
    "emulate": Verb(("emulate", "cubesat"), 6.0, ends_well=True),
    "report": Verb(("report", "flown"), 2.5),
    "view": Verb(("view", "flown.rrd"), 6.0, done=(0, 1)),
    "reproduce": Verb(
        ("reproduce", "002", "--table", "table.md", "--report", "page.html"), 8.0, done=(0, 1)
    ),
    "show": Verb(("show", SWING, "--picture", "show.html"), 2.5),
    "export": Verb(("export", "flown.rrd", "tables", "--truth"), 1.2),
}


@dataclass(frozen=True)
class Drawn:
    """A verb, and the signal that it gets."""

    name: str
    moment: float
    number: signal.Signals
    group: bool
    """To all processes of its group, as a terminal sends it."""

    def words(self) -> str:
        to = "group" if self.group else "process"
        return f"{self.name} {self.number.name} to its {to} at {self.moment:.2f} s"


@dataclass(frozen=True)
class Outcome:
    """Of a draw."""

    broken: list[str]
    """Promises that it breaks, and the last lines that it printed if there are any."""
    code: int
    """Exit status."""
    took: float
    """From the signal to the end [s]."""
    heard: bool
    """Whether it still ran when the signal was sent."""

    def words(self) -> str:
        end = "BROKEN: " + "; ".join(self.broken) if self.broken else "kept"
        return f"{self.code} {f'after {self.took:.2f} s' if self.heard else 'before it'}, {end}"


def draw(names: Sequence[str], chance: random.Random) -> Drawn:
    """One draw; a SIGINT as often as the other two together."""
    name = chance.choice(names)
    number = chance.choices(SIGNALS, (2, 1, 1))[0]
    moment = chance.uniform(FIRST, VERBS[name].latest)
    return Drawn(name, moment, number, chance.random() < 0.5)


class Trials:
    """Draws in folders of their own, with a recording and a campaign that are flown once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "spec.toml").write_text(SPEC, encoding="utf-8")
        _twin(folder, "campaign", "spec.toml", "flown", "--workers", "2")
        _twin(folder, "run", "sads", "--duration", "60", "--rrd", "flown.rrd")
        self._shards = _shards(folder / "flown")
        self.count = 0

    def outcome(self, drawn: Drawn) -> Outcome:
        """What came of a draw."""
        self.count += 1
        work = self.folder / f"draw-{self.count}"
        work.mkdir()
        shutil.copy(self.folder / "spec.toml", work)
        (work / "flown").symlink_to(self.folder / "flown")
        (work / "flown.rrd").symlink_to(self.folder / "flown.rrd")
        words, code, took, heard = _ended(drawn, work)
        found = [] if took <= ENDS else [f"it ended {took:.1f} s after the signal"]
        found += _of_status(drawn, code, heard)
        found += _of_words(words, code)
        found += _of_files(work)
        if drawn.name == "campaign":
            found += self._resumed(work)
        if found:
            found += words.strip().splitlines()[-8:]
        shutil.rmtree(work)
        return Outcome(found, code, took, heard)

    def _resumed(self, work: Path) -> list[str]:
        _twin(work, "campaign", "spec.toml", "out", "--workers", "2", "--resume")
        same = _shards(work / "out") == self._shards
        return [] if same else ["the campaign that went on is another one"]


def _ended(drawn: Drawn, work: Path) -> tuple[str, int, float, bool]:
    """What it printed, its status, how long it took to end, and whether it got the signal."""
    mark = f"{os.getpid()}-{work.name}"
    with (work.parent / f"{work.name}.out").open("w+b") as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "twin", *VERBS[drawn.name].words],
            cwd=work,
            stdout=said,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            env=_environment() | {TAG: mark},
            start_new_session=True,
            preexec_fn=_hear,
        )
        try:
            process.wait(drawn.moment)
            heard = False
        except subprocess.TimeoutExpired:
            heard = True
            send = os.killpg if drawn.group else os.kill
            send(process.pid, drawn.number)
        sent = time.monotonic()
        try:
            code = process.wait(HANGS)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        took = time.monotonic() - sent
        left = _left(mark)
        said.seek(0)
        words = said.read().decode(errors="replace")
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    return words + "".join(f"\nLEFT process {pid}" for pid in left), code, took, heard


def _environment() -> dict[str, str]:
    # else each process compiles all that it imports
    return {name: v for name, v in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def _hear() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def _left(mark: str) -> list[int]:
    """Processes of a draw that still run when they should have ended."""
    end = time.monotonic() + CHILDREN
    while (pids := _tagged(mark)) and time.monotonic() < end:
        time.sleep(0.05)
    return pids


def _tagged(mark: str) -> list[int]:
    wanted, found = f"{TAG}={mark}".encode(), list[int]()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            alive = (entry / "stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
            if alive and wanted in (entry / "environ").read_bytes().split(b"\0"):
                found.append(int(entry.name))
        except OSError:
            continue
    return found


def _of_status(drawn: Drawn, code: int, heard: bool) -> list[str]:
    verb = VERBS[drawn.name]
    allowed = {128 + drawn.number, *verb.done}
    if not heard:
        allowed = set(verb.done)
    return [] if code in allowed else [f"it ended with {code}, not {sorted(allowed)}"]


def _of_words(words: str, code: int) -> list[str]:
    found = [f"it printed {mark!r}" for mark in ("Traceback", "Exception ignored", "LEFT")
             if mark in words]  # fmt: skip
    if code > 128 and "stopped" not in words:
        found.append("no sentence says that it was stopped")
    return found


def _of_files(work: Path) -> list[str]:
    found = list[str]()
    for path in sorted(work.rglob("*")):
        inside = path.relative_to(work).parts
        if path.is_symlink() or not path.is_file() or inside[0] == "flown":
            continue
        if any(part.startswith(".") for part in inside) and path.name != ".lock":
            found.append(f"{path.relative_to(work)} is left")
        check = _CHECKS.get(path.suffix)
        try:
            if check is not None:
                check(path)
        except Exception as problem:
            found.append(f"{path.name} is no whole file: {problem}")
    return found


def _check_recording(path: Path) -> None:
    if path.stat().st_size:
        open_log(path)
    else:
        raise ValueError("it is empty")


def _check_page(path: Path) -> None:
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>"), "it is cut short"


_CHECKS: dict[str, Callable[[Path], object]] = {
    ".rrd": _check_recording,
    ".html": _check_page,
    ".json": lambda path: json.loads(path.read_text(encoding="utf-8")),
    ".parquet": pq.read_table,
}


def _shards(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted((folder / "metrics").glob("*"))}


def _twin(folder: Path, *words: str) -> None:
    subprocess.run(
        [sys.executable, "-m", "twin", *words],
        cwd=folder,
        check=True,
        timeout=300.0,
        env=_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=300)
    parser.add_argument("--seed", type=int, default=random.randrange(1 << 31))
    parser.add_argument("--verbs", default=",".join(VERBS))
    options = parser.parse_args()
    print(f"{options.draws} draws, seed {options.seed}", flush=True)
    chance, names = random.Random(options.seed), options.verbs.split(",")
    count, worst, statuses = Counter[str](), Counter[str](), dict[str, Counter[int]]()
    failed = late = 0
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(Path(folder))
        while count.total() < options.draws:
            drawn = draw(names, chance)
            ended = trials.outcome(drawn)
            failed += bool(ended.broken)
            late += not ended.heard
            if ended.heard:
                count[drawn.name] += 1
                statuses.setdefault(drawn.name, Counter())[ended.code] += 1
                worst[drawn.name] = max(worst[drawn.name], round(1e3 * ended.took))
            print(f"{count.total()} {drawn.words()}: {ended.words()}", flush=True)
    print(f"\n{'verb':<12}{'draws':>6}{'slowest end':>13}  statuses")
    for name in sorted(count):
        codes = ", ".join(f"{code}: {n}" for code, n in sorted(statuses[name].items()))
        print(f"{name:<12}{count[name]:>6}{worst[name] / 1e3:>11.2f} s  {codes}")
    print(f"{failed} of {options.draws} draws broke a promise; {late} more were over before it")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
