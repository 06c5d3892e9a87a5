"""`python -m benchmarks.papers`: the papers' own faults, hidden, asked for, and what was answered.

Writes docs/papers_found.md. Sizes are drawn around those that the papers met, or where they print
none around what would matter to them, from a seed that the page prints. What is in the folder
runs/papers is not done again.
"""

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from twin.clock import SimulatedClock
from twin.diagnosis import Diagnosis, diagnose
from twin.diagnosis.cause import Tried
from twin.effects import Effect, parse_effects
from twin.flight import prepare
from twin.platform import load_platform
from twin.recording import Recording
from twin.report.words import interval
from twin.stream.recorder import MemoryRecorder
from twin.units import printed

ROOT = Path(__file__).parents[1]
PAGE, FOLDER = ROOT / "docs" / "papers_found.md", ROOT / "runs" / "papers"
SEED = 20261121
SPREAD = 0.3
"""Share by which a size differs from the paper's at most."""


@dataclass(frozen=True)
class Fault:
    """One that a paper met, and a run of its machine that should show it."""

    paper: str
    words: str
    platform: str
    law: str
    reference: str
    duration: float
    """[s]."""
    effect: str
    """As on the command line, at the paper's size."""

    def drawn(self, seed: int) -> Effect:
        """Every number of it up to a third larger or smaller, by the seed."""
        (effect,) = parse_effects(self.effect)
        factor = np.random.default_rng(seed).uniform(1.0 - SPREAD, 1.0 + SPREAD, len(effect.values))
        return effect.with_values(effect.values * factor)

    def flown(self, effect: Effect, seed: int) -> Recording:
        """A log of the machine that has the effect."""
        flight = prepare(
            self.platform,
            controller=self.law,
            estimator=None,
            plant="sim",
            reference=self.reference or None,
            duration=self.duration,
            seed=seed,
            effects=[effect],
        )
        facts = {"platform": self.platform, "source": f"{self.platform}, seed {seed}"}
        memory = MemoryRecorder(flight.platform, facts)
        flight.fly(SimulatedClock(), [memory])
        return memory.recording().without_truth()

    def diagnosed(self, effect: Effect, seed: int) -> Diagnosis:
        """What is said of such a log by those who do not know."""
        return diagnose([self.flown(effect, seed)], load_platform(self.platform))


FAULTS = {
    "late wheels": Fault(
        "002", "wheel speeds 0.17 s late", "whorl1", "quaternion_pd", "slew:0,0,40@5", 40.0,
        "clock_lag:wheel_speed=0.17",
    ),
    "turned flywheel": Fault(
        "002", "a flywheel turned by up to 3.6 deg", "whorl1", "quaternion_pd", "slew:0,0,120@8",
        60.0, "wheel_misalignment:w1=0/0.035/-0.03",
    ),
    "inclinometer askew": Fault(
        "001", "inclinometer and IMU 1.2 deg apart", "astros", "mass_pid", "multisine:3", 30.0,
        "inclinometer_misalignment=0.014/-0.012/0.01",
    ),
    "gimbal friction": Fault(
        "000", "gimbal friction", "tas2", "cmg_pd", "multisine:3", 24.0, "gimbal_friction:g1=0.03",
    ),
    "gimbal backlash": Fault(
        "000", "gimbal backlash", "tas2", "cmg_pd", "multisine:3", 24.0, "gimbal_backlash:g1=4e-3",
    ),
    "gyro off balance": Fault(
        "000", "a CMG's own centre of mass", "tas2", "cmg_pd", "slew:5,-5,120@15", 24.0,
        "gimbal_center_of_mass_offset:g1=2e-3/-1e-3",
    ),
    "drag": Fault(
        "004", "an aerodynamic torque", "sads", "quaternion_pd", "slew:0,0,120@15", 60.0,
        "aerodynamic_drag=0.05",
    ),
    "ringing plate": Fault(
        "004", "a plate that rings", "sads", "quaternion_pd", "multisine:5@1", 40.0,
        "flexible_appendage=2/0.01/0.2/0/0/1",
    ),
    "stage backlash": Fault(
        "003", "stepper backlash", "cubesat:offset_plus", "mass_magnetic_pid", "", 40.0,
        "stage_backlash:s1=3e-5",
    ),
    "stage vibration": Fault(
        "003", "stepper vibration, where a gyro is read while masses move", "astros", "mass_pid",
        "multisine:3", 20.0, "stage_vibration:s1=1",
    ),
    "late wheels gently": Fault(
        "002", "wheel speeds 0.17 s late, moved less", "whorl1", "quaternion_pd",
        "multisine:3", 40.0,
        "clock_lag:wheel_speed=0.17",
    ),
    "gyro off balance gently": Fault(
        "000", "a CMG's own centre of mass, its gimbal moved less", "tas2", "cmg_pd",
        "slew:0,0,90@12", 24.0, "gimbal_center_of_mass_offset:g1=2e-3/-1e-3",
    ),
    "ringing plate gently": Fault(
        "004", "a plate that rings, after one turn", "sads", "quaternion_pd", "hold:0,0,40", 30.0,
        "flexible_appendage=2/0.01/0.2/0/0/1",
    ),
    "stage vibration in step": Fault(
        "003", "stepper vibration, a gyro read as masses stand", "cubesat:offset_plus",
        "mass_magnetic_pid", "", 40.0, "stage_vibration:s1=20",
    ),
}  # fmt: skip

HEAD = f"""# The papers' own faults, found

Written by `python -m benchmarks.papers`. Each log is flown by a simulated machine that has the
fault, its size drawn within {SPREAD:.0%} of the one in the table's command, and diagnosed by the
platform as shipped. Intervals are 95 %; evidence is that of the named cause against the best model
without it. One draw each: this says what can be found, not how often. The runs were chosen to show
the faults; the last rows are those tried before, which show them less or not at all.

| paper | fault | hidden | verdict | named, with the interval | tied | evidence | s |
| --- | --- | --- | --- | --- | --- | --- | --- |
"""


def row_of(name: str, seed: int) -> dict[str, Any]:
    """Hide, diagnose, and say what was answered."""
    fault = FAULTS[name]
    effect = fault.drawn(seed)
    log = fault.flown(effect, seed)
    begin = time.perf_counter()
    result = diagnose([log], load_platform(fault.platform))
    tried = next((item for item in result.tried if item.label == effect.label), None)
    return {
        "name": name,
        "seed": seed,
        "hidden": effect.words(),
        "label": effect.label,
        "verdict": result.verdict,
        "why not": result.not_asked.get(effect.label, ""),
        "found from": "" if tried is None else _from(tried),
        "causes": [
            {
                "label": cause.effect.label,
                "words": _words(cause.effect, cause.half_widths),
                "evidence": cause.evidence,
                "ties": [tie.label for tie in cause.ties],
            }
            for cause in result.causes
        ],
        "seconds": time.perf_counter() - begin,
    }


def _from(tried: Tried) -> str:
    known = zip(tried.names, tried.detectable, tried.units, strict=True)
    sizes = [f"{name} {printed(size, unit)}" for name, size, unit in known if np.isfinite(size)]
    return f"nothing; it would be found from {', '.join(sizes)} on" if sizes else ""


def _words(effect: Effect, half: np.ndarray) -> str:
    units = [known.unit for known in effect.parameters() for _ in range(known.size)]
    known = zip(effect.names, effect.values, half, units, strict=True)
    told = [f"{n} {interval(v, h, unit)}" for n, v, h, unit in known if np.isfinite(h)]
    return f"{effect.label}: {', '.join(told)}"


def page(rows: list[dict[str, Any]]) -> str:
    """docs/papers_found.md."""
    lines = [HEAD.rstrip("\n")]
    for row in rows:
        fault = FAULTS[row["name"]]
        named = "; ".join(c["words"] for c in row["causes"]) or row["why not"]
        named = named or row["found from"] or "nothing"
        ties = ", ".join(t for c in row["causes"] for t in c["ties"]) or "-"
        evidence = ", ".join(f"{c['evidence']:.0f}" for c in row["causes"]) or "-"
        lines.append(
            f"| {fault.paper} | {fault.words}, `{fault.platform}` | {row['hidden']} | "
            f"{row['verdict']} | {named} | {ties} | {evidence} | {row['seconds']:.0f} |"
        )
    lines += ["", f"Seeds {', '.join(sorted({str(row['seed']) for row in rows}))}. The logs:", ""]
    for row in rows:
        fault = FAULTS[row["name"]]
        reference = f" --reference {fault.reference}" if fault.reference else ""
        lines.append(
            f"- {fault.words}: `twin run {fault.platform} --controller {fault.law}{reference} "
            f"--duration {fault.duration:g} --effects {fault.effect} --rrd LOG.rrd`"
        )
    return "\n".join([*lines, ""])


def main() -> int:
    """Do what is not done yet, write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="FAULT", help=", ".join(FAULTS))
    parser.add_argument("--seed", type=int, default=SEED)
    options = parser.parse_args()
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in options.names or FAULTS:
        path = FOLDER / f"{name.replace(' ', '_')}-{options.seed}.json"
        if not path.exists():
            path.write_text(json.dumps(row_of(name, options.seed)))
        print(json.loads(path.read_text()), flush=True)
    done = {path.stem.rpartition("-")[0]: path for path in FOLDER.glob(f"*-{options.seed}.json")}
    order = [done[key] for key in (n.replace(" ", "_") for n in FAULTS) if key in done]
    PAGE.write_text(page([json.loads(path.read_text()) for path in order]), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
