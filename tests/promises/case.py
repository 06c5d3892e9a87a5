"""One case of the panel: drawn by its number, hidden, diagnosed, scored. All that is kept of it."""

import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType
from typing import Any
from unittest.mock import patch

import numpy as np
from baselines import named_by_others, oracle_gain
from benches import GRADES, LIBRARY, Bench, yardstick
from hidden import OutOfReach, any_of, bench_for, check_shown, graded, hide, kinds
from outside import LAWS, law_for
from scoring import behind, facts, siblings, stand_ins

from twin.diagnosis import Diagnosis, diagnose
from twin.diagnosis import candidates as asking
from twin.diagnosis.candidates import Candidates
from twin.effects import Effect
from twin.errors import TwinError

ROOT = Path(__file__).parents[2]
KINDS = {
    "null": (0,),
    "single": (60, 600, 6000),
    "pair": (6000,),
    "outside": (600, 6000),
    "left_out": (6000,),
}
"""What is hidden, and with how much evidence."""
LONG = 1000
"""From this number on logs are of 300 s at 100 Hz."""
LIMIT = 1200
"""After which a case has failed [s]."""


@dataclass(frozen=True)
class Case:
    """By its number everything else is drawn."""

    kind: str
    evidence: int
    seed: int

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.kind}-{self.evidence}-{self.seed:04d}"

    @property
    def grade(self) -> str:
        """Of its sensors; each in turn."""
        return list(GRADES)[self.seed % len(GRADES)]

    @property
    def long(self) -> bool:
        """300 s at 100 Hz rather than 120 s at 50 Hz."""
        return self.seed >= LONG


def run(case: Case) -> dict[str, Any]:
    """Everything about it. What fails is told, not raised."""
    row: dict[str, Any] = {
        **asdict(case),
        "grade": case.grade,
        "long": case.long,
        "version": version(),
        "truth": [],
    }
    signal.signal(signal.SIGALRM, _too_long)
    signal.alarm(LIMIT)
    try:
        return row | _run(case, row)
    except OutOfReach as why:
        return row | {"skipped": str(why).replace(f"{ROOT}/", "")}
    except Exception:
        said = traceback.format_exc().replace(f"{sys.prefix}/", "").replace(f"{ROOT}/", "")
        return row | {"failed": said}
    finally:
        signal.alarm(0)


def _too_long(number: int, frame: FrameType | None) -> None:
    raise TimeoutError(f"not done in {LIMIT} s")


def _run(case: Case, row: dict[str, Any]) -> dict[str, Any]:
    codes = [list(KINDS).index(case.kind), case.evidence, case.seed]
    rng = np.random.default_rng(codes)
    bench, effects = _drawn(case, rng)
    # a case that fails from here on tells what it was
    row |= {
        "bench": bench.words,
        "truth": [effect.label for effect in effects],
        "values": [effect.values.tolist() for effect in effects],
    }
    alike: list[str] = []
    if case.kind in ("single", "left_out"):
        alike = siblings(behind(yardstick(bench), effects[0]))
        row["siblings"] = alike
    if case.kind == "left_out" and any(_name(one) != _name(effects[0].label) for one in alike):
        raise OutOfReach(f"{effects[0].label} has siblings: {', '.join(alike)}")
    if case.kind == "pair" and (one := stand_ins(yardstick(bench), effects)):
        names = " and ".join(effect.label for effect in effects)
        raise OutOfReach(f"{names} together are no more than {one[0]} alone could be")
    hidden = hide(bench, effects, case.seed + 1000)
    if case.kind == "single":
        check_shown(hidden, case.evidence)
    begin = time.perf_counter()
    with without(_name(effects[0].label) if case.kind == "left_out" else ""):
        found = diagnose([hidden.log], hidden.believed)
    row |= facts(found) | {"seconds": time.perf_counter() - begin}
    if case.kind == "single":
        row |= beside(found, effects[0], alike)
    return {}


def beside(found: Diagnosis, truth: Effect, alike: list[str]) -> dict[str, Any]:
    """What others make of the same log."""
    return {
        "others": named_by_others(found, truth.label, alike),
        "oracle_gain": oracle_gain(found, (truth,)),
    }


def _drawn(case: Case, rng: np.random.Generator) -> tuple[Bench, tuple[Effect, ...]]:
    """Where, and what."""
    if case.kind == "null":
        return _any_bench(case, rng), ()
    if case.kind == "outside":
        law = LAWS[case.seed % len(LAWS)]
        why = OutOfReach(f"no bench can have {law.name}")
        for index in rng.permutation(len(LIBRARY)).tolist():
            bench = graded(LIBRARY[index], case.grade, long=case.long)
            try:
                return bench, (law_for(bench, law, case.evidence),)
            except OutOfReach as problem:
                why = problem
            except TwinError:
                continue
        raise why
    kind = str(rng.choice(kinds()))
    bench = bench_for(kind, case.grade, rng, long=case.long)
    if bench is None:
        raise OutOfReach(f"no bench shows {kind}")
    effects = [any_of(bench, case.evidence, rng, kind)]
    while case.kind == "pair" and len(effects) < 2:
        other = any_of(bench, case.evidence, rng)
        if _name(other.label) != kind:
            effects.append(other)
    return bench, tuple(effects)


def _any_bench(case: Case, rng: np.random.Generator) -> Bench:
    for index in rng.permutation(len(LIBRARY)).tolist():
        bench = graded(LIBRARY[index], case.grade, long=case.long)
        try:
            yardstick(bench)
        except TwinError:
            continue
        return bench
    raise OutOfReach("no bench can be diagnosed")


@contextmanager
def without(name: str) -> Iterator[None]:
    """The catalogue without one kind of effect; as it is for the name ''."""
    whole = asking.candidates_of

    def fewer(*args: Any, **more: Any) -> Candidates:
        every = whole(*args, **more)
        kept = tuple(one for one in every.asked if _name(one.label) != name)
        return Candidates(kept, every.not_asked)

    with patch("twin.diagnosis.diagnosis.candidates_of", fewer):
        yield


def _name(label: str) -> str:
    return label.partition(":")[0]


def version() -> str:
    """Of the code."""
    git = subprocess.run(
        ["git", "describe", "--always", "--dirty"],
        cwd=Path(__file__).parent, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return git.stdout.strip() or "unknown"
