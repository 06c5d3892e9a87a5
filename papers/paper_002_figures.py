"""Paper 002, by J. L. Schwartz and C. D. Hall: its manoeuvres and figures, computed anew.

Fig. 5, 7 and 10: what our diagnosis makes of a lag and of a turn that the wheels' data hide.

The machine of Table 1 with the sensors of `whorl1`: gyros at 41 Hz, wheel speeds at 1.1 Hz.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from papers.efficiency import entries_of
from papers.rows import Computed, Ours, PaperPart, Say
from twin import rotation
from twin.clock import SimulatedClock
from twin.controller import AnyController, Controller, load_controller
from twin.diagnosis import Diagnosis, diagnose
from twin.effects import Effect, with_effects
from twin.effects.sensors import ClockLag
from twin.effects.wheels import WheelMisalignment
from twin.estimators.estimator import Passthrough
from twin.identification import Settings, identify
from twin.identification.methods import Form
from twin.loop import fly
from twin.manoeuvre import parse_waves
from twin.plant.initial import InitialState, hanging
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.predict.base import NAMES
from twin.predict.logs import attitude_of_start
from twin.recording import Recording, Series
from twin.reference import Hold, Reference
from twin.report.style import FIGURE, INK, PALETTE, SOFT, svg
from twin.signals import Command, Estimate, Target
from twin.stream.recorder import MemoryRecorder

Array = NDArray[np.float64]


NOISE = 4.7e-3
"""[rad/s] of the gyro, 1 sigma: paper, what its moving average leaves; 95 % lie within 0.0091."""
DURATION = 60.0
"""[s], ASSUMED."""
RATE = 50.0
"""[Hz] of every sensor: paper, "a step-size of 0.02 s"."""
THRUST = parse_waves("square:x,0.11@6s,90+square:y,0.11@7.5s,90+square:z,0.16@30s,90", "torque")
"""Torques of the thrusters [N m] and periods of their square waves, as `twin run --torque` takes
them. ASSUMED: the data reach the paper's 0.1 rad/s; its Fig. 3 has a basic torque profile, and no
numbers."""
FINE = 0.01
"""[s] step of the reference body's own integration."""


def square(time: Array) -> Array:
    """(m, 3) torque of the thrusters at instants (m,) [N m]; its mean rate is none."""
    return np.stack([wave.value(time) for wave in THRUST], axis=1)


@dataclass(frozen=True)
class ThrustedBody(Reference):
    """A rigid body that thrusters turn, free of gravity; known at whole steps of `FINE`."""

    inertia: Array
    """(3,) principal moments [kg m^2]."""

    @cached_property
    def _path(self) -> Target:
        count = round((DURATION + 20.0) / FINE)
        attitude, rate = np.zeros((count + 1, 4)), np.zeros((count + 1, 3))
        attitude[0, 0] = 1.0
        middles = FINE * (np.arange(count + 1, dtype=np.float64) + 0.5)
        push = square(np.asarray(middles, dtype=np.float64))
        for i in range(count):
            attitude[i + 1], rate[i + 1] = self._after(attitude[i], rate[i], push[i])
        return Target(attitude, rate, self._turning(rate, push))

    def at(self, time: float | Array) -> Target:
        """As integrated, at the nearest step."""
        path = self._path
        at = np.clip(np.rint(np.asarray(time) / FINE).astype(np.intp), 0, len(path.rate_body) - 1)
        return Target(path.attitude[at], path.rate_body[at], path.acceleration_body[at])

    def _turning(self, rate: Array, push: Array) -> Array:
        return (push - rotation.cross(rate, self.inertia * rate)) / self.inertia

    def _after(self, attitude: Array, rate: Array, push: Array) -> tuple[Array, Array]:
        middle = rate + 0.5 * FINE * self._turning(rate, push)
        turn = rotation.from_rotation_vector(FINE * middle)
        return rotation.multiply(attitude, turn), rate + FINE * self._turning(middle, push)


@dataclass(frozen=True)
class RecordedCommands(Controller[None]):
    """Commands as they were recorded, whatever the machine does."""

    stream: str
    value: Array
    """(ticks, width), or (ticks, n, width)."""

    def init(self, platform: Platform, n: int) -> None:
        """Nothing is remembered."""

    def update(
        self, state: None, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, None]:
        """The row of this tick."""
        row = self.value[min(round(time * RATE), len(self.value) - 1)]
        return {
            self.stream: np.broadcast_to(row, (len(estimate.valid), row.shape[-1])).copy()
        }, None


def machine(*, inertia: Array | None = None, moment: Array | None = None) -> Platform:
    """`whorl1` as Table 1 has it, every sensor exact and at the step of the simulation.

    Args:
        inertia: (3, 3) in place of Table 1's.
        moment: (3,) m r in place of Table 1's.
    """
    stated = load_platform("whorl1:table1")
    exact = {
        name: replace(
            stated.sensors[name],
            rate=RATE,
            noise=np.zeros(3),
            bias=np.zeros(3),
            range=np.inf,
        )
        for name in ("gyro", "attitude", "wheel_speed")
    }
    return replace(
        stated,
        sensors=exact,
        inertia=stated.inertia if inertia is None else inertia,
        center_of_mass_offset=stated.center_of_mass_offset if moment is None else moment,
    )


def as_guessed() -> Platform:
    """What an identification is told: the simple mass properties, hanging straight down."""
    truth = machine()
    down = np.array([0.0, 0.0, -float(np.linalg.norm(truth.center_of_mass_offset))])
    return machine(inertia=np.diag(np.diag(truth.inertia)), moment=down)


def flown(
    platform: Platform,
    law: AnyController,
    *,
    reference: Reference | None = None,
    start: Array | None = None,
    runs: int = 1,
    seed: int = 0,
) -> list[Recording]:
    """Fly a batch from rest.

    Args:
        platform: the machine.
        law: what drives it.
        reference: what the law follows.
        start: (4,) attitude; level unless given.
        runs: how many.
        seed: of the sensors' noise.
    """
    first = InitialState() if start is None else InitialState(attitude=start)
    plant = SimulatedPlant(platform, runs=range(runs), seed=seed, initial=first)
    recorder = MemoryRecorder(plant.platform, {"platform": platform.name, "source": "paper 002"})
    fly(
        plant,
        Passthrough(),
        law,
        reference or Hold(),
        SimulatedClock(),
        duration=DURATION,
        observers=[recorder],
    )
    return [recorder.recording(run) for run in range(runs)]


@cache
def tracked() -> Recording:
    """Fig. 4: the machine of simple mass properties follows the body on thrusters."""
    simple = np.diag(np.diag(machine().inertia))
    platform = machine(inertia=simple, moment=np.zeros(3))
    law = load_controller("mrp_tracking")
    (log,) = flown(platform, law, reference=ThrustedBody(np.diag(simple)))
    return log


@cache
def ideal() -> Recording:
    """What perfect sensors see of the machine of Table 1, hanging at rest until its wheels turn."""
    platform = machine()
    (log,) = flown(platform, wheels(), start=hanging(platform.center_of_mass_offset))
    return log


def wheels() -> RecordedCommands:
    """The wheels' torques of Fig. 4."""
    return RecordedCommands("command_wheel_torque", tracked()["command_wheel_torque"].value)


def measured(log: Recording, sigma: float, rng: np.random.Generator) -> Recording:
    """With noise on the gyro [rad/s], and with the attitude that is integrated from it."""
    gyro = log["gyro"]
    noisy = replace(gyro, value=gyro.value + rng.normal(0.0, sigma, gyro.value.shape))
    streams = {**log.streams, "gyro": noisy, "attitude": attitude_of_start(noisy, log["attitude"])}
    return replace(log, streams=streams)


METHODS: Mapping[str, tuple[str, Settings]] = {
    "torque": ("torque", Settings()),
    "momentum_1": ("momentum", Settings(shift=1)),
    "momentum_2": ("momentum", Settings(shift=2)),
    "momentum_3": ("momentum", Settings(shift=3)),
}
"""Columns of Tables 2 and 3: TM, MI(1), MI(2), MI(3), all integrated."""


def errors(log: Recording, platform: Platform, method: str) -> Array:
    """(9,) errors of a method of the paper [%]; J xx yy zz xy xz yz, then m r."""
    name, settings = METHODS[method]
    truth = entries_of(platform)
    return 100.0 * (identify([log], platform, name, settings).theta[:9] - truth) / truth


def largest(percent: Array) -> float:
    """Of the errors of nine parameters, whatever their sign [%]."""
    return float(np.abs(percent).max())


PERIODS = np.array([0.04, 0.1, 0.3, 1.0, 3.0, 6.0, 10.0, 15.0, 20.0, 30.0])
"""[s] of the square wave."""
NOISES = np.logspace(-4.0, 0.0, 13)
"""1 sigma of the gyro, in parts of the largest rate."""
FORCE = 0.15
"""[N] of each of the two thrusters of a couple, ASSUMED."""
FIG2_SEEDS = range(3)
COARSE = 10
"""Samples to a step, where the natural form is tried at a longer one."""
VALID = 10.0
"""[%] of median error that a valid estimate has at most."""


def fig2_compute(say: Say) -> Computed:
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
        {"Fig. 2: median error of the nine parameters, torque method": _fig2_figure(error)},
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
    for seed in FIG2_SEEDS:
        noisy = measured(log, sigma, np.random.default_rng(seed))
        theta = identify([noisy], platform, "torque", Settings(form=form)).theta[:9]
        result.append(float(np.median(np.abs(100.0 * (theta - truth) / truth))))
    return float(np.median(result))


def _fig2_figure(error: dict[Form, Array]) -> str:
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


FIG2_PART = PaperPart(("002.fig2.natural", "002.fig2.integrated_over_natural"), fig2_compute)


def fig4_compute(say: Say) -> Computed:
    """One flight under eq. 26."""
    say("Fig. 4: tracking")
    log = tracked()
    gyro = log["gyro"]
    wanted = ThrustedBody(np.diag(machine().inertia)).at(gyro.time).rate_body
    value = float(np.abs(gyro.value - wanted).max() / np.abs(wanted).max())
    torque = np.abs(log["command_wheel_torque"].value).max()
    note = (
        f"Largest rate {np.abs(wanted).max():.3f} rad/s, largest wheel torque {torque:.2f} N m; "
        "the machine is as simple as the body, and the law knows it."
    )
    panels = (
        (gyro.time, square(gyro.time), "thrusters' torque [N m]"),
        (gyro.time, wanted, "rate of the body [rad/s]"),
        (gyro.time, gyro.value, "rate of the gyrostat [rad/s]"),
        (gyro.time, gyro.value - wanted, "difference [rad/s]"),
        (gyro.time, log["command_wheel_torque"].value, "motors' torque [N m]"),
        (gyro.time, log["wheel_speed"].value, "wheel speed [rad/s]"),
    )
    return Computed(
        {"002.fig4.tracking": Ours(value, note=note)},
        {"Fig. 3 and 4: the reference body, and wheels that track it": _fig4_figure(panels)},
    )


def _fig4_figure(panels: tuple[tuple[Array, Array, str], ...]) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 8.0))
        places = figure.subplots(3, 2, sharex=True).ravel()
        for panel, (time, values, label) in zip(places, panels, strict=True):
            for column, name, color in zip(values.T, "xyz", PALETTE, strict=False):
                panel.plot(time, column, color=color, label=name)
            panel.set_ylabel(label)
        places[0].legend(ncols=3)
        for panel in places[-2:]:
            panel.set_xlabel("time [s]")
        return svg(figure)


FIG4_PART = PaperPart(("002.fig4.tracking",), fig4_compute)


SHIFTS = np.linspace(-1.5, 1.5, 61)
"""[s], as far as the paper goes."""
TURNS = np.radians(np.linspace(-3.6, 3.6, 9))
"""[rad] about z: paper, from CAD."""
EDGE = 2.0
"""[s] left out at either end, where a shifted stream has nothing."""
FIG5_SEED = 6


def fig5_compute(say: Say) -> Computed:
    """61 shifts without noise and with it, 9 turns."""
    say("Fig. 5: shifts")
    log = ideal().without_truth()
    shifted_log = _estimates(log, SHIFTS, shifted)
    say("Fig. 6: shifts under noise")
    noisy = measured(log, NOISE, np.random.default_rng(FIG5_SEED))
    under_noise = _estimates(noisy, SHIFTS, shifted)
    say("Fig. 7: turns")
    turned_log = _estimates(log, TURNS, turned)
    places = [p for p in map(turn_nearest_sync, shifted_log.T) if p is not None]
    bent = np.array([bend(TURNS, column) for column in turned_log.T])
    change = np.ptp(turned_log, axis=0) / np.abs(entries_of(machine()))
    plain = change > 0.01
    large = f"{bent[plain].max():.3f}" if plain.any() else "none"
    figures = {
        "Fig. 5: effect of time synchronisation, perfect data": _fig5_figure(
            SHIFTS, shifted_log, "shift of the wheels' data [s]"
        ),
        "Fig. 6: effect of time synchronisation, with noise": _fig5_figure(
            SHIFTS, under_noise, "shift of the wheels' data [s]"
        ),
        "Fig. 7: effect of angular alignment, perfect data": _fig5_figure(
            np.degrees(TURNS), turned_log, "turn of the wheels [deg]"
        ),
    }
    return Computed(
        {
            "002.fig5.extremum": Ours(
                float(np.median(places)),
                note=f"Median of the {len(places)} parameters, of nine, that turn.",
            ),
            "002.fig7.linear": Ours(
                float(bent.max()),
                note=f"{NAMES[int(np.argmax(bent))]}, which changes by "
                f"{change[np.argmax(bent)]:.1%} in all, bends most. Of the parameters that change "
                f"by more than 1 % ({_those(plain)}) it is {large}.",
            ),
        },
        figures,
    )


def shifted(log: Recording, by: float) -> Recording:
    """With wheel speeds stamped so much later [s]."""
    wheels = log["wheel_speed"]
    late = replace(wheels, time=wheels.time + by)
    whole = replace(log, streams={**log.streams, "wheel_speed": late})
    return whole.between(EDGE, DURATION - EDGE)


def turned(log: Recording, by: float) -> Recording:
    """With the speeds of the wheels along x and y turned about z [rad]."""
    wheels = log["wheel_speed"]
    x, y, z = wheels.value.T
    cosine, sine = np.cos(by), np.sin(by)
    value = np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1)
    turned = Series(wheels.time, value, wheels.columns, wheels.unit)
    return replace(log, streams={**log.streams, "wheel_speed": turned})


def turn_nearest_sync(estimate: Array) -> float | None:
    """The shift [s] of the local extremum nearest to none, of estimates at `SHIFTS`."""
    slope = np.sign(np.diff(estimate))
    turns = SHIFTS[1:-1][slope[1:] * slope[:-1] < 0.0]
    return float(turns[np.argmin(np.abs(turns))]) if len(turns) else None


def bend(x: Array, y: Array) -> float:
    """Largest departure from the best line, in parts of the change."""
    line = np.polyval(np.polyfit(x, y, 1), x)
    return float(np.abs(y - line).max() / np.ptp(y))


def _estimates(
    log: Recording, values: Array, changed: Callable[[Recording, float], Recording]
) -> Array:
    """(m, 9) by the momentum integral of single shift."""
    method, settings = METHODS["momentum_1"]
    platform = machine()
    logs = (changed(log, float(value)) for value in values)
    return np.array([identify([item], platform, method, settings).theta[:9] for item in logs])


def _those(plain: NDArray[np.bool_]) -> str:
    return ", ".join(name for name, item in zip(NAMES, plain, strict=True) if item)


def _fig5_figure(x: Array, estimates: Array, label: str) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 7.0))
        truth = entries_of(machine())
        for panel, name, column, true in zip(
            figure.subplots(3, 3, sharex=True).ravel(), NAMES, estimates.T, truth, strict=True
        ):
            panel.axhline(true, color=SOFT, lw=0.8)
            panel.plot(x, column, color=PALETTE[0])
            panel.set_ylabel(f"{name} [{'kg m²' if name.startswith('J') else 'kg m'}]")
        figure.supxlabel(label, fontsize=10)
        return svg(figure)


FIG5_PART = PaperPart(("002.fig5.extremum", "002.fig7.linear"), fig5_compute)


GYRO, WHEELS = 10.0, 15.0
"""Nyquist frequency of what is averaged over the machine's natural frequency: paper."""
FIG9_SEED = 2


def fig9_compute(say: Say) -> Computed:
    """Average the gyro of `whorl1` as it is, and hold that against what it should have read."""
    say("Fig. 9: moving averages")
    platform = as_measured()
    (log,) = flown(
        platform, wheels(), start=hanging(platform.center_of_mass_offset), seed=FIG9_SEED
    )
    gyro = log["gyro"]
    noise = gyro.value - log["truth_rate"].interpolated_at(gyro.time)
    frequency = natural_frequency(platform)
    rate = platform.sensors["gyro"].rate
    width = samples(rate, GYRO * frequency)
    fewer = samples(rate, GYRO * 2.0 * np.pi * frequency)
    before, after, taken = (
        float(uniform_filter1d(noise, size, axis=0).std()) for size in (1, width, fewer)
    )
    note = (
        f"Its faster swing has {frequency:.3f} Hz, so {width} samples of 41 Hz are averaged. With "
        f"its rad/s taken for Hz {fewer} samples are, which leaves {taken / before:.2f}, as was "
        "published."
    )
    return Computed(
        {"002.fig9.moving_average": Ours(after / before, note=note)},
        {"Fig. 9: rate and wheel speeds, as read and smoothed": _fig9_figure(log, rate, frequency)},
    )


def as_measured() -> Platform:
    """Table 1's machine, its gyro and wheel speeds read as in the laboratory."""
    shipped = load_platform("whorl1:table1").sensors
    exact = machine()
    gyro = replace(shipped["gyro"], bias=np.zeros(3))
    sensors = {**exact.sensors, "gyro": gyro, "wheel_speed": shipped["wheel_speed"]}
    return replace(exact, sensors=sensors)


def natural_frequency(platform: Platform) -> float:
    """[Hz] of the faster of its two small swings about where it hangs."""
    moment = platform.center_of_mass_offset
    down = moment / np.linalg.norm(moment)
    stiffness = platform.gravity * np.linalg.norm(moment) * (np.eye(3) - np.outer(down, down))
    squares = np.linalg.eigvals(np.linalg.solve(platform.inertia, stiffness)).real
    return float(np.sqrt(squares.max()) / (2.0 * np.pi))


def samples(rate: float, nyquist: float) -> int:
    """To be averaged, for a Nyquist frequency of what is left [Hz]."""
    return max(round(rate / (2.0 * nyquist)), 1)


def _fig9_figure(log: Recording, rate: float, frequency: float) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 6.0))
        top, bottom = figure.subplots(2, 1, sharex=True)
        gyro = log["gyro"]
        width = samples(rate, GYRO * frequency)
        top.plot(gyro.time, gyro.value[:, 0], ".", ms=1.5, color=SOFT, label="as read")
        smooth = uniform_filter1d(gyro.value[:, 0], width)
        top.plot(gyro.time, smooth, color=PALETTE[1], label=f"mean of {width}")
        top.set_ylabel("rate about x [rad/s]")
        # the stairs are what the laboratory has at the gyro's rate
        stairs = log["wheel_speed"].held_at(gyro.time)
        width = samples(rate, WHEELS * frequency)
        for k, color in enumerate(PALETTE[:3]):
            bottom.step(gyro.time, stairs[:, k], color=SOFT, lw=0.8, where="post")
            smooth = uniform_filter1d(stairs[:, k], width)
            bottom.plot(gyro.time, smooth, color=color, label=f"wheel {k + 1}, mean of {width}")
        bottom.set(xlabel="time [s]", ylabel="wheel speed [rad/s]")
        for panel in (top, bottom):
            panel.legend(ncols=3, labelcolor=INK)
        return svg(figure)


FIG9_PART = PaperPart(("002.fig9.moving_average",), fig9_compute)


LAG = 0.17
"""[s]: paper, 7 points of 41 Hz."""
TURN = np.radians(3.6)
"""[rad] about z, of the wheels along x and y: paper, from CAD."""
LAG_AND_TURN_SEED = 9


def lag_and_turn_compute(say: Say) -> Computed:
    """Two logs, each diagnosed without being told what is in it."""
    turn = (0.0, 0.0, TURN)
    late = diagnosed([ClockLag(LAG, target="wheel_speed")], say)
    askew = diagnosed([WheelMisalignment(turn, target=name) for name in ("w1", "w2")], say)
    return Computed({"002.fig5.lag_found": _lag(late), "002.fig7.seen": _turn(askew)})


def diagnosed(effects: list[Effect], say: Say) -> Diagnosis:
    """Of a log of the machine with effects, held against the machine without."""
    stated = load_platform("whorl1:table1")
    (log,) = flown(
        with_effects(stated, effects),
        wheels(),
        start=hanging(stated.center_of_mass_offset),
        seed=LAG_AND_TURN_SEED,
    )
    return diagnose([log.without_truth()], stated, say=say)


def _lag(diagnosis: Diagnosis) -> Ours:
    named = _named(diagnosis)
    for cause in diagnosis.causes:
        if cause.effect.label == "clock_lag:wheel_speed":
            value, half = float(cause.effect.values[0]), float(cause.half_widths[0])
            return Ours(value, value - half, value + half, f"Found: {named}.")
    return Ours(np.nan, note=f"Found instead: {named}.")


def _turn(diagnosis: Diagnosis) -> Ours:
    named = _named(diagnosis)
    turns = [
        (cause.effect.target, np.degrees(cause.effect.values[2]), np.degrees(cause.half_widths[2]))
        for cause in diagnosis.causes
        if cause.effect.name == "wheel_misalignment"
    ]
    known = [half for *_, half in turns if np.isfinite(half)]
    if not known:
        return Ours(np.inf, note=f"Found instead: {named}.")
    shown = ", ".join(f"{name} {value:.2f} ({half:.2f}) deg" for name, value, half in turns)
    return Ours(
        float(max(known)),
        note=f"Found: {shown} about z, half intervals in brackets; nan: a turn about the wheel's "
        "own axis makes up for it, and that one was fitted.",
    )


def _named(diagnosis: Diagnosis) -> str:
    return (
        ", ".join(cause.effect.label for cause in diagnosis.causes)
        or f"nothing ({diagnosis.verdict})"
    )


LAG_AND_TURN_PART = PaperPart(("002.fig5.lag_found", "002.fig7.seen"), lag_and_turn_compute)
