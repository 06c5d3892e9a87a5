"""Every example runs as a user runs it, and is short."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
SLOW = {"first_hour.py": 120, "balance.py": 60, "campaign.py": 40, "diagnose.py": 60}
"""Those that take longer than 20 s, and how long."""


def marked(path: Path):
    marks = [pytest.mark.slow(SLOW[path.name])] if path.name in SLOW else []
    return pytest.param(path, id=path.name, marks=marks)


def run(words: list[str], folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300.0,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    assert not done.stderr, done.stderr
    return done.stdout


@pytest.mark.parametrize("path", [marked(path) for path in sorted(EXAMPLES.glob("*.py"))])
def test_an_example_runs_and_prints(path: Path, tmp_path: Path):
    assert run([str(path)], tmp_path)
    # an engineer's first hour, from a machine to a campaign, is eighty
    assert len(path.read_text().splitlines()) <= (80 if path.name == "first_hour.py" else 60)


@pytest.mark.slow(60)
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda path: path.name)
def test_every_cell_of_a_notebook_runs(path: Path, tmp_path: Path):
    cells = json.loads(path.read_text())["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    script = tmp_path / "cells.py"
    script.write_text(code)
    (tmp_path / "models").symlink_to(EXAMPLES.parent / "models")
    assert run([str(script)], tmp_path)
    assert all(not cell.get("outputs") for cell in cells), "notebooks are kept without outputs"


def test_the_page_of_examples_names_each():
    said = (EXAMPLES / "README.md").read_text()
    for path in (*EXAMPLES.glob("*.py"), *EXAMPLES.glob("*.ipynb")):
        assert f"]({path.name})" in said
