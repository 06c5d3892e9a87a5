"""Damaged files of every format are read or refused; `fuzz.py` beside this goes on for longer."""

import sys
from pathlib import Path

import pytest

from tests.recording.formats.fuzz import fuzz, write_seeds

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="asks the kernel for its memory")

RUNS = 100


def test_no_damage_to_a_file_of_any_format_is_a_traceback_a_hang_or_a_full_memory(tmp_path: Path):
    write_seeds(tmp_path, layouts=False)
    done, failures = fuzz(tmp_path, seed=3, runs=RUNS, seconds=60.0)
    assert not failures, "\n\n".join(failures)
    assert done > 10
