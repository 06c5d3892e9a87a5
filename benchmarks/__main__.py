"""`python -m benchmarks [SUBJECT ...]`: all subjects in turn, or those named.

What follows one subject from the first option on is that subject's: `read --size 2GB`.
"""

import sys
import time
from importlib import import_module

from benchmarks.measure import machine

SUBJECTS = {
    "start_up": "how long the command takes to answer",
    "single": "one run, against Basilisk where it is installed",
    "recording": "what recording costs",
    "read": "what reading a large log costs: --size 2GB, --formats csv mcap bag",
    "identify": "the base from a log of five minutes",
    "diagnose": "the causes of what a model gets wrong, from a log of five minutes",
    "real": "labelled faults in the real logs that we ship: --kinds units sensors clocks",
    "broad": "an inertial unit in a hand, beside VQF: --data FOLDER",
    "vendor": "bytes a second through the parsers of vendors' devices",
    "fuzz": "ten million random and mutated bytes into each parser",
    "guided": "ten million bytes that look for new paths through each parser",
    "session": "what a tick costs on the bench, and how late it comes",
    "link": "bytes a second through the parser of our own serial link",
    "machines": "steps a second of every machine",
    "batch": "closed loop against bare physics",
    "campaign": "a shard of a campaign, and a balancing, against bare physics",
    "plain": "a campaign against a plain Python loop over mj_step, and against Basilisk",
    "scaling": "what a campaign's cost grows with: runs, seconds, effects",
    "large": "a hundred thousand runs, beside ten thousand",
    "scale": "what a million and a thousand million runs of a campaign would take",
}


def main(words: list[str]) -> int:
    """Run the subjects; 2 if one of them is not known."""
    first = next((i for i, word in enumerate(words) if word.startswith("-")), len(words))
    names, options = words[:first], words[first:]
    if options and names not in (["read"], ["broad"], ["real"]):
        print(f"{options[0]} is an option of `read`, `broad` or `real` alone", file=sys.stderr)
        return 2
    unknown = [name for name in names if name not in SUBJECTS]
    if unknown:
        print(f"no benchmark named {unknown[0]!r}; known: {', '.join(SUBJECTS)}", file=sys.stderr)
        return 2
    print(machine())
    for name in names or SUBJECTS:
        print(f"\n== {name}: {SUBJECTS[name]}\n", flush=True)
        start = time.perf_counter()
        subject = import_module(f"benchmarks.{name}")
        subject.run(options) if options else subject.run()
        print(f"\n({time.perf_counter() - start:.0f} s)", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
