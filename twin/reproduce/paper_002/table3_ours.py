"""Table 3's data by prediction error, beside the Cramer-Rao bound of the very experiment.

An attitude that is integrated from a gyro tells nothing that the gyro does not, and its error is a
random walk. So the log keeps of it what was known independently: the attitude at the start.
"""

from dataclasses import replace

import numpy as np

from twin import rotation
from twin.identification import identify
from twin.recording import Recording
from twin.reproduce.efficiency import Trial, cramer_rao, efficiency_figure, judged, trial_of
from twin.reproduce.paper_002.manoeuvre import NOISE, as_guessed, ideal, machine, measured
from twin.reproduce.part import Computed, PaperPart, Say

SEEDS = range(100)
KNOWN = 5
"""Samples of the attitude at the start: what the paper's integration starts from."""
SCATTER = {"gyro": NOISE, "attitude": 1e-4, "wheel_speed": 1e-4}
"""1 sigma a sample: the gyro's is the paper's, which leaves the start and the wheels' speeds exact;
no likelihood can."""


def compute(say: Say) -> Computed:
    """100 seeds of the gyro's noise; neither its size is told nor products of inertia."""
    platform, guess, flight = machine(), as_guessed(), ideal()
    bound = cramer_rao(platform, as_handed_in(flight, 0), SCATTER)
    trials = list[Trial]()
    for seed in SEEDS:
        say(f"Table 3 by prediction error: seed {seed}")
        identification = identify([as_handed_in(flight, seed).without_truth()], guess)
        trials.append(trial_of(identification, platform, bound))
    ratio, covered = judged(
        platform,
        trials,
        "The attitude of its start alone is in the log: the rest of it is the gyro's integral.",
    )
    return Computed(
        {"002.table3.ours": ratio, "002.table3.ours_coverage": covered},
        {"Table 3 by prediction error: errors over their bounds": efficiency_figure(trials)},
    )


def as_handed_in(flight: Recording, seed: int) -> Recording:
    """With a noisy gyro, wheel speeds, and the attitude of the start."""
    rng = np.random.default_rng(seed)
    log = measured(flight, NOISE, rng)
    start, wheels = flight["attitude"], log["wheel_speed"]
    turns = rng.normal(0.0, SCATTER["attitude"], (KNOWN, 3))
    value = rotation.multiply(start.value[:KNOWN], rotation.from_rotation_vector(turns))
    scatter = rng.normal(0.0, SCATTER["wheel_speed"], wheels.value.shape)
    streams = {
        **log.streams,
        "attitude": replace(start, time=start.time[:KNOWN], value=value),
        "wheel_speed": replace(wheels, value=wheels.value + scatter),
    }
    known = {name: {"noise": SCATTER[name]} for name in ("attitude", "wheel_speed")}
    return Recording(streams, {**log.provenance, "streams": known})


PART = PaperPart(("002.table3.ours", "002.table3.ours_coverage"), compute)
