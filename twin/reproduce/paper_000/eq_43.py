"""Eq. 43: the printed J is no rigid body; one that is comes back; what could bias the method so."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.effects import parse_effects, with_effects
from twin.identification import Identification, identify
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.reproduce.inertia import entries_of
from twin.reproduce.paper_000.bench import (
    MIDDLE,
    PRINTED,
    printed_machine,
    tracked,
    with_noise,
)
from twin.reproduce.part import Computed, Ours, PaperPart, Say

Array = NDArray[np.float64]

ENTRIES = ("Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz", "m r_x", "m r_y", "m r_z")
RUNS = range(4)
CAUSES = (
    "gimbal_friction",
    "gimbal_backlash",
    "gimbal_center_of_mass_offset",
    "attitude_misalignment",
)
"""What the paper names, each in all three gyros at the catalogue's usual size."""
METHODS = ("integrated", "filtered")
"""The paper's; its result is of the first, the simple integrator."""


def rigid(say: Say) -> Computed:
    """Principal moments of the printed J."""
    say("principal moments")
    low, middle, high = np.linalg.eigvalsh(PRINTED)
    note = f"Principal moments {low:.1f}, {middle:.1f} and {high:.1f} kg m^2."
    return Computed({"000.eq43.rigid_body": Ours(bool(high <= low + middle), note=note)})


def products_back(say: Say) -> Computed:
    """Fly the machine of eq. 43, tell the identification another one, look what it says."""
    machine = printed_machine()
    stated = with_noise(load_platform("tas2"), MIDDLE)
    truth = entries_of(machine)
    say("sinusoidal tracking")
    run = tracked(machine, runs=RUNS)
    held: list[NDArray[np.bool_]] = []
    half = np.zeros(len(ENTRIES))
    for number, log in enumerate(run.recordings):
        say(f"log {number + 1} of {len(RUNS)}")
        identification = identify([log], stated)
        held.append(np.abs(identification.theta[:9] - truth) <= identification.half_widths[:9])
        half = identification.half_widths[:9] if number == 0 else half
    widths = ", ".join(f"{n} {w:.2g}" for n, w in zip(ENTRIES, half, strict=True))
    missed = [name for name, inside in zip(ENTRIES, held[0], strict=True) if not inside]
    note = (
        f"By prediction error from one log of 60 s; half widths {widths}. "
        + (f"Not held: {', '.join(missed)}. " if missed else "")
        + f"Over {len(RUNS)} logs {np.mean(held):.0%} of the intervals hold the truth."
    )
    return Computed({"000.eq43.products_back": Ours(bool(held[0].all()), note=note)})


def which_effect(say: Say) -> Computed:
    """The batch method on logs of machines that have one of the published faults each."""
    machine = replace(printed_machine(), sensors=load_platform("tas2").sensors)
    stated = load_platform("tas2")
    truth = entries_of(machine)[2]
    errors: dict[str, float] = {}
    for cause in ("", *CAUSES):
        say(cause or "nothing")
        faulty = with_effects(machine, parse_effects(cause)) if cause else machine
        (log,) = tracked(faulty).recordings
        errors[cause.replace("_", " ") or "nothing"] = _worst([log], stated, truth)
        if cause == "gimbal_backlash":
            errors["backlash behind the encoder"] = _worst([at_motor(log, faulty)], stated, truth)
    noisy = with_noise(machine, MIDDLE)
    (log,) = tracked(noisy).recordings
    errors["noise of 1 mrad and 1 mrad/s"] = _worst([log], with_noise(stated, MIDDLE), truth)
    name, worst = max(errors.items(), key=lambda item: abs(item[1]))
    told = ", ".join(f"{cause} {error:+.2g}" for cause, error in errors.items())
    note = (
        f"The largest comes from {name}. Errors of Jzz [kg m^2], the worse of both filters: {told}."
    )
    return Computed({"000.eq43.which_effect": Ours(float(abs(worst)), note=note)})


def at_motor(log: Recording, machine: Platform) -> Recording:
    """The log of encoders that sit on the motors, before the gear's play: angles as commanded."""
    angle, command = log["gimbal_angle"], log["command_gimbal_rate"]
    home = np.array([gimbal.home for gimbal in machine.gimbals])
    steps = np.diff(command.time, append=command.time[-1])[:, None]
    turned = home + np.cumsum(command.value * steps, axis=0) - command.value * steps
    shown = np.stack([np.interp(angle.time, command.time, column) for column in turned.T], axis=1)
    streams = {name: series for name, series in log.streams.items() if name != "gimbal_rate"}
    return replace(log, streams={**streams, "gimbal_angle": replace(angle, value=shown)})


def _worst(logs: Sequence[Recording], stated: Platform, truth: float) -> float:
    identifications: list[Identification] = [identify(logs, stated, method) for method in METHODS]
    return max((float(item.theta[2]) - truth for item in identifications), key=abs)


PARTS = (
    PaperPart(("000.eq43.rigid_body",), rigid),
    PaperPart(("000.eq43.products_back",), products_back),
    PaperPart(("000.eq43.which_effect",), which_effect),
)
