"""Errors of an identification, as multiples of the Cramer-Rao bound of the same experiment."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from papers.rows import Ours
from twin import rotation
from twin.identification.excitation import BLIND
from twin.identification.identification import Identification
from twin.identification.prediction_error import NORMAL
from twin.model import compile_model
from twin.platform import Platform
from twin.predict.base import ENTRIES, NAMES, base_parameters
from twin.predict.body import body_of
from twin.predict.innovations import Problem
from twin.predict.kalman import NoiseProcess
from twin.predict.logs import motion_of
from twin.predict.states import States
from twin.recording import Recording
from twin.report.style import FIGURE, PALETTE, SOFT, svg

Array = NDArray[np.float64]


def tensor(entries: Array) -> Array:
    """(3, 3) of xx yy zz xy xz yz."""
    result = np.empty((3, 3))
    for value, (i, j) in zip(entries, ENTRIES, strict=True):
        result[i, j] = result[j, i] = value
    return result


def entries_of(platform: Platform) -> Array:
    """(9,) J and m r as a platform states them, as `ENTRIES` names them."""
    entries = [platform.inertia[i, j] for i, j in ENTRIES]
    return np.concatenate([entries, platform.center_of_mass_offset])


def is_rigid_body(inertia: Array) -> bool:
    """Whether its principal moments are positive and none exceeds the sum of the others."""
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] > 0.0 and moments[2] <= moments[0] + moments[1])


@dataclass(frozen=True)
class Trial:
    """One log: what was found of J and m r, and what can be known of them."""

    error: Array
    """(9,)."""
    half: Array
    """(9,) half of the 95 % intervals."""
    bound: Array
    """(9,) Cramer-Rao bound, 1 sigma."""


def trial_of(identification: Identification, truth: Platform, bound: Array) -> Trial:
    """Of an identification of a simulated machine.

    Args:
        identification: what the log said.
        truth: the machine that was flown.
        bound: (9,) of that log.
    """
    error = identification.theta[:9] - entries_of(truth)
    return Trial(error, identification.half_widths[:9], bound)


def cramer_rao(
    platform: Platform, log: Recording, noise: Mapping[str, float], intensity: float = 0.0
) -> Array:
    """(9,) bound: at the true base, along the true path, the noise as it is.

    Args:
        platform: the machine that was flown.
        log: with its true states.
        noise: 1 sigma a sample, by stream; of an attitude [rad].
        intensity: of a white torque about each axis [(N m)^2 s].
    """
    machine = compile_model(platform)
    base = base_parameters(machine)
    facts = {"streams": {name: {"noise": sigma} for name, sigma in noise.items()}}
    stated = replace(log.without_truth(), provenance=facts)
    body = body_of(machine, stated, motion_of(stated, platform))
    true = (
        log[name].interpolated_at(body.grid.starts)
        for name in ("truth_attitude", "truth_rate", "truth_wheel_speed")
    )
    attitude, rate, wheel_speed = true
    none = np.zeros((len(rate), 0))
    problem = Problem([body], base)
    at = replace(
        problem.start(base.as_stated, [np.zeros(len(body.bias_scale))]),
        starts=(States(rotation.normalized(attitude), rate, wheel_speed, none),),
    )
    covariance = problem.innovations(at, NoiseProcess(intensity)).covariance
    return np.asarray(np.sqrt(np.diag(covariance)[:9]), dtype=np.float64)


def identifiable_of(platform: Platform, trials: Sequence[Trial]) -> NDArray[np.bool_]:
    """(9,) which parameters the bound says can be seen: as an identification says it of its own
    intervals."""
    bound = np.sqrt(np.mean([np.square(trial.bound) for trial in trials], axis=0))
    return NORMAL * bound < BLIND * base_parameters(compile_model(platform)).scale


def ratios_of(trials: Sequence[Trial]) -> Array:
    """(9,) rms error over the bound."""
    return np.sqrt(np.mean([np.square(trial.error / trial.bound) for trial in trials], axis=0))


def judged(platform: Platform, trials: Sequence[Trial], note: str) -> tuple[Ours, Ours]:
    """The largest ratio of those that can be seen, and the share of their intervals that cover.

    Args:
        platform: the machine.
        trials: at least one.
        note: about the experiment; what cannot be seen is added.
    """
    identifiable, ratio = identifiable_of(platform, trials), ratios_of(trials)
    held = np.array([np.abs(trial.error) <= trial.half for trial in trials])
    unseen = [name for name, item in zip(NAMES, identifiable, strict=True) if not item]
    worst = NAMES[int(np.argmax(np.where(identifiable, ratio, 0.0)))]
    shown = ", ".join(f"{name} {ratio[i]:.2f}" for i, name in enumerate(NAMES) if identifiable[i])
    hidden = f" Not seen: {', '.join(unseen)}." if unseen else " All nine can be seen."
    each = held[:, identifiable].mean(axis=0)
    return (
        Ours(
            float(ratio[identifiable].max()),
            note=f"{len(trials)} seeds; {shown}; the largest is {worst}'s.{hidden} {note}",
        ),
        Ours(
            float(held[:, identifiable].mean()),
            note=f"{len(trials)} seeds; of one parameter {each.min():.0%} to {each.max():.0%}.",
        ),
    )


def efficiency_figure(trials: Sequence[Trial]) -> str:
    """Errors of each parameter in units of its bound."""
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.6))
        panel = figure.subplots()
        for place in range(len(NAMES)):
            error = np.array([trial.error[place] / trial.bound[place] for trial in trials])
            across = place + np.linspace(-0.25, 0.25, len(error))
            panel.plot(across, error, ".", ms=3.0, color=PALETTE[0])
            rms = float(np.sqrt(np.mean(np.square(error))))
            panel.text(place, 3.6, f"{rms:.2f}", ha="center", color=PALETTE[1])
        panel.axhspan(-NORMAL, NORMAL, color=SOFT, alpha=0.12, lw=0.0)
        panel.set_xticks(range(len(NAMES)), NAMES)
        panel.set(ylim=(-4.2, 4.2), ylabel="error / bound (rms above)")
        return svg(figure)
