"""Fig. 2: torque method, natural and integrated, over the gyro's noise and thrusters' period."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.identification import Settings, identify
from twin.identification.methods import Form
from twin.plant.initial import hanging
from twin.platform import Platform
from twin.recording import Recording
from twin.report.style import FIGURE, svg
from twin.reproduce.inertia import entries_of
from twin.reproduce.paper_002.manoeuvre import (
    DURATION,
    RATE,
    RecordedCommands,
    flown,
    machine,
    measured,
)
from twin.reproduce.part import Computed, Ours, PaperPart, Say

Array = NDArray[np.float64]

PERIODS = np.array([0.04, 0.1, 0.3, 1.0, 3.0, 6.0, 10.0, 15.0, 20.0, 30.0])
"""[s] of the square wave."""
NOISES = np.logspace(-4.0, 0.0, 13)
"""1 sigma of the gyro, in parts of the largest rate."""
FORCE = 0.15
"""[N] of each of the two thrusters of a couple, ASSUMED."""
SEEDS = range(3)
COARSE = 10
"""Samples to a step, where the natural form is tried at a longer one."""
VALID = 10.0
"""[%] of median error that a valid estimate has at most."""


def compute(say: Say) -> Computed:
    """One flight a period, each at every noise, by both forms."""
    platform = machine()
    say("Fig. 2: flights")
    logs = [log.without_truth() for log in square_waves(platform)]
    error: dict[Form, Array] = {}
    for form in ("natural", "integrated"):
        error[form] = np.array(
            [[_median_error(log, platform, noise, form) for noise in NOISES] for log in logs]
        )
        say(f"Fig. 2: {form} form")
    natural, integrated = (max(map(borne, error[f])) for f in ("natural", "integrated"))
    best = {form: PERIODS[np.argmax([borne(row) for row in error[form]])] for form in error}
    note = (
        "At the period that bears most: "
        f"{best['natural']:g} s natural, {best['integrated']:g} s integrated."
    )
    coarse = every(logs[int(np.argmax(best["natural"] == PERIODS))], COARSE)
    slow = borne(np.array([_median_error(coarse, platform, n, "natural") for n in NOISES]))
    step = (
        "A difference over 0.02 s is that noisy; of the same motion at a step of "
        f"{COARSE / RATE:g} s, which Fig. 2 does not print, the natural form bears {slow:.2g}."
    )
    return Computed(
        {
            "002.fig2.natural": Ours(natural, note=f"{note} {step}"),
            "002.fig2.integrated_over_natural": Ours(
                integrated / natural, note=f"{note} Integrated bears {integrated:.2g}."
            ),
        },
        {"Fig. 2: median error of the nine parameters, torque method": _figure(error)},
    )


def square_waves(platform: Platform) -> list[Recording]:
    """Thrusters about z only, one run a period, the wheels at rest."""
    names = [thruster.name for thruster in platform.thrusters]
    time = (np.arange(round(DURATION * RATE)) + 0.5) / RATE
    value = np.zeros((len(time), len(PERIODS), len(names)))
    for run, period in enumerate(PERIODS):
        forward = (time / period + 0.25) % 1.0 < 0.5
        for name, on in (("pz1", forward), ("pz2", forward), ("nz1", ~forward), ("nz2", ~forward)):
            value[:, run, names.index(name)] = FORCE * on
    law = RecordedCommands("command_thruster", value)
    return flown(platform, law, start=hanging(platform.center_of_mass_offset), runs=len(PERIODS))


def every(log: Recording, count: int) -> Recording:
    """A log of which each so many samples of the gyro were kept."""
    gyro = log["gyro"]
    few = replace(gyro, time=gyro.time[::count], value=gyro.value[::count])
    return replace(log, streams={**log.streams, "gyro": few})


def borne(errors: Array) -> float:
    """Noise at which errors (len(NOISES),) first pass what is valid; 0 where they never are."""
    bad = np.flatnonzero(errors > VALID)
    if not len(bad):
        return float(NOISES[-1])
    i = int(bad[0])
    if i == 0:
        return 0.0
    part = np.log(VALID / errors[i - 1]) / np.log(errors[i] / errors[i - 1])
    return float(NOISES[i - 1] * (NOISES[i] / NOISES[i - 1]) ** part)


def _median_error(log: Recording, platform: Platform, noise: float, form: Form) -> float:
    truth = entries_of(platform)
    sigma = noise * float(np.abs(log["gyro"].value).max())
    result: list[float] = []
    for seed in SEEDS:
        noisy = measured(log, sigma, np.random.default_rng(seed))
        theta = identify([noisy], platform, "torque", Settings(form=form)).theta[:9]
        result.append(float(np.median(np.abs(100.0 * (theta - truth) / truth))))
    return float(np.median(result))


def _figure(error: dict[Form, Array]) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 4.0))
        panels = figure.subplots(1, 2, sharey=True)
        for panel, (form, values) in zip(panels, error.items(), strict=True):
            mesh = panel.pcolormesh(
                100.0 * NOISES, PERIODS, np.clip(values, 0.0, 100.0), shading="nearest", vmax=100.0
            )
            panel.set(xscale="log", yscale="log", title=form, xlabel="sensor noise [% of the rate]")
            panel.axhline(2.0 / RATE, color="white", ls="--")
            panel.text(100.0 * NOISES[0], 2.2 / RATE, " Ny", color="white")
            figure.colorbar(mesh, ax=panel, label="median error [%]")
        panels[0].set_ylabel("period of the square wave [s]")
        return svg(figure)


PART = PaperPart(("002.fig2.natural", "002.fig2.integrated_over_natural"), compute)
