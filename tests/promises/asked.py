"""What is said of a log by those who do not know what is hidden in it."""

import hidden
from benches import Bench

from twin.diagnosis import Diagnosis, diagnose

BENCH = Bench(duration=60.0)


def diagnosed(bench, effects, seed: int) -> Diagnosis:
    print(f"hidden: {[effect.words() for effect in effects]}, seed {seed}")
    secret = hidden.hide(bench, tuple(effects), seed)
    found = diagnose([secret.log], secret.believed)
    print(found.verdict, [cause.effect.words() for cause in found.causes])
    return found


def named(found: Diagnosis) -> list[set[str]]:
    return [{cause.effect.label, *(t.label for t in cause.ties)} for cause in found.causes]
