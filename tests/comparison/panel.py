"""Logs of `sads` with nothing hidden, and with one effect each: what does `twin compare` say?

`python tests/comparison/panel.py FOLDER [--logs 20] [--duration 100] [--only nothing,...]` flies
and compares, one JSON a log, and prints the table; what is in FOLDER is not done again. A place is
right when it is the effect's own, or among those that the log is said not to tell apart; a name,
when the effect is among the laws found or among their ties.
"""

import argparse
import json
import re
import time
from pathlib import Path
from typing import Any

import numpy as np

from twin.clock import SimulatedClock
from twin.comparison import Comparison, compare
from twin.effects import parse_effects
from twin.flight import prepare
from twin.platform import load_platform
from twin.recording import Recording
from twin.report import sentences
from twin.stream.recorder import MemoryRecorder

EFFECTS = {
    "nothing": ("", "nothing"),
    "viscous": ("bearing_viscous_friction=0.01", "an external torque"),
    "drag": ("aerodynamic_drag=0.3", "an external torque"),
    "coulomb": ("bearing_coulomb_friction=2e-4", "an external torque"),
    "swirl": ("bearing_swirl_torque=1e-3", "an external torque"),
    "harness": ("harness_stiffness=0.02", "an external torque"),
    "drift": ("center_of_mass_drift=4e-6/-2e-6/1e-6", "an external torque"),
    "gyro scale": ("gyro_scale_factor=0.02/-0.02/0.02", "a sensor"),
    "gyro drift": ("gyro_drift=4e-6/-4e-6/4e-6", "a sensor"),
    "gyro misalignment": ("gyro_misalignment=0.03/0.02/-0.03", "a sensor"),
    "wheel gain": ("wheel_torque_gain:w1=0.05", "an exchange inside"),
    "wheel friction": ("wheel_friction:w1=1e-4/2e-3", "an exchange inside"),
    "wheel misalignment": ("wheel_misalignment:w1=0.02/-0.02/0.02", "an exchange inside"),
    "lag of the gyro": ("clock_lag:gyro=0.1", "a clock"),
    "lag of the wheels": ("clock_lag:wheel_speed=0.17", "a clock"),
    "drift of the attitude": ("clock_drift:attitude=1e-3", "a clock"),
}
"""What is hidden, and where it lives. The effects outside the list of symptoms are here too."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", type=int, default=20)
    parser.add_argument("--duration", type=float, default=100.0)
    parser.add_argument("--only", default=",".join(EFFECTS))
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in options.only.split(","):
        rows = [row(options.folder, name, seed, options.duration) for seed in range(options.logs)]
        print(line(name, rows), flush=True)
    return 0


def row(folder: Path, name: str, seed: int, duration: float) -> dict[str, Any]:
    """What was found in one log, from the folder or anew."""
    path = folder / f"{name.replace(' ', '-')}-{duration:g}-{seed:03d}.json"
    if not path.exists():
        log = flown(EFFECTS[name][0], seed, duration)
        begin = time.perf_counter()
        found = compare(log, load_platform("sads"))
        path.write_text(json.dumps(facts(found) | {"seconds": time.perf_counter() - begin}))
    return json.loads(path.read_text())


def flown(effects: str, seed: int, duration: float) -> Recording:
    """One run of `quaternion_pd` on its own reference."""
    flight = prepare(
        "sads",
        controller="quaternion_pd",
        estimator="filter",
        plant="sim",
        reference=None,
        duration=duration,
        seed=seed,
        effects=parse_effects(effects) if effects else (),
    )
    with flight.plant:
        about = {"platform": "sads", "source": f"seed {seed}"}
        recorder = MemoryRecorder(flight.platform, about)
        flight.fly(SimulatedClock(), [recorder])
    return recorder.recording(0)


def facts(found: Comparison) -> dict[str, Any]:
    """Plain numbers and words of a comparison."""
    best = found.best
    return {
        "verdict": found.verdict,
        "where": [domain.value for domain in found.where[0]],
        "or": [domain.value for domain in found.where[1]],
        "found": {
            s.symptom.name: {
                "values": s.values.tolist(),
                "half": s.half.tolist(),
                "ties": [tie.name for tie in s.ties],
            }
            for s in best.strengths
        },
        "evidence": {s.symptom.name: [s.evidence, s.needed] for s in best.scores},
        "sigmas": {f"{m.stream} {m.column}": m.sigmas for m in best.plain.misfits},
        "whiteness": {f"{m.stream} {m.column}": m.whiteness for m in best.plain.misfits},
        "conventions": [finding.sentence for finding in found.conventions],
        "noise": [finding.sentence for finding in found.noise],
        "sentences": sentences(found),
    }


def line(name: str, rows: list[dict[str, Any]]) -> str:
    """One line of the table."""
    effects, place = EFFECTS[name]
    count, seconds = len(rows), np.median([row["seconds"] for row in rows])
    if not effects:
        accused = [row for row in rows if row["verdict"] != "healthy"]
        misread = sum(bool(row["conventions"]) for row in rows)
        noisy = sum(bool(row["noise"]) for row in rows)
        sigmas = np.array([list(row["sigmas"].values()) for row in rows])
        return (
            f"{name}: {len(accused)} of {count} accused, {misread} called misread, "
            f"{noisy} with a finding about noise; chi-square off by {sigmas.mean():+.2f} sigma "
            f"in the mean, spread {sigmas.std():.2f}; {seconds:.1f} s"
        )
    own = {re.sub(r"[:=].*", "", word) for word in effects.split(",")}
    seen = sum(row["verdict"] != "healthy" for row in rows)
    placed = sum(place in row["where"] + row["or"] for row in rows)
    alone = sum(row["where"] == [place] and not row["or"] for row in rows)
    named = sum(bool(own & names(row)) for row in rows)
    misread = sum(bool(row["conventions"]) for row in rows)
    return (
        f"{name} ({effects}): seen in {seen} of {count}, place right in {placed} ({alone} alone), "
        f"named in {named}, misread {misread}; {seconds:.1f} s"
    )


def names(row: dict[str, Any]) -> set[str]:
    """Laws found, and what would stand in for them."""
    found = set(row["found"])
    for law in row["found"].values():
        found |= set(law["ties"])
    # a wheel's friction is one effect and two laws
    return {re.sub(r":.*|(?<=^wheel)_(viscous|coulomb)(?=_friction)", "", name) for name in found}


if __name__ == "__main__":
    raise SystemExit(main())
