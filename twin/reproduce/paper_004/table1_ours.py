"""Table 1's experiment by prediction error, beside the Cramer-Rao bound of that very experiment."""

import numpy as np

from twin.identification import identify
from twin.reference import Multisine
from twin.reproduce.efficiency import Trial, cramer_rao, efficiency_figure, judged, trial_of
from twin.reproduce.paper_004.manoeuvre import as_guessed, flown, machine
from twin.reproduce.paper_004.uncertain_torque import UncertainTorque
from twin.reproduce.part import Computed, PaperPart, Say

SEEDS = 100
SEED = 5
DURATION = 100.0
"""[s], ASSUMED: the paper prints no duration."""
MOTION = Multisine(np.radians(20.0), 0.02)
"""ASSUMED; wheels and gains follow it by half."""
TORQUE = 0.01
"""[N m], bound of the disturbance: paper."""
NOTE = (
    "About the hanging attitude; with the paper's noise and its uncertain torque within 0.01 N m, "
    "whose size the method finds for itself and the bound is told."
)


def compute(say: Say) -> Computed:
    """One batch of runs, each with its own noise and disturbance."""
    say("Table 1 by prediction error: flights")
    platform = machine("sads:table1_noise")
    guess = as_guessed(platform)
    noise = {
        name: max(float(sensor.noise.max()), sensor.resolution / np.sqrt(12.0))
        for name, sensor in platform.sensors.items()
    }
    logs = flown(platform, MOTION, duration=DURATION, runs=SEEDS, seed=SEED, torque=TORQUE)
    trials = list[Trial]()
    for run, log in enumerate(logs):
        say(f"Table 1 by prediction error: run {run}")
        bound = cramer_rao(platform, log, noise, UncertainTorque(TORQUE).intensity)
        trials.append(trial_of(identify([log.without_truth()], guess), platform, bound))
    ratio, covered = judged(platform, trials, NOTE)
    return Computed(
        {"004.table1.ours": ratio, "004.table1.ours_coverage": covered},
        {"Table 1 by prediction error: errors over their bounds": efficiency_figure(trials)},
    )


PART = PaperPart(("004.table1.ours", "004.table1.ours_coverage"), compute)
