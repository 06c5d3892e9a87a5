"""Whether `twin isolate` is right: causes at twice and at half the size that it calls detectable.

    python -m benchmarks.isolation --draws 20 --seed 1 --platforms sads cubesat

A machine and a cause that its experiment detects are drawn; the cause is hidden in the same
experiment, flown with other noise, at twice and at half its detectable size, and diagnosed. Found
means that the diagnosis names it, or that it ties with what is named.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from twin.diagnosis import diagnose
from twin.effects import Effect, able, effect_named, with_effects
from twin.errors import TwinError
from twin.experiments.isolation import EVIDENCE, CauseIsolation, Isolation, isolate
from twin.platform import Platform, load_platform

FACTORS = (2.0, 0.5)


def sized(cause: CauseIsolation, factor: float) -> Effect | None:
    """The cause at a multiple of its detectable size; None beyond its bounds."""
    name, _, target = cause.label.partition(":")
    effect = effect_named(name).typical(target)
    values = effect.values.copy()
    amplitude = np.concatenate([np.full(p.size, p.amplitude) for p in effect.parameters()])
    values[amplitude] = factor * cause.size
    low, high = effect.bounds()
    return effect.with_values(values) if np.all((low <= values) & (values <= high)) else None


def found(result: Isolation, platform: Platform, effect: Effect, seed: int) -> bool:
    """Whether a diagnosis of the flown experiment names the cause or ties it with a named one."""
    machine = with_effects(able(platform, effect), (effect,))
    log, obstacle = result.run.attempt(machine, seed=seed)
    if obstacle:
        raise TwinError(obstacle)
    diagnosis = diagnose([log.without_truth()], platform)
    named = [cause.effect.label for cause in diagnosis.causes]
    tied = [tie.label for cause in diagnosis.causes for tie in cause.ties]
    return effect.label in (*named, *tied)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--evidence", type=float, default=EVIDENCE)
    parser.add_argument("--platforms", nargs="+", default=["sads", "cubesat", "dfki_pendulum"])
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    plans = {
        name: isolate(name, duration=options.duration, evidence=options.evidence, advise=False)
        for name in options.platforms
    }
    counted = {factor: [0, 0] for factor in FACTORS}
    rows = []
    for draw in range(options.draws):
        name = str(rng.choice(options.platforms))
        plan, platform = plans[name], load_platform(name)
        possible = [c for c in plan.causes if np.isfinite(c.detectable) and sized(c, 2.0)]
        cause = possible[int(rng.integers(len(possible)))]
        for factor in FACTORS:
            effect = sized(cause, factor)
            assert effect is not None
            began, seed = time.monotonic(), int(rng.integers(2**31))
            try:
                hit = found(plan, platform, effect, seed)
            except TwinError as problem:
                print(f"{draw} {name} {cause.label} x{factor:g}: {problem}", flush=True)
                continue
            counted[factor][0] += hit
            counted[factor][1] += 1
            took = time.monotonic() - began
            words = f"{draw} {name} {cause.label} x{factor:g}"
            print(f"{words}: {'found' if hit else 'not found'} ({took:.0f} s)", flush=True)
            rows.append([name, cause.label, factor, seed, hit])
    for factor, (hits, total) in counted.items():
        print(f"at {factor:g} times the detectable size: {hits} of {total} found")
    if options.out is not None:
        options.out.write_text(json.dumps(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
