"""Every command in the README runs, in the README's order, in a folder like the checkout."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
MAKEFILE = (REPOSITORY / "Makefile").read_text(encoding="utf-8")

COMMANDS = [
    line
    for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    for line in block.splitlines()
    if line.strip()
]
TWIN_COMMANDS = [line for line in COMMANDS if line.startswith("twin ")]
DEMO = re.findall(r"^\t\$\(BIN\)/(twin .*)$", MAKEFILE, re.MULTILINE)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder that looks like a fresh checkout, for commands to write into."""
    for name in ("models", "controllers"):
        shutil.copytree(REPOSITORY / name, tmp_path / name)
    viewer = tmp_path / "viewer"
    viewer.write_text('#!/bin/sh\nfor last; do :; done\ntest -s "$last"\n')
    viewer.chmod(0o755)
    return tmp_path


def run(line: str, checkout: Path) -> None:
    """Run a line that begins with `twin`; only the viewer's window is a stand-in."""
    words = shlex.split(line, comments=True)[1:]
    done = subprocess.run(
        [sys.executable, "-m", "twin", *words],
        cwd=checkout,
        env={**os.environ, "RERUN_CLI_PATH": str(checkout / "viewer")},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300.0,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


def test_the_readme_shows_two_commands_to_start_and_fifteen_for_every_day():
    assert COMMANDS[:2] == ["make demo", "make test"]
    assert COMMANDS[2:] == TWIN_COMMANDS
    assert len(TWIN_COMMANDS) == 15


@pytest.mark.parametrize("target", re.findall(r"`?make ([a-z-]+)", README))
def test_every_make_target_of_the_readme_exists(target: str):
    assert re.search(rf"^{target}:", MAKEFILE, re.MULTILINE)


@pytest.mark.slow(150)
def test_every_command_of_the_readme_runs_in_its_order_and_those_of_make_demo(checkout: Path):
    assert DEMO
    ran = set()
    for line in TWIN_COMMANDS + DEMO:
        job = re.sub(r"runs/\S+", "runs/", line.split("#")[0]).strip()
        if job not in ran:
            run(line, checkout)
        ran.add(job)


@pytest.mark.slow(30)
def test_the_python_of_the_readme_runs(tmp_path: Path):
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert blocks
    script = tmp_path / "readme.py"
    script.write_text("\n".join(blocks))
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, timeout=300.0
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "why.html").is_file()


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#]+)\)", README))
def test_every_link_of_the_readme_leads_somewhere(link: str):
    assert (REPOSITORY / link).exists()
