"""Bytes that look for new paths through each parser: what `fuzz` draws blindly, atheris (libFuzzer)
steers by the branches that each input takes.

`python -m benchmarks guided`, after `.venv/bin/pip install atheris` (it comes for Linux). An input
is a line of its own: its bytes go in pieces into a fresh parser, which may raise nothing, keep
little, and must hear the next good message once the line was quiet: without that pause the search
finds false frames that pass a weak check and end behind the good one. What fails is printed.
"""

# atheris is installed by hand, and its types are not
# pyright: reportMissingModuleSource=false, reportAttributeAccessIssue=false

import json
import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from benchmarks.measure import table

BYTES = 10_000_000
LONGEST = 4096
"""Bytes of one line."""
SEEDS = 40
"""Good lines, one to five messages long, from which the search starts."""
NEXT = 40_000
"""Number of the good message after a line; none of the seeds bears it."""
NAMES = "OurLink", "Xbus", "MDriveReplies", "Solar2Text", "Rvc", "VectorNav"


def search(name: str, corpus: str) -> None:
    """Search one parser in this process, print what came and leave; libFuzzer never returns."""
    import atheris

    with atheris.instrument_imports(include=["twin.plant.devices"]):
        from benchmarks import fuzz

    kind: type[fuzz.Fuzzed] = getattr(fuzz, name)
    for number in range(SEEDS):
        line = b"".join(kind().good(number + each) for each in range(1 + number % 5))
        Path(corpus, f"{number}").write_bytes(line)

    spent = lines = most = 0

    def one(data: bytes) -> None:
        nonlocal spent, lines, most
        subject = kind()
        piece = 1 + data[0] if data else 1
        for start in range(0, len(data), piece):
            subject.feed(data[start : start + piece])
        subject.quiet()
        if not subject.hears(NEXT):
            raise AssertionError("the good message after these bytes was not heard")
        spent, lines, most = spent + len(data), lines + 1, max(most, subject.most)
        if spent >= BYTES:
            paths = len(os.listdir(corpus)) - SEEDS
            print(json.dumps({"bytes": spent, "lines": lines, "most": most, "paths": paths}))
            sys.stdout.flush()
            os._exit(0)

    options = [f"-max_len={LONGEST}", "-len_control=10", "-seed=1", "-use_value_profile=1"]
    atheris.Setup([name, *options, f"-artifact_prefix={corpus}/", corpus], one)
    atheris.Fuzz()


def run() -> None:
    """Print the table."""
    if find_spec("atheris") is None:
        print("needs atheris: `.venv/bin/pip install atheris`")
        return
    rows: list[tuple[str, ...]] = []
    for name in NAMES:
        with tempfile.TemporaryDirectory() as corpus:
            command = [sys.executable, "-m", "benchmarks.guided", name, corpus]
            done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            print(done.stderr)
            rows.append((name, "failed, see above", "", "", ""))
            continue
        result = json.loads(done.stdout.splitlines()[-1])
        rows.append(
            (
                name,
                f"{result['bytes']:,}",
                f"{result['lines']:,}",
                f"{result['paths']:,}",
                f"{result['most']}",
            )
        )
    table(("parser", "bytes", "lines", "lines with new paths", "bytes kept at most"), rows)


if __name__ == "__main__":
    search(*sys.argv[1:])
