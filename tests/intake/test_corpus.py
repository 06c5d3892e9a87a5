"""The corpus as a whole: how much of it `twin import` opens, and how long every verb takes."""

import importlib.util
import secrets
import sys
import time
from pathlib import Path

import pytest

from twin.cli.main import main
from twin.errors import LogError
from twin.intake import import_files
from twin.platform import load_platform
from twin.recording import read_log

LIMIT = 60.0
"""Of one verb on one file, in seconds of the processor: others may use the computer, too."""
OPENED = 0.95
"""Share of the corpus, at least."""
WITH_PLATFORM = {"identify": LIMIT, "compare": LIMIT, "diagnose": 600.0}
"""Verbs that need a machine, of which the shipped logs are, and their limits [s]. A diagnosis fits
the log hundreds of times: its limit tells one that hangs from one that is slow."""


def _beside(name: str):
    """A module of this folder; tests are no package."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


makers = _beside("makers")
LAYOUTS = (*makers.MAKERS, *_beside("devices").DEVICES)


@pytest.fixture(scope="module")
def motion():
    seed = secrets.randbits(32)
    print("seed", seed)
    return makers.motion(seed)


@pytest.mark.slow(170)
def test_import_opens_95_percent_of_the_corpus_and_says_why_it_refuses_the_rest(
    motion, tmp_path: Path, capsys
):
    refused: dict[str, str] = {}
    times: dict[str, float] = {}
    for number, maker in enumerate(LAYOUTS):
        folder = tmp_path / str(number)
        folder.mkdir()
        maker.write(folder / maker.file, motion)
        start = time.process_time()
        try:
            import_files([folder / maker.file], folder / "log", None, None)
            assert set(maker.streams) <= set(read_log(folder / "log")), maker.name
        except LogError as problem:
            refused[maker.name] = str(problem)
        else:
            main(["show", str(folder / "log")])
            capsys.readouterr()
        times[maker.name] = time.process_time() - start
    for log, machine in makers.REAL:
        files = [makers.MODELS / log / name for name in makers.files_of(makers.MODELS / log)]
        platform = None if machine is None else load_platform(machine)
        start = time.process_time()
        import_files(files, tmp_path / log, platform, machine)
        main(["show", str(tmp_path / log)])
        capsys.readouterr()
        times[log] = time.process_time() - start
    with capsys.disabled():
        print()
        for name, seconds in sorted(times.items(), key=lambda one: -one[1]):
            print(f"{seconds:6.2f} s  import and show, {name}")
        print(f"{len(times) - len(refused)} of {len(times)} files are opened")
    assert max(times.values()) < LIMIT
    assert len(refused) <= (1.0 - OPENED) * len(times), refused
    for name, sentence in refused.items():
        assert "; " in sentence, f"{name}: {sentence} says not what would do"


@pytest.mark.slow(120)
@pytest.mark.timeout(1200)
def test_every_verb_ends_within_its_limit_on_a_log_of_another_lab(capsys):
    log = next(log for log, machine in makers.REAL if machine)
    for verb, limit in WITH_PLATFORM.items():
        start = time.process_time()
        main([verb, str(makers.MODELS / log)])
        seconds = time.process_time() - start
        capsys.readouterr()
        with capsys.disabled():
            print(f"\n{seconds:6.2f} s  {verb}, {log}")
        assert seconds < limit, verb
