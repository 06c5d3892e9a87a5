"""Paper 003, on balancing by masses and magnetorquers: its tables and figures, computed anew.

The paper's tests: two laws from the same start, four times each, and its indexes of them.

The law is fed with what the IMU gives, as in the paper: no filter of ours stands between. The paper
stops after 300 s and calls its last values steady. With K_I = 2e-5 N m/s the masses settle at the
slow root K_I / (K_p + k), 1 / 139 s as the machine is shipped, so ours fly for LENGTH.

Fig. 6: the residual torque after rounds of the two-step procedure, on the shipped table.

A round: in the plane by the mixed law; then two free oscillations, the vertical mass 2 mm lower in
the second, from which J and m r are identified with their scale; then the vertical mass takes half
of what lies between the CM and the CR, never across it.

Tables 1 and 2: masses alone against masses and magnetorquers, from -0.5 and from +0.5 mm.

Fig. 3 to 5 show the first of those tests.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from papers.flown import Flown, flown, perfect
from papers.rows import Computed, Ours, PaperPart, Say
from twin.controller import AnyController, load_controller
from twin.effects import Effect, parse_effects, with_effects
from twin.identification import Identification, identify
from twin.plant.initial import InitialState, hanging
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.report.style import FIGURE, PALETTE, SOFT, svg
from twin.rotation import cross, from_rotation_vector, multiply, vertical_body

Array = NDArray[np.float64]


LENGTH, STEADY = 1200.0, 100.0
"""Of a run, and of its end that counts as steady [s]."""
PAPER_LENGTH = 300.0
"""Of a run of the paper [s]."""
FLOAT = 120.0
"""Of the free float after it [s]."""
RUNS = range(4)
"""As many tests as in the paper."""
BENCH_SEED = 3
SINGLE_MOTOR, ALL_MOTORS = 0.041, 0.123
"""m_b [kg], by section 2 and by section 3 of the paper."""
OFFSET = 0.5e-3
"""[m], of every mass at the start; Table 1 has it negative."""
CUTOFF = 1.0
"""Of the low-pass filter before the residual torque is read [Hz]."""
SHY = np.radians(1.0)
"""How far from its stop a table that would hang beyond it starts [rad]."""


def mechanical() -> AnyController:
    """The law of eq. 8: all three terms by masses. Of a small tilt the error quaternion of
    `mass_pid` is half, hence twice the gains."""
    gains = {"proportional": 2e-3, "integral": 4e-5, "derivative": 1.8e-3}
    return load_controller("mass_pid", gains)


def mixed() -> AnyController:
    """The law of eq. 5 and 7, with the gains of the tables."""
    return load_controller("mass_magnetic_pid")


def table(side: float, mass: float = ALL_MOTORS, effects: Sequence[Effect] = ()) -> Platform:
    """The shipped table, balanced in the plane, its masses `side` x 0.5 mm off.

    Args:
        side: -1 for Table 1, 1 for Table 2.
        mass: of a sliding mass [kg].
        effects: beyond those that platform.toml states.
    """
    plain = load_platform("cubesat")
    stages = tuple(replace(stage, mass=mass) for stage in plain.stages)
    height = np.array([0.0, 0.0, plain.center_of_mass_offset[2]])
    offset = height + side * OFFSET * mass * np.sum([stage.axis for stage in stages], axis=0)
    return with_effects(replace(plain, stages=stages, center_of_mass_offset=offset), effects)


@dataclass(frozen=True)
class Tests:
    """One law on one table, and the free float after it."""

    run: Flown

    @cached_property
    def after(self) -> Flown:
        """Afloat with the masses as they stand."""
        return afloat(self.run)

    @cached_property
    def steady(self) -> Flown:
        """The end of it."""
        return self.run.between(self.run.time[-1] - STEADY, np.inf)

    @property
    def in_plane(self) -> Array:
        """Rms of gravity's part in the plane as the IMU shows it, (n,)."""
        return in_plane(self.steady)

    @property
    def in_plane_as_in_paper(self) -> Array:
        """The same, but of the last third of the paper's 300 s."""
        return in_plane(self.run.between(PAPER_LENGTH - STEADY, PAPER_LENGTH))

    @property
    def mass_x(self) -> Array:
        """Steady position of the mass along x, from where it stood first, (m, n) [m]."""
        position = self.steady.true["stage_position"][..., 0]
        return position - position[0]

    @property
    def path(self) -> Array:
        """What both masses in the plane travel in the paper's 300 s, (n,) [m]."""
        position = self.run.between(0.0, PAPER_LENGTH).true["stage_position"]
        return np.abs(np.diff(position[..., :2], axis=0)).sum(axis=(0, 2))

    @property
    def torque(self) -> Array:
        """Residual torque of the free float, (n,) [N m]."""
        size = np.linalg.norm(momentum_change(self.after), axis=2)
        return np.percentile(size, 95.0, axis=0)


def in_plane(run: Flown) -> Array:
    """Rms of gravity's direction in the body's horizontal plane, as the law sees it, (n,)."""
    up = vertical_body(run.estimated["attitude"])
    return np.sqrt(np.mean(np.sum(np.square(up[..., :2]), axis=2), axis=0))


def fly_tests(platform: Platform, law: AnyController, length: float = LENGTH) -> Tests:
    """Four runs from where the table rests, or from before its stop where it would lie on it."""
    rest = hanging(platform.center_of_mass_offset, platform.stop_angle - SHY)
    start = InitialState(attitude=rest)
    kind = "passthrough"
    return Tests(
        flown(platform, law, length, start=start, estimator=kind, runs=RUNS, seed=BENCH_SEED)
    )


def afloat(run: Flown) -> Flown:
    """What comes after a run without any command."""
    law = load_controller("free_float")
    numbers = range(len(RUNS), len(RUNS) + run.true["rate"].shape[1])
    return flown(
        run.platform,
        law,
        FLOAT,
        start=run.end(),
        estimator="passthrough",
        runs=numbers,
        seed=BENCH_SEED,
    )


def momentum_change(run: Flown) -> Array:
    """J dw/dt + w x J w of the gyro below `CUTOFF`, without its mean, (m, n, 3) [N m].

    The ends, where filter and derivative lack a side, are left out.
    """
    tick = run.platform.tick
    measured = run.estimated["rate"] - run.estimated["rate"].mean(axis=0)
    filtered = butter(2, CUTOFF, fs=1.0 / tick, output="sos")
    rate = np.asarray(sosfiltfilt(filtered, measured[1:], axis=0))
    momentum = rate @ run.platform.inertia
    change = np.asarray(np.gradient(momentum, tick, axis=0)) + cross(rate, momentum)
    edge = round(1.0 / (CUTOFF * tick))
    return change[edge:-edge]


def ratio(above: Array, below: Array) -> tuple[float, float, float]:
    """Of two means over the tests, with the 95 % interval of their scatter."""
    value = float(np.mean(above) / np.mean(below))
    shares = [np.var(x, ddof=1) / len(x) / np.mean(x) ** 2 for x in (above, below)]
    half = 2.45 * float(np.sqrt(np.sum(shares)))  # Student's t of 2 x 3 degrees of freedom
    return value, value * max(1.0 - half, 0.0), value * (1.0 + half)


ROUNDS = 4
IN_PLANE = 600.0
"""Of the law, a round [s]: four of its slow root's times and more."""
KNOWN_MOVE = np.array([0.0, 0.0, -2e-3])
"""Of the stages between the two oscillations [m]."""
PUSH = from_rotation_vector(np.array([0.1, -0.07, 0.0]))
SPIN = np.array([5e-3, -5e-3, 0.2])
"""How a hand lets the table go: from where it hangs, turned and turning [rad/s]."""
FIG_6_SEED = 6
STATED = 4.3e-5
"""The paper's bound [N m]."""


def compute(say: Say) -> Computed:
    """Iterate, then float."""
    machine = load_platform("cubesat:offset_minus")
    stand = InitialState(attitude=hanging(machine.center_of_mass_offset))
    said: list[str] = []
    for number in range(ROUNDS):
        say(f"round {number + 1} of {ROUNDS}")
        run = flown(
            machine,
            mixed(),
            IN_PLANE,
            start=stand,
            estimator="passthrough",
            seed=FIG_6_SEED + number,
        )
        position = run.applied["command_stage_position"][-1, 0]
        identification = _identified(machine, position, FIG_6_SEED + 10 * number)
        below, unsure = _below(machine, identification, position)
        said.append(f"{-1e6 * below:.2f} +- {1e6 * unsure:.2f}")
        # half of what surely lies between CM and CR; the counters are set to zero there
        up = 0.5 * max(-(below + 1.5 * unsure), 0.0) / machine.stages[2].mass
        moment = _moment(machine, position + np.array([0.0, 0.0, up]))
        machine = replace(machine, center_of_mass_offset=moment)
        stand = InitialState(attitude=hanging(moment))
    say("afloat")
    last = flown(machine, mixed(), IN_PLANE, start=stand, estimator="passthrough", seed=FIG_6_SEED)
    free = afloat(last)
    size = np.linalg.norm(momentum_change(free), axis=2)[:, 0]
    worst = float(np.percentile(size, 95.0))
    whole = machine.gravity * float(np.linalg.norm(last.true["center_of_mass_offset"][-1, 0]))
    note = (
        f"95th percentile of the change of momentum over {FLOAT:g} s below 1 Hz, after {ROUNDS} "
        f"rounds that found m r_z at {', '.join(said)} mg m below the CR; most of it is the gyro's "
        f"noise. Turned on its side, the table would feel {1e6 * whole:.3g} uN m from gravity."
    )
    return Computed(
        {"003.fig6.torque": Ours(worst, note=note)},
        {"Fig. 6: residual torque of the free table after the rounds": _figure(size)},
    )


@dataclass(frozen=True)
class _Let:
    """A table let go with its masses at some position."""

    machine: Platform
    position: Array

    def log(self, seed: int) -> Recording:
        """What a laboratory would have of its free oscillation."""
        rest = hanging(_moment(self.machine, self.position), 0.5 * self.machine.stop_angle)
        start = InitialState(
            attitude=multiply(rest, PUSH), rate_body=SPIN, stage_position=self.position
        )
        law, kind = load_controller("free_float"), "passthrough"
        run = flown(self.machine, law, FLOAT, start=start, estimator=kind, seed=seed, record=True)
        return run.recordings[0]


def _identified(machine: Platform, position: Array, seed: int) -> Identification:
    both = (position, position + KNOWN_MOVE)
    logs = [_Let(machine, at).log(seed + i) for i, at in enumerate(both)]
    return identify(logs, load_platform("cubesat"))


def _below(
    machine: Platform, identification: Identification, position: Array
) -> tuple[float, float]:
    """m r_z with the masses at some position, and half its 95 % interval [kg m]."""
    moved = sum(s.mass * s.axis[2] * d for s, d in zip(machine.stages, position, strict=True))
    return float(identification.theta[8] + moved), float(identification.half_widths[8])


def _moment(machine: Platform, position: Array) -> Array:
    slides = np.array([stage.mass * stage.axis for stage in machine.stages])
    return machine.center_of_mass_offset + position @ slides


def _figure(size: Array) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.4))
        panel = figure.subplots()
        tick = FLOAT / len(size)
        panel.plot(tick * np.arange(len(size)), 1e5 * size, color=PALETTE[0], lw=0.7)
        panel.axhline(1e5 * STATED, color=SOFT, ls="--", label="4.3e-5 N m")
        panel.set_xlabel("time [s]")
        panel.set_ylabel("torque [1e-5 N m]")
        panel.legend()
        return svg(figure)


PART = PaperPart(("003.fig6.torque",), compute)


PLAY = 1e-5
"""Of the steppers as shipped [m]."""
DIPOLE = "residual_dipole=0.01/0/0"
"""Of the table itself: 6 uN m in the cage's field."""


def single_motor(say: Say) -> Computed:
    """Table 1 with the mass of section 2."""
    machine = table(-1.0, SINGLE_MOTOR)
    (value, low, high), alone, both = _readings_compared(machine, say)
    wide = _with_play(machine, PLAY * ALL_MOTORS / SINGLE_MOTOR)
    say(f"with a play of {1e6 * PLAY * ALL_MOTORS / SINGLE_MOTOR:.0f} um")
    (wider, *_), *_ = _readings_compared(wide, say)
    noise = float(np.linalg.norm(machine.sensors["attitude"].noise[:2]))
    note = (
        f"{both:.3g} over {alone:.3g}: with a third of the mass the same play moves the CM a third "
        f"as far, and both laws come to rest in the IMU's noise, {noise:.3g}. With three times the "
        f"play, {1e6 * PLAY * ALL_MOTORS / SINGLE_MOTOR:.0f} um, the ratio is {wider:.2f}: the "
        "play, which the paper does not print, decides."
    )
    return Computed({"003.mass.one_motor": Ours(value, low, high, note)})


def _readings_compared(
    machine: Platform, say: Say
) -> tuple[tuple[float, float, float], float, float]:
    """Ratio of the laws' in-plane rms with its interval, and both: masses alone, mixed."""
    say("masses alone")
    alone = fly_tests(machine, mechanical()).in_plane
    say("masses and magnetorquers")
    both = fly_tests(machine, mixed()).in_plane
    return ratio(both, alone), float(alone.mean()), float(both.mean())


def _with_play(machine: Platform, width: float) -> Platform:
    kept = tuple(effect for effect in machine.effects if effect.name != "stage_backlash")
    return with_effects(
        replace(machine, effects=kept), parse_effects(f"stage_backlash={width:.9g}")
    )


def field_reversed(say: Say) -> Computed:
    """Table 1 with the field downwards, on a table that is a weak magnet itself."""
    upright = table(-1.0, effects=parse_effects(DIPOLE))
    down = replace(upright, magnetic_field=-upright.magnetic_field)
    say("masses alone, field downwards")
    alone = fly_tests(down, mechanical())
    say("masses and magnetorquers, field downwards")
    both = fly_tests(down, mixed())
    say("masses and magnetorquers, field upwards")
    other = fly_tests(upright, mixed())
    value, low, high = ratio(both.in_plane, alone.in_plane)
    difference = (both.steady.true["stage_position"] - other.steady.true["stage_position"])[..., :2]
    hidden = 1e6 * float(np.linalg.norm(difference.mean(axis=(0, 1)))) / 2.0
    note = (
        f"{both.in_plane.mean():.3g} over {alone.in_plane.mean():.3g}. With a dipole of 0.01 A m^2 "
        f"on the table the masses end {hidden:.3g} um to either side as the field points up or "
        "down: balancing in one field hides it."
    )
    return Computed({"003.field.reversed": Ours(value, low, high, note)})


def datasheet_noise(say: Say) -> Computed:
    """The mechanical law with nothing but the gyro's own noise."""
    machine = table(-1.0)
    say("masses alone")
    run = fly_tests(_only_gyro_noise(machine), mechanical())
    spread = run.mass_x.std(axis=0)
    gain = 1.8e-3 / (machine.stages[0].mass * machine.gravity)
    noise = float(machine.sensors["gyro"].noise[0])
    note = (
        f"The derivative term turns {noise:.2g} rad/s into {1e6 * gain * noise:.2g} um, below the "
        "step of 2 um; the published spread needs "
        f"{2.6e-5 / gain:.2g} rad/s."
    )
    return Computed({"003.datasheet_noise": Ours(float(spread.mean()), note=note)})


def _only_gyro_noise(machine: Platform) -> Platform:
    plain = perfect(machine)
    gyro = replace(plain.sensors["gyro"], noise=machine.sensors["gyro"].noise)
    return replace(plain, sensors={**plain.sensors, "gyro": gyro})


READINGS_PARTS = (
    PaperPart(("003.mass.one_motor",), single_motor),
    PaperPart(("003.field.reversed",), field_reversed),
    PaperPart(("003.datasheet_noise",), datasheet_noise),
)


def first(say: Say) -> Computed:
    """Table 1 and Fig. 3 to 5."""
    alone, both = _flown(-1.0, say)
    dipole = np.abs(both.run.applied["command_dipole"])
    steps = np.ptp(both.mass_x, axis=0), np.ptp(alone.mass_x, axis=0)
    spread = both.mass_x.std(axis=0), alone.mass_x.std(axis=0)
    say("with twice the IMU's noise")
    noisy = _with_imu_noise(alone.run.platform, 2.0)
    twice = [fly_tests(noisy, law).in_plane for law in (mixed(), mechanical())]
    remark = (
        f" With twice that noise, which the paper does not print, it is {ratio(*twice)[0]:.2f}."
    )
    in_plane = _in_plane(alone, both)
    rows = {
        "003.table1.in_plane": replace(in_plane, note=in_plane.note + remark),
        "003.table1.peak_to_peak": _tables_compared(*steps, 1e6, "um"),
        "003.table1.deviation": _tables_compared(*spread, 1e6, "um"),
        "003.table1.torque": _torque(alone, both),
        "003.fig3.smoother": _tables_compared(both.path, alone.path, 1e3, "mm"),
        "003.fig5.dipole": Ours(
            float(dipole.max()), note="At the start; the coils are never at their limit."
        ),
    }
    figures = {
        "Fig. 3: positions of the masses, by masses alone (lines) and mixed (dashes)": _drawn(
            alone, both, lambda run: 1e3 * run.true["stage_position"][:, 0, :2], "[mm]", ("x", "y")
        ),
        "Fig. 4: gravity in the plane, by masses alone (lines) and mixed (dashes)": _drawn(
            alone, both, lambda run: -vertical_body(run.estimated["attitude"])[:, 0, :2], "[-]",
            ("x", "y"),
        ),
        "Fig. 5: dipole of the magnetorquers, mixed": _dipoles(both),
    }  # fmt: skip
    return Computed(rows, figures)


def second(say: Say) -> Computed:
    """Table 2."""
    alone, both = _flown(1.0, say)
    rows = {
        "003.table2.in_plane": _in_plane(alone, both),
        "003.table2.torque": _torque(alone, both),
    }
    return Computed(rows)


def _flown(side: float, say: Say) -> tuple[Tests, Tests]:
    machine = table(side, ALL_MOTORS)
    say("masses alone")
    alone = fly_tests(machine, mechanical())
    say("masses and magnetorquers")
    return alone, fly_tests(machine, mixed())


def _with_imu_noise(machine: Platform, factor: float) -> Platform:
    """The table with that many times the noise of its attitude."""
    sensor = machine.sensors["attitude"]
    sensor = replace(sensor, noise=factor * sensor.noise)
    return replace(machine, sensors={**machine.sensors, "attitude": sensor})


def _in_plane(alone: Tests, both: Tests) -> Ours:
    value, low, high = ratio(both.in_plane, alone.in_plane)
    early, *_ = ratio(both.in_plane_as_in_paper, alone.in_plane_as_in_paper)
    noise = float(np.linalg.norm(both.run.platform.sensors["attitude"].noise[:2]))
    note = (
        f"{both.in_plane.mean():.2g} over {alone.in_plane.mean():.2g}, the last 100 s of 1200 s: "
        "masses alone keep a limit cycle in their play, which the coils' damping takes away; the "
        f"IMU's noise is {noise:.2g}. After the paper's 300 s the ratio is {early:.2f}: "
        "the integral of both is still on its way."
    )
    return Ours(value, low, high, note)


def _torque(alone: Tests, both: Tests) -> Ours:
    value, low, high = ratio(both.torque, alone.torque)
    note = (
        f"{1e6 * both.torque.mean():.3g} over {1e6 * alone.torque.mean():.3g} uN m, of which "
        "the gyro's noise is the larger part."
    )
    return Ours(value, low, high, note)


def _tables_compared(both: Array, alone: Array, factor: float, unit: str) -> Ours:
    note = f"{factor * both.mean():.3g} over {factor * alone.mean():.3g} {unit}."
    return Ours(float(both.mean() / alone.mean()), note=note)


def _drawn(
    alone: Tests, both: Tests, what: Callable[[Flown], Array], unit: str, names: tuple[str, ...]
) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 4.8))
        panels = figure.subplots(len(names), 1, sharex=True)
        for column, (panel, name) in enumerate(zip(panels, names, strict=True)):
            for tests, style in ((alone, "-"), (both, "--")):
                run = tests.run.between(0.0, PAPER_LENGTH)
                panel.plot(run.time, what(run)[:, column], style, color=PALETTE[column], lw=0.9)
            panel.set_ylabel(f"{name} {unit}")
        panels[-1].set_xlabel("time [s]")
        return svg(figure)


def _dipoles(both: Tests) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.4))
        panel = figure.subplots()
        run: Flown = both.run.between(0.0, PAPER_LENGTH)
        for column, name in enumerate("xyz"):
            dipole = run.applied["command_dipole"][:, 0, column]
            panel.plot(run.time, dipole, color=PALETTE[column], lw=0.8, label=name)
        panel.set_xlabel("time [s]")
        panel.set_ylabel("dipole [A m²]")
        panel.legend(ncols=3)
        return svg(figure)


TABLES_PARTS = (
    PaperPart(
        (
            "003.table1.in_plane",
            "003.table1.peak_to_peak",
            "003.table1.deviation",
            "003.table1.torque",
            "003.fig3.smoother",
            "003.fig5.dipole",
        ),
        first,
    ),
    PaperPart(("003.table2.in_plane", "003.table2.torque"), second),
)


PARTS: tuple[PaperPart, ...] = (*TABLES_PARTS, *READINGS_PARTS, PART)
