"""The corpus as a whole: how much of it `twin import` opens, and how long every verb takes."""

import importlib.util
import secrets
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.seeds import seed_of
from twin.cli.main import main
from twin.intake import import_files
from twin.platform import load_platform

OPENED = 0.95
"""Share of the corpus, at least."""


def _beside(name: str):
    """A module of this folder; tests are no package."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


makers = _beside("makers")
LAYOUTS = (*makers.MAKERS, *_beside("devices").DEVICES)


@pytest.fixture(scope="module")
def motion(request: pytest.FixtureRequest):
    seed = seed_of(request)
    return makers.motion(seed)


def test_95_percent_of_the_corpus_are_layouts_that_import_opens():
    """That these are opened, and why the others are not, `test_import.py` holds of each."""
    refused = [maker.name for maker in LAYOUTS if maker.refused]
    assert len(refused) <= (1.0 - OPENED) * (len(LAYOUTS) + len(makers.REAL)), refused


@pytest.mark.slow(25)
def test_import_and_show_end_within_their_limit_on_whatever_streams_a_file_has(
    motion, tmp_path: Path, capsys
):
    """Of each set of streams one layout, for that is what they compute with; and the real ones."""
    seed = secrets.randbits(32)
    print("seed of the layouts", seed)
    order = np.random.default_rng(seed).permutation(len(LAYOUTS))
    layouts = {LAYOUTS[i].streams: LAYOUTS[i] for i in order if not LAYOUTS[i].refused}
    times: dict[str, float] = {}
    for number, maker in enumerate(layouts.values()):
        folder = tmp_path / str(number)
        folder.mkdir()
        maker.write(folder / maker.file, motion)
        times[maker.name] = import_and_show([folder / maker.file], folder / "log", None)
    for log, machine in makers.REAL:
        files = [makers.MODELS / log / name for name in makers.files_of(makers.MODELS / log)]
        times[log] = import_and_show(files, tmp_path / log, machine)
    capsys.readouterr()
    with capsys.disabled():
        print()
        for name, seconds in sorted(times.items(), key=lambda one: -one[1]):
            print(f"{seconds:6.2f} s  import and show, {name}")
    assert max(times.values()) < makers.LIMIT


def import_and_show(files: list[Path], log: Path, machine: str | None) -> float:
    """Time of the processor that both took [s]."""
    start = time.process_time()
    import_files(files, log, None if machine is None else load_platform(machine), machine)
    assert main(["show", str(log)]) == 0
    return time.process_time() - start


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["identify", "compare"])
def test_a_verb_that_fits_the_base_ends_within_its_limit_on_a_log_of_another_lab(verb: str):
    """How long its diagnosis takes, `tests/test_readme.py` holds."""
    log = next(log for log, machine in makers.REAL if machine)
    start = time.process_time()
    assert main([verb, str(makers.MODELS / log)]) == 0
    assert time.process_time() - start < makers.LIMIT
