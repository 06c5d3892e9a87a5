"""Paper 004, by G. Sharifi and others: its tables and figures, computed anew."""

from contextlib import suppress
from dataclasses import dataclass, field, replace

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from papers.efficiency import (
    Trial,
    cramer_rao,
    efficiency_figure,
    entries_of,
    is_rigid_body,
    judged,
    tensor,
    trial_of,
)
from papers.flown import About
from papers.rows import Computed, Ours, PaperPart, Say
from twin import rotation
from twin.budget import momentum_budget
from twin.clock import SimulatedClock
from twin.controller import Controller, load_controller
from twin.effects import BodyEffect, State, with_effects
from twin.effects.effect import Domain, parameter
from twin.effects.on_body import TorqueLaw
from twin.errors import PlatformError
from twin.estimators import load_estimator
from twin.estimators.estimator import Passthrough
from twin.identification import identify
from twin.loop import fly
from twin.plant.initial import InitialState, hanging
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.predict.base import NAMES
from twin.recording import Recording, Series
from twin.reference import Hold, Multisine
from twin.report.style import FIGURE, INK, PALETTE, SOFT, svg
from twin.signals import Command, Estimate, Target
from twin.stream.recorder import MemoryRecorder

Array = NDArray[np.float64]


TABLE1_WHEELS_DURATION = 300.0
"""[s]."""


def table1_wheels_compute(say: Say) -> Computed:
    """From the balance of momentum alone."""
    say("Table 1: the wheels' momentum")
    platform = load_platform("sads:table1")
    budget = momentum_budget(platform, Hold(), TABLE1_WHEELS_DURATION)
    limits = {wheel.name: wheel.momentum_limit for wheel in platform.wheels}
    value = max(budget.peak[name] / limit for name, limit in limits.items())
    torque = platform.gravity * float(np.hypot(*platform.center_of_mass_offset[:2]))
    full = "never" if budget.saturates_at is None else f"after {budget.saturates_at:.0f} s"
    note = f"Level, gravity asks {torque:.2f} N m; the first wheel is full {full}."
    return Computed({"004.table1.wheels": Ours(value, note=note)})


TABLE1_WHEELS_PART = PaperPart(("004.table1.wheels",), table1_wheels_compute)


PUBLISHED = np.array(
    [
        [2.8, 11.8, 12.0, 1.6, -0.9, 1.09],
        [4.0, 6.5, 14.1, 1.3, -0.81, 1.32],
        [1.2, 10.1, 13.9, 2.5, -0.76, 0.65],
        [2.5, 11.6, 10.6, 2.9, -1.5, 1.87],
        [3.5, 14.0, 16.0, 0.8, -2.1, 1.52],
    ]
)
"""xx yy zz xy xz yz of the five tests [kg m^2]."""


def table2_unphysical_compute(say: Say) -> Computed:
    """Count them."""
    say("Table 2: rigid bodies")
    bodies = [str(i + 1) for i, row in enumerate(PUBLISHED) if is_rigid_body(tensor(row))]
    note = f"Rigid bodies: tests {', '.join(bodies) or 'none'}."
    return Computed({"004.table2.unphysical": Ours(float(len(bodies)), note=note)})


TABLE2_UNPHYSICAL_PART = PaperPart(("004.table2.unphysical",), table2_unphysical_compute)


HOLD = 0.2
"""[s] for which a draw is held: the paper's step."""


@dataclass(frozen=True)
class UncertainTorque(BodyEffect):
    """Uniform between two bounds about each body axis, drawn anew each 0.2 s, for each run."""

    name = "uncertain_torque"
    domain = Domain.torque
    observable = "a white torque on the body"
    streams = ("gyro",)

    size: float = parameter(
        "bound",
        "N m",
        0.01,
        source='Sharifi and others, "between -0.01 and 0.01 N m"',
        low=0.0,
        high=1.0,
    )
    seed: int = field(default=0)
    """Of the draws."""

    @property
    def intensity(self) -> float:
        """Of a white torque that turns a body as far [(N m)^2 s]."""
        return self.size**2 / 3.0 * HOLD

    def torque(self, platform: Platform) -> TorqueLaw:
        drawn: dict[int, Array] = {}

        def law(state: State) -> Array:
            piece = int(state.time[0] / HOLD + 1e-6)
            if piece not in drawn:
                drawn.clear()
                rng = np.random.default_rng((self.seed, piece))
                drawn[piece] = rng.uniform(-self.size, self.size, (len(state.time), 3))
            return drawn[piece]

        return law


GAINS = {"proportional": 0.5, "derivative": 0.88}
"""Paper, "Mass properties identification"."""


@dataclass(frozen=True)
class RecordedTorques(Controller[None]):
    """Wheel torques as they were recorded, whatever the machine does."""

    torque: Series

    def init(self, platform: Platform, n: int) -> None:
        """Nothing is remembered."""

    def update(
        self, state: None, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, None]:
        """What was held at this time."""
        # a tick's stamp is a multiple of the period to the last bit or two
        return {"command_wheel_torque": self.torque.held_at(np.array([time + 1e-6]))}, None


def machine(variant: str) -> Platform:
    """A variant of `sads`, without the tilt stop, of which the paper's simulation knows nothing."""
    return replace(load_platform(variant), tilt_limit=np.inf)


def as_guessed(platform: Platform) -> Platform:
    """What an identification is told: the paper's initial values, (3, 12, 12, 0, 0, 0) and no r."""
    inertia = load_platform("sads").inertia
    return replace(platform, inertia=inertia, center_of_mass_offset=np.zeros(3))


def flown(
    platform: Platform,
    motion: Multisine,
    *,
    duration: float,
    runs: int,
    seed: int,
    torque: float = 0.0,
    start: InitialState | None = None,
) -> list[Recording]:
    """Fly a batch from where it hangs, about which it follows a motion; from a start, about that.

    Args:
        platform: the machine.
        motion: to follow.
        duration: [s].
        runs: how many.
        seed: of noise and disturbance.
        torque: bound of a disturbance [N m].
        start: of the machine; hanging at rest unless given.
    """
    start = start or InitialState(attitude=hanging(platform.center_of_mass_offset))
    disturbed = UncertainTorque(torque, seed=seed)
    plant = SimulatedPlant(
        with_effects(platform, [disturbed]) if torque else platform,
        runs=range(runs),
        seed=seed,
        initial=start,
    )
    recorder = MemoryRecorder(plant.platform, {"platform": platform.name, "source": "paper 004"})
    fly(
        plant,
        load_estimator("filter"),
        load_controller("quaternion_pd", GAINS),
        About(start.attitude, motion),
        SimulatedClock(),
        duration=duration,
        observers=[recorder],
    )
    return [recorder.recording(run) for run in range(runs)]


def resimulated(platform: Platform, theta: Array, log: Recording) -> Series:
    """Rates of a machine with such J and m r (9,) under a log's wheel torques, from rest where it
    hangs (Fig. 9)."""
    result = replace(platform, inertia=tensor(theta[:6]), center_of_mass_offset=theta[6:9])
    start = InitialState(attitude=hanging(result.center_of_mass_offset))
    plant = SimulatedPlant(result, initial=start)
    recorder = MemoryRecorder(plant.platform, {"platform": result.name, "source": "paper 004"})
    fly(
        plant,
        Passthrough(),
        RecordedTorques(log["command_wheel_torque"]),
        Hold(),
        SimulatedClock(),
        duration=float(log["command_wheel_torque"].time[-1]),
        observers=[recorder],
    )
    return recorder.recording()["truth_rate"]


FIG10_SEED = 70
FIG10_DURATION = 60.0
"""[s], ASSUMED."""


def fig10_compute(say: Say) -> Computed:
    """One log of the machine of Table 3 with the AHRS that `sads` has."""
    say("Fig. 10: a manoeuvre, and its simulation")
    platform = machine("sads:table3")
    motion = Multisine(np.radians(15.0), 0.02)
    (log,) = flown(platform, motion, duration=FIG10_DURATION, runs=1, seed=FIG10_SEED)
    assumed = as_guessed(platform)
    theta = identify([log.without_truth()], assumed, "levenberg-marquardt").theta
    simulated = resimulated(platform, theta, log)
    gyro = log["gyro"]
    again = simulated.interpolated_at(gyro.time)
    off = gyro.value - again
    value = float(np.sqrt(np.mean(off**2) / np.mean(gyro.value**2)))
    scatter = float(np.sqrt(np.mean((off - off.mean(axis=0)) ** 2)))
    note = (
        "From where what was found hangs, under the wheels' torques alone; what is left is "
        f"{1e3 * scatter:.2f} mrad/s of noise and the gyro's bias."
    )
    return Computed(
        {"004.fig10.rates": Ours(value, note=note)},
        {"Fig. 10: rates measured, and simulated with what was found": _fig10_figure(gyro, again)},
    )


def _fig10_figure(gyro: Series, again: Array) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 6.0))
        panels = figure.subplots(3, 1, sharex=True)
        for k, panel in enumerate(panels):
            panel.plot(gyro.time, np.degrees(gyro.value[:, k]), color=SOFT, label="measured")
            panel.plot(gyro.time, np.degrees(again[:, k]), color=PALETTE[1], label="simulated")
            panel.set_ylabel(f"rate about {'xyz'[k]} [deg/s]")
        panels[0].legend(ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0))
        panels[-1].set_xlabel("time [s]")
        return svg(figure)


FIG10_PART = PaperPart(("004.fig10.rates",), fig10_compute)


ITERATIONS = 3
FIG11_SEED = 80
FIG11_DURATION = 60.0
"""[s] of each manoeuvre, ASSUMED."""
FIG11_MOTION = Multisine(np.radians(10.0), 0.02)
LIMIT = 0.01
"""[N m]: paper."""


def fig11_compute(say: Say) -> Computed:
    """From the offset of Table 3, by Levenberg-Marquardt; eq. 18 and 19."""
    platform = machine("sads:table3")
    pull = np.array([stage.mass * stage.axis for stage in platform.stages])
    place, torques = np.zeros(len(pull)), list[float]()
    for number in range(ITERATIONS + 1):
        remaining = platform.center_of_mass_offset + place @ pull
        torques.append(platform.gravity * float(np.linalg.norm(remaining)))
        if number == ITERATIONS:
            break
        say(f"Fig. 11: iteration {number + 1}, {torques[-1]:.2g} N m left")
        # it swings about where it hangs until it is balanced, then about level
        start = InitialState(stage_position=place) if number else None
        (log,) = flown(
            platform,
            FIG11_MOTION,
            duration=FIG11_DURATION,
            runs=1,
            seed=FIG11_SEED + number,
            start=start,
        )
        assumed = as_guessed(platform)
        moment = identify([log.without_truth()], assumed, "levenberg-marquardt").theta[6:9]
        step = np.array([stage.resolution for stage in platform.stages])
        place = np.rint(-np.linalg.solve(pull.T, moment) / step) * step
    shown = ", ".join(f"{1e3 * torque:.3g}" for torque in torques)
    note = f"Largest torque of gravity, from start to end: {shown} mN m."
    return Computed(
        {"004.fig11.torque": Ours(torques[-1], note=note)},
        {"Fig. 11: largest torque of gravity over the iterations": _fig11_figure(torques)},
    )


def _fig11_figure(torques: list[float]) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.6))
        panel = figure.subplots()
        panel.semilogy(range(len(torques)), torques, "o-", color=PALETTE[0])
        panel.axhline(LIMIT, color=SOFT, ls="--")
        panel.set_xticks(range(len(torques)))
        panel.set(xlabel="iteration", ylabel="gravity torque [N m]")
        return svg(figure)


FIG11_PART = PaperPart(("004.fig11.torque",), fig11_compute)


TABLE1_OURS_SEEDS = 100
TABLE1_OURS_SEED = 5
TABLE1_OURS_DURATION = 100.0
"""[s], ASSUMED: the paper prints no duration."""
TABLE1_OURS_MOTION = Multisine(np.radians(20.0), 0.02)
"""ASSUMED; wheels and gains follow it by half."""
TORQUE = 0.01
"""[N m], bound of the disturbance: paper."""
NOTE = (
    "About the hanging attitude; with the paper's noise and its uncertain torque within 0.01 N m, "
    "whose size the method finds for itself and the bound is told."
)


def table1_ours_compute(say: Say) -> Computed:
    """One batch of runs, each with its own noise and disturbance."""
    say("Table 1 by prediction error: flights")
    platform = machine("sads:table1_noise")
    guess = as_guessed(platform)
    noise = {
        name: max(float(sensor.noise.max()), sensor.resolution / np.sqrt(12.0))
        for name, sensor in platform.sensors.items()
    }
    logs = flown(
        platform,
        TABLE1_OURS_MOTION,
        duration=TABLE1_OURS_DURATION,
        runs=TABLE1_OURS_SEEDS,
        seed=TABLE1_OURS_SEED,
        torque=TORQUE,
    )
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


TABLE1_OURS_PART = PaperPart(("004.table1.ours", "004.table1.ours_coverage"), table1_ours_compute)


TABLE1_SEEDS = 20
TABLE1_SEED = 40
RECURSIVE, TRAJECTORY = "recursive", "levenberg-marquardt"


def table1_compute(say: Say) -> Computed:
    """Twenty runs with their own noise and disturbance, both methods."""
    say("Table 1: flights")
    platform = machine("sads:table1_noise")
    logs = flown(
        platform,
        TABLE1_OURS_MOTION,
        duration=TABLE1_OURS_DURATION,
        runs=TABLE1_SEEDS,
        seed=TABLE1_SEED,
        torque=TORQUE,
    )
    result: dict[str, list[Array]] = {RECURSIVE: [], TRAJECTORY: []}
    for run, log in enumerate(logs):
        say(f"Table 1: run {run}")
        for method, thetas in result.items():
            identification = identify([log.without_truth()], as_guessed(platform), method)
            thetas.append(identification.theta[:9])
    truth, mean_moment = entries_of(platform), float(np.trace(platform.inertia)) / 3.0
    worst = {m: np.abs(np.array(thetas) - truth) for m, thetas in result.items()}
    inertia = {m: float(np.median(e[:, :6].max(axis=1))) / mean_moment for m, e in worst.items()}
    offset = float(np.median(worst[TRAJECTORY][:, 6:].max(axis=1))) / platform.mass
    note = f"About the hanging attitude, {TABLE1_OURS_DURATION:g} s, median of {TABLE1_SEEDS} runs."
    figure = _table1_figure(platform, logs[0], {m: thetas[0] for m, thetas in result.items()})
    return Computed(
        {
            "004.table1.rls": Ours(
                inertia[RECURSIVE],
                note=f"{note} Forgetting 0.99 a step; noise in the columns makes moments small.",
            ),
            "004.table1.clm": Ours(inertia[TRAJECTORY], note=note),
            "004.table1.clm_offset": Ours(offset, note=note),
        },
        {"Fig. 5: rates, true and simulated with what was found, where that is a body": figure},
    )


def _table1_figure(platform: Platform, log: Recording, result: dict[str, Array]) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 6.0))
        panels = figure.subplots(3, 1, sharex=True)
        true = log["truth_rate"]
        paths: dict[str, Series] = {}
        for method, theta in result.items():
            # recursion may end at a J that no body has
            with suppress(PlatformError):
                paths[method] = resimulated(platform, theta, log)
        for k, panel in enumerate(panels):
            panel.plot(true.time, np.degrees(true.value[:, k]), color=INK, lw=2.4, label="true")
            for (method, rate), color in zip(paths.items(), PALETTE, strict=False):
                panel.plot(rate.time, np.degrees(rate.value[:, k]), color=color, label=method)
            panel.set_ylabel(f"rate about {'xyz'[k]} [deg/s]")
        panels[0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
        panels[-1].set_xlabel("time [s]")
        return svg(figure)


TABLE1_PART = PaperPart(
    ("004.table1.rls", "004.table1.clm", "004.table1.clm_offset"), table1_compute
)


MANOEUVRES = ((15.0, 0.015), (20.0, 0.02), (25.0, 0.01), (12.0, 0.025), (18.0, 0.018))
"""Amplitude [deg] and lowest frequency [Hz], ASSUMED: "diverse amplitude and frequency"."""
TABLE2_DURATION = 300.0
"""[s], ASSUMED."""
TABLE2_SEEDS = (60, 61, 62)


def table2_compute(say: Say) -> Computed:
    """The spread over the five, three times over."""
    platform = experiment()
    ratios: list[Array] = []
    logs: list[Recording] = []
    for seed in TABLE2_SEEDS:
        say(f"Tables 2 and 3: seed {seed}")
        logs = five(platform, seed, 0.0)
        ratios.append(_ratio(logs, platform))
    ratio = np.median(ratios, axis=0)
    shown = ", ".join(f"{name} {value:.1f}" for name, value in zip(NAMES, ratio, strict=True))
    less = float(_ratio(five(platform, TABLE2_SEEDS[0], TORQUE), platform).min())
    note = (
        f"{shown}. Standard deviations over the five, median of {len(TABLE2_SEEDS)} times, from "
        "the accuracy of the AHRS, which is all that the paper states of its experiment; "
        f"forgetting 0.99 a step. With the torque of its simulation besides, {TORQUE:g} N m, the "
        f"smallest of one such five is {less:.1f}: a trajectory takes the model as exact."
    )
    return Computed(
        {"004.table2.repeatability": Ours(float(ratio.min()), note=note)},
        {
            "Fig. 7: attitude during a manoeuvre": _attitude(logs[0]),
            "Fig. 8: wheel speeds during the same": _wheels(logs[0]),
        },
    )


def experiment() -> Platform:
    """The machine as Table 3 found it, its AHRS as accurate as the paper says."""
    noisy = machine("sads:table1_noise")
    return replace(machine("sads:table3"), sensors=noisy.sensors)


def five(platform: Platform, seed: int, torque: float) -> list[Recording]:
    """One log a manoeuvre, under an uncertain torque [N m]."""
    logs: list[Recording] = []
    for number, (amplitude, frequency) in enumerate(MANOEUVRES):
        motion = Multisine(np.radians(amplitude), frequency)
        flight_seed = 10 * seed + number
        logs += flown(
            platform, motion, duration=TABLE2_DURATION, runs=1, seed=flight_seed, torque=torque
        )
    return logs


def _ratio(logs: list[Recording], platform: Platform) -> Array:
    """(9,) spread by recursion over that by trajectory."""
    assumed = as_guessed(platform)
    return _spread(logs, assumed, "recursive") / _spread(logs, assumed, "levenberg-marquardt")


def _spread(logs: list[Recording], platform: Platform, method: str) -> Array:
    """(9,) standard deviation of what a method finds in each log."""
    result = [identify([log.without_truth()], platform, method).theta[:9] for log in logs]
    return np.std(result, axis=0, ddof=1)


def _attitude(log: Recording) -> str:
    series = log["attitude"]
    turn = rotation.to_rotation_vector(
        rotation.multiply(rotation.conjugate(log["truth_attitude"].value[0]), series.value)
    )
    return _drawn(series.time, np.degrees(turn), "turn from hanging [deg]", "xyz")


def _wheels(log: Recording) -> str:
    series = log["wheel_speed"]
    rpm = series.value * 30.0 / np.pi
    return _drawn(series.time, rpm, "wheel speed [rpm]", series.columns)


def _drawn(time: Array, values: Array, label: str, names: tuple[str, ...] | str) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.6))
        panel = figure.subplots()
        for column, name, color in zip(values.T, names, PALETTE, strict=False):
            panel.plot(time, column, color=color, label=name)
        panel.set(xlabel="time [s]", ylabel=label)
        panel.legend(ncols=3)
        return svg(figure)


TABLE2_PART = PaperPart(("004.table2.repeatability",), table2_compute)


PARTS: tuple[PaperPart, ...] = (
    TABLE1_WHEELS_PART,
    TABLE1_PART,
    TABLE1_OURS_PART,
    TABLE2_PART,
    TABLE2_UNPHYSICAL_PART,
    FIG10_PART,
    FIG11_PART,
)
