"""`make` on a bare machine: what is missing is said in a sentence."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.processes import PATIENCE

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A checkout without an environment."""
    for name in ("Makefile", "pyproject.toml", "uv.lock"):
        shutil.copy(REPOSITORY / name, tmp_path)
    return tmp_path


@pytest.mark.parametrize("target", ["demo", "test", "test-slow", "lint", "bench"])
def test_every_target_asks_for_python_3_11_in_a_sentence(bare: Path, target: str):
    old = bare / "python3.9"
    old.write_text("#!/bin/sh\nexit 1\n")
    old.chmod(0o755)
    done = subprocess.run(
        ["make", target, f"PYTHON={old}"],
        cwd=bare,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode != 0
    assert "install Python 3.11 or newer" in done.stderr
    assert not (bare / ".venv").exists()


def test_a_python_without_venv_is_told_so(bare: Path):
    python = bare / "python3"
    python.write_text('#!/bin/sh\n[ "$1" = -c ] && exit 0\nexit 1\n')
    python.chmod(0o755)
    done = subprocess.run(
        ["make", "test", f"PYTHON={python}"],
        cwd=bare,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert done.returncode != 0
    assert "install its venv module" in done.stderr
