"""Whether an answer stays: over logs of one machine, and over what does not change a log's machine.

    python tests/promises/steady.py repeats --cases 10 --seed 1 --jobs 2
    python tests/promises/steady.py changes --cases 100 --seed 1 --jobs 2

`repeats` draws machines with a hidden cause (`mess.py`) and diagnoses six logs of each, whose mess
differs. `changes` diagnoses logs, measured ones among them, and each again as it is after a change:
cut by 10 to 30 % at either end, thinned by two, its room turned about the vertical, begun at
another time. An answer is its set of causes, a tie counting for what it ties with; sizes agree
where each lies inside the other's interval, widened to 95 % of the difference.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))

from hidden import hide  # noqa: E402
from mess import Gusts, Messy, draw, messed  # noqa: E402

from twin import rotation  # noqa: E402
from twin.diagnosis import Diagnosis, diagnose  # noqa: E402
from twin.errors import TwinError  # noqa: E402
from twin.platform import Platform, platform_of  # noqa: E402
from twin.processes import Pool  # noqa: E402
from twin.recording import Recording, open_log  # noqa: E402

Array = NDArray[np.float64]
MODELS = Path(__file__).parents[2] / "models"
MEASURED = (
    "dfki_pendulum/logs/energy_shaping",
    "dfki_pendulum/logs/energy_shaping_1kg",
    "dfki_pendulum/logs/sysid",
    "bicycle_fork/logs/first_swing",
    "vnucec_cubesat/logs/first_step",
)
EVERY = 5
"""Of so many logs that are changed one is measured."""
LOGS = 6
"""Of each machine."""
SURE = 0.9
"""Confidence from which on a name is asserted."""

Answer = dict[str, Any]


def answer(found: Diagnosis) -> Answer:
    """What is compared of a diagnosis."""
    return {
        "verdict": found.verdict,
        "causes": {
            cause.effect.label: {
                "values": cause.effect.values.tolist(),
                "half": cause.half_widths.tolist(),
                "ties": [tie.label for tie in cause.ties],
                "sure": cause.confidence > SURE,
            }
            for cause in found.causes
        },
    }


def same(one: Answer, other: Answer) -> bool:
    """Whether the sets of causes agree, a tie counting for what it ties with."""
    return _covers(one, other) and _covers(other, one)


def _covers(one: Answer, other: Answer) -> bool:
    known = [{label, *cause["ties"]} for label, cause in other["causes"].items()]
    return all(
        any({label, *cause["ties"]} & names for names in known)
        for label, cause in one["causes"].items()
    )


def agreeing(one: Answer, other: Answer) -> tuple[int, int]:
    """Numbers of causes that both name, which lie within each other's intervals; and how many."""
    inside, asked = 0, 0
    for label, cause in one["causes"].items():
        again = other["causes"].get(label)
        if again is None:
            continue
        for a, b, half_a, half_b in zip(
            cause["values"], again["values"], cause["half"], again["half"], strict=True
        ):
            beside = np.hypot(half_a, half_b)
            if np.isfinite(beside):
                asked += 1
                inside += abs(a - b) <= beside
    return inside, asked


def another_name(one: Answer, other: Answer) -> bool:
    """Whether a cause is asserted that the first answer does not have."""
    known = {label for label, cause in one["causes"].items()}
    known |= {tie for cause in one["causes"].values() for tie in cause["ties"]}
    return any(c["sure"] and label not in known for label, c in other["causes"].items())


def repeats(seed: int) -> dict[str, Any]:
    """Six logs of one machine with one hidden cause."""
    case = _with_cause(seed)
    answers: list[Answer] = []
    for number in range(LOGS):
        gusts = Gusts(rms=case.rms, seed=1000 * seed + number)
        hidden = [effect for effect in case.secret.effects if not isinstance(effect, Gusts)]
        try:
            secret = hide(case.secret.bench, (*hidden, gusts), 1000 * seed + number)
            noise = float(np.max(secret.believed.sensors["attitude"].noise, initial=0.0))
            log = messed(secret.log, np.random.default_rng([seed, number]), noise)
            answers.append(answer(diagnose([log], case.secret.believed)))
        except TwinError as why:
            answers.append({"verdict": f"refused: {why}", "causes": {}})
    pairs = [(a, b) for i, a in enumerate(answers) for b in answers[i + 1 :]]
    counted = [agreeing(a, b) for a, b in pairs]
    alike = [sum(same(one, other) for other in answers) for one in answers]
    return {
        "seed": seed,
        "bench": case.secret.bench.words,
        "truth": case.truth,
        "named": [sorted(one["causes"]) for one in answers],
        "same": max(alike),
        "logs": len(answers),
        "inside": sum(inside for inside, _ in counted),
        "asked": sum(asked for _, asked in counted),
    }


def _with_cause(seed: int) -> Messy:
    """A case that hides something: every fourth of `mess.draw` hides nothing."""
    return draw(seed + seed // 3)


def changes(seed: int) -> dict[str, Any]:
    """A log, and the same log changed."""
    rng = np.random.default_rng([seed, 47])
    log, platform, name = _log(seed)
    kind = list(CHANGES)[seed % len(CHANGES)]
    try:
        first = answer(diagnose([log], platform))
        second = answer(diagnose([CHANGES[kind](log, rng)], platform))
    except TwinError as why:
        return {"seed": seed, "log": name, "change": kind, "refused": str(why)}
    inside, asked = agreeing(first, second)
    return {
        "seed": seed,
        "log": name,
        "change": kind,
        "before": [first["verdict"], sorted(first["causes"])],
        "after": [second["verdict"], sorted(second["causes"])],
        "same": same(first, second),
        "another": another_name(first, second),
        "inside": inside,
        "asked": asked,
    }


def _log(seed: int) -> tuple[Recording, Platform, str]:
    if seed % EVERY == 0:
        name = MEASURED[(seed // EVERY) % len(MEASURED)]
        log = open_log(MODELS / name)
        return log, platform_of(log), name
    case = draw(seed)
    platform = case.secret.believed
    field = {"magnetic_field": platform.magnetic_field.tolist()}
    facts = {**case.secret.log.provenance, "environment": field}
    return replace(case.secret.log, provenance=facts), platform, case.secret.bench.words


def cut_before(log: Recording, rng: np.random.Generator) -> Recording:
    """Without 10 to 30 % at its beginning."""
    start = log.start + rng.uniform(0.1, 0.3) * (log.stop - log.start)
    return log.between(start, np.inf)


def cut_behind(log: Recording, rng: np.random.Generator) -> Recording:
    """Without 10 to 30 % at its end."""
    return log.between(-np.inf, log.stop - rng.uniform(0.1, 0.3) * (log.stop - log.start))


def thinned(log: Recording, rng: np.random.Generator) -> Recording:
    """Every second row of what is measured."""
    first = int(rng.integers(2))
    streams = {
        name: series
        if name.startswith("command_")
        else replace(series, time=series.time[first::2], value=series.value[first::2])
        for name, series in log.items()
    }
    return replace(log, streams=streams)


def later(log: Recording, rng: np.random.Generator) -> Recording:
    """Begun at another time."""
    shift = float(rng.uniform(-1e3, 1e5))
    streams = {name: replace(s, time=s.time + shift) for name, s in log.items()}
    return replace(log, streams=streams)


def turned(log: Recording, rng: np.random.Generator) -> Recording:
    """In a room of another heading; of a hinge, begun at another time."""
    if "attitude" not in log:
        return later(log, rng)
    turn = rotation.from_rotation_vector(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
    series = log["attitude"]
    value = rotation.multiply(np.broadcast_to(turn, series.value.shape), series.value)
    streams = {**log.streams, "attitude": replace(series, value=value)}
    facts = dict(log.provenance)
    surroundings = dict(facts.get("environment") or {})
    if "magnetic_field" in surroundings:
        field = rotation.rotate(turn, np.array(surroundings["magnetic_field"], dtype=np.float64))
        facts["environment"] = {**surroundings, "magnetic_field": field.tolist()}
    return replace(log, streams=streams, provenance=facts)


CHANGES: dict[str, Callable[[Recording, np.random.Generator], Recording]] = {
    "cut before": cut_before,
    "cut behind": cut_behind,
    "thinned": thinned,
    "turned": turned,
    "later": later,
}


def _count(rows: Sequence[dict[str, Any]], what: str) -> str:
    inside, asked = (sum(row[key] for row in rows) for key in ("inside", "asked"))
    if what == "repeats":
        alike, logs = (sum(row[key] for row in rows) for key in ("same", "logs"))
        return f"the same causes in {alike} of {logs} logs; sizes agree in {inside} of {asked}"
    alike, other = (sum(row[key] for row in rows) for key in ("same", "another"))
    return (
        f"the same causes in {alike} of {len(rows)}; another name for sure in {other}; sizes agree "
        f"in {inside} of {asked}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("repeats", "changes"))
    parser.add_argument("--cases", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1, help="number of the first case")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    asked = repeats if options.what == "repeats" else changes
    rows: list[dict[str, Any]] = []
    with Pool(options.jobs) as pool:
        futures = [pool.submit(asked, options.seed + i) for i in range(options.cases)]
        for future in as_completed(futures):
            row = future.result()
            print(row, flush=True)
            if "refused" not in row:
                rows.append(row)
    print(_count(rows, options.what))
    for kind in CHANGES if options.what == "changes" else ():
        own = [row for row in rows if row["change"] == kind]
        print(f"{kind}: {_count(own, options.what)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
