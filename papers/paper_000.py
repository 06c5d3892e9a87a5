"""Paper 000, by J.-J. Kim and B. N. Agrawal: its tables and figures, computed anew.

Fig. 7: singular states of three gyros, and the skew whose sphere without any is the largest.

The sphere is as large as the smallest momentum of a singular state (`twin.budget`).

Fig. 8 and 9: adaptive balancing against direct compensation, with the faults the paper names.

Both on the machine that was balanced by hand, with gimbal friction, backlash, the gyros' own CM
offset (each at its usual size) and sensors as shipped. Direct: identify once by the paper's batch
method from the tracking run, move the masses by eq. 12. Adaptive: eq. 35 and 37.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from papers.efficiency import entries_of
from papers.flown import About, Flown, flown, perfect
from papers.rows import Computed, Ours, PaperPart, Say
from twin.budget import directions, singular_momenta, singularity_free_radius
from twin.controller import load_controller
from twin.effects import effects_of, parse_effects, with_effects
from twin.effects.actuators import GimbalFriction
from twin.identification import Identification, identify
from twin.plant.initial import InitialState, hanging
from twin.platform import Platform, load_platform
from twin.recording import Recording
from twin.reference import Multisine, Reference
from twin.report.style import FIGURE, PALETTE, SOFT, svg
from twin.rotation import cross, from_rotation_vector, rotate, tilt, vertical_body
from twin.signals import Target

Array = NDArray[np.float64]


PRINTED = np.array(
    [[61.7985, -2.4520, -15.2826], [-2.4520, 56.2741, -9.1634], [-15.2826, -9.1634, 215.1353]]
)
"""J of eq. 43 [kg m^2], in the paper's axes."""
PRINTED_MOMENT = np.array([-0.0058, 0.0302, 0.4008])
"""m r of eq. 43 [kg m], in the paper's axes."""
TURN = np.array([1.0, -1.0, -1.0])
"""Half a turn about x: from the paper's axes to ours."""
JZZ = 95.0
"""[kg m^2], ASSUMED in place of the printed one, which no rigid body has beside the others."""
MIDDLE = 1e-3
"""Noise of gyro and attitude of the grade `middle` [rad/s, rad]."""
AMPLITUDE, PACE = np.radians(3.0), 0.02
"""Of the tracking run [rad, Hz]."""
BENCH_LENGTH = 60.0
"""Of the tracking run [s]."""


def printed_machine() -> Platform:
    """`tas2` with J (but for Jzz) and m r of eq. 43, and sensors of the middle grade."""
    shipped = load_platform("tas2")
    inertia = PRINTED * np.outer(TURN, TURN)
    inertia[2, 2] = JZZ
    machine = replace(shipped, inertia=inertia, center_of_mass_offset=PRINTED_MOMENT * TURN)
    return with_noise(machine, MIDDLE)


def with_noise(machine: Platform, noise: float) -> Platform:
    """The machine with that noise on gyro [rad/s] and attitude [rad]."""
    sensors = dict(machine.sensors)
    for name in ("gyro", "attitude"):
        sensors[name] = replace(sensors[name], noise=np.full(3, noise))
    return replace(machine, sensors=sensors)


def tracked(machine: Platform, *, runs: Sequence[int] = (0,)) -> Flown:
    """Sines in roll, pitch and yaw by quaternion feedback and three gyros, about where m r hangs.

    About level the offset of eq. 43 would fill the array within a minute.
    """
    rest = hanging(machine.center_of_mass_offset)
    return flown(
        machine,
        load_controller("cmg_pd"),
        BENCH_LENGTH,
        start=InitialState(attitude=rest),
        reference=About(rest, Multisine(AMPLITUDE, PACE)),
        runs=runs,
        record=True,
    )


@dataclass(frozen=True)
class RollPitch(Reference):
    """Rates of a body that rolls and pitches, a quarter of a period apart, after a smooth start.

    The adaptive law follows a momentum and looks at no attitude; this one stays level.
    """

    angle: float = np.radians(10.0)
    """Of both [rad]. ASSUMED: the paper prints no amplitude; its bumper is at 20 deg."""
    pace: float = 0.3
    """[rad/s], that of the law's gains as shipped. ASSUMED."""
    ramp: float = 30.0
    """[s]."""

    def at(self, time: float | Array) -> Target:
        """Rate and acceleration; no step in either."""
        times = np.asarray(time, dtype=np.float64)
        turn, part = self.pace * times, 0.5 * np.pi * np.clip(times / self.ramp, 0.0, 1.0)
        size = np.sin(part)[..., None] ** 2
        growth = 0.5 * np.pi / self.ramp * np.sin(2.0 * part)[..., None]
        along = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)
        across = np.stack([-np.sin(turn), np.cos(turn), 0.0 * turn], axis=-1)
        peak = self.angle * self.pace
        level = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*turn.shape, 4))
        acceleration = peak * (growth * along + self.pace * size * across)
        return Target(level, peak * size * along, acceleration)


def side_by_side(time: Array, panels: Mapping[str, Array]) -> str:
    """SVG of one panel a label; values are (m, 3) at times (m,) [s]."""
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.4))
        drawn = figure.subplots(1, len(panels))
        for panel, (label, values) in zip(drawn, panels.items(), strict=True):
            for column, name in enumerate("xyz"):
                panel.plot(time, values[:, column], color=PALETTE[column], label=name)
            panel.set_xlabel("time [s]")
            panel.set_ylabel(label)
        drawn[-1].legend(ncols=3)
        return svg(figure)


ENTRIES = ("Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz", "m r_x", "m r_y", "m r_z")
EQ_43_RUNS = range(4)
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
    run = tracked(machine, runs=EQ_43_RUNS)
    held: list[NDArray[np.bool_]] = []
    half = np.zeros(len(ENTRIES))
    for number, log in enumerate(run.recordings):
        say(f"log {number + 1} of {len(EQ_43_RUNS)}")
        identification = identify([log], stated)
        held.append(np.abs(identification.theta[:9] - truth) <= identification.half_widths[:9])
        half = identification.half_widths[:9] if number == 0 else half
    widths = ", ".join(f"{n} {w:.2g}" for n, w in zip(ENTRIES, half, strict=True))
    missed = [name for name, inside in zip(ENTRIES, held[0], strict=True) if not inside]
    note = (
        f"By prediction error from one log of 60 s; half widths {widths}. "
        + (f"Not held: {', '.join(missed)}. " if missed else "")
        + f"Over {len(EQ_43_RUNS)} logs {np.mean(held):.0%} of the intervals hold the truth."
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
    listed = ", ".join(f"{cause} {error:+.2g}" for cause, error in errors.items())
    note = (
        f"The largest comes from {name}. Errors of Jzz [kg m^2], the worse of both filters: "
        f"{listed}."
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


EQ_43_PARTS = (
    PaperPart(("000.eq43.rigid_body",), rigid),
    PaperPart(("000.eq43.products_back",), products_back),
    PaperPart(("000.eq43.which_effect",), which_effect),
)


TILTED = InitialState(attitude=from_rotation_vector(np.array([0.1, 0.0, 0.0])))
"""Where the run without excitation starts: at level its masses would have nothing to do."""
STILL, MOVING = 150.0, 700.0
"""Without excitation, and with it [s]."""


def fig_3_compute(say: Say) -> Computed:
    """Two runs."""
    machine = perfect(load_platform("tas2"))
    law, kind = load_controller("adaptive_balancing"), "passthrough"
    say("without excitation")
    still = flown(machine, law, STILL, start=TILTED, estimator=kind)
    say("with excitation")
    moving = flown(machine, law, MOVING, reference=RollPitch(), estimator=kind)
    error, moment = np.linalg.norm(momentum_error(still), axis=1), offset(still)
    up = vertical_body(still.true["attitude"][:, 0])
    length = np.linalg.norm(moment, axis=1)
    angle = float(np.linalg.norm(cross(moment[-1], up[-1])) / length[-1])
    kept = float(length[-1] / length[0])
    with_it = np.linalg.norm(offset(moving), axis=1)
    last = moving.time > moving.time[-1] - 2.0 * np.pi / RollPitch().pace
    ratio = float(with_it[last].mean() / with_it[0])
    wrong = np.linalg.norm(momentum_error(moving, RollPitch())[last], axis=1).mean()
    whole = np.linalg.norm(RollPitch().at(MOVING).rate_body @ machine.inertia)
    rows = {
        "000.fig3.momentum_without_excitation": Ours(
            float(error[-1] / error.max()), note=f"After {STILL:g} s, from 0.1 rad of tilt."
        ),
        "000.fig3.offset_without_excitation": Ours(
            angle if kept > 0.1 else float("nan"),
            note=f"The CM keeps {100.0 * kept:.3g} % of its distance from the CR.",
        ),
        "000.fig3.offset_with_excitation": Ours(
            ratio,
            note=f"Mean of the last turn of {MOVING:g} s of rolling and pitching by 10 deg at "
            f"{RollPitch().pace:g} rad/s; reference and gains are ours. What is left goes with a "
            f"momentum error of {wrong:.2g} in {whole:.2g} N m s: drives and a loop of 20 Hz are "
            "late, and the law takes that for gravity.",
        ),
    }
    figures = {
        "Fig. 3, top: momentum error and m r without excitation": _drawn(still),
        "Fig. 3, bottom: the same with excitation": _drawn(moving, RollPitch()),
    }
    return Computed(rows, figures)


def momentum_error(run: Flown, reference: RollPitch | None = None) -> Array:
    """J (w - w_d) of the first run, (m, 3) [N m s]."""
    rate = run.true["rate"][:, 0]
    wanted = np.zeros_like(rate) if reference is None else reference.at(run.time).rate_body
    return (rate - wanted) @ run.platform.inertia


def offset(run: Flown) -> Array:
    """m r of the first run, (m, 3) [kg m]."""
    return run.true["center_of_mass_offset"][:, 0]


def _drawn(run: Flown, reference: RollPitch | None = None) -> str:
    panels = {
        "momentum error [N m s]": momentum_error(run, reference),
        "m r [g m]": 1e3 * offset(run),
    }
    return side_by_side(run.time, panels)


FIG_3_PART = PaperPart(
    (
        "000.fig3.momentum_without_excitation",
        "000.fig3.offset_without_excitation",
        "000.fig3.offset_with_excitation",
    ),
    fig_3_compute,
)


SKEWS = (60.0, 120.0)
"""[deg], between which the best is sought."""


def fig_7_compute(say: Say) -> Computed:
    """Closed form, refined numerically."""
    machine = load_platform("tas2")
    say("the best skew")
    skews = np.linspace(*SKEWS, 61)
    radii = np.array([singularity_free_radius(gimbal_axes(machine, skew)) for skew in skews])
    near = float(skews[np.argmax(radii)])
    best = minimize_scalar(
        lambda skew: -singularity_free_radius(gimbal_axes(machine, float(skew))),
        bounds=(near - 1.0, near + 1.0),
        method="bounded",
        options={"xatol": 1e-3},
    )
    skew, radius = float(best.x), singularity_free_radius(gimbal_axes(machine, 90.0))
    others = ", ".join(
        f"{singularity_free_radius(gimbal_axes(machine, other)):.3f} at {other:g}"
        for other in (70.0, 85.0, 95.0)
    )
    say("the surface")
    rows = {
        "000.fig7.best_skew": Ours(skew, note=f"A sphere of {-float(best.fun):.4f} gyros."),
        "000.fig7.sphere": Ours(radius, note=f"At 90 deg; {others} deg."),
    }
    axes = gimbal_axes(machine, 90.0)
    figures = {
        "Fig. 7: singular surface at a skew of 90 deg, in units of one gyro's momentum: the outer "
        "one, and the one that encloses the sphere": _surface(axes),
        "Radius of the sphere without singular states over the skew": _radii(skews, radii),
    }
    return Computed(rows, figures)


def gimbal_axes(machine: Platform, skew: float) -> Array:
    """(3, 3) g_i of the array at a skew [deg]: each turned about its rotor's axis at home."""
    turn = np.radians(skew - 90.0)
    spin = {rotor.gimbal: rotor.axis for rotor in machine.rotors}
    return np.array(
        [rotate(from_rotation_vector(turn * spin[g.name]), g.axis) for g in machine.gimbals]
    )


def _surface(axes: Array) -> str:
    polar, around = np.meshgrid(np.linspace(0.01, np.pi - 0.01, 24), np.linspace(0, 2 * np.pi, 48))
    along = directions(np.stack([polar.ravel(), around.ravel()], axis=1))
    result = singular_momenta(axes, along)
    inner = int(np.argmin(np.linalg.norm(result, axis=2).min(axis=0)))
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 4.6))
        for place, sign in enumerate((0, inner)):
            panel = figure.add_subplot(1, 2, place + 1, projection="3d")
            x, y, z = result[:, sign].T.reshape(3, *polar.shape)
            panel.plot_wireframe(x, y, z, color=PALETTE[place], lw=0.4)
            for name in "xyz":
                getattr(panel, f"set_{name}label")(f"h_{name}")
                getattr(panel, f"set_{name}lim")(-3.0, 3.0)
        return svg(figure)


def _radii(skews: Array, radii: Array) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.2))
        panel = figure.subplots()
        panel.plot(skews, radii, color=PALETTE[0])
        panel.axvline(90.0, color=SOFT, ls="--")
        panel.set_xlabel("skew [deg]")
        panel.set_ylabel("radius [H_CMG]")
        return svg(figure)


FIG_7_PART = PaperPart(("000.fig7.best_skew", "000.fig7.sphere"), fig_7_compute)


FAULTS = ("gimbal_friction", "gimbal_backlash", "gimbal_center_of_mass_offset")
METHOD = "integrated"
FIG_8_RUNS = range(4)
FIG_8_LENGTH = 600.0
"""Of the adaptive run [s]."""
SETTLED = 2.0 * np.pi / RollPitch().pace
"""One period of the excitation, over which the end is averaged [s]."""


def fig_8_compute(say: Say) -> Computed:
    """Four runs of each."""
    shipped = load_platform("tas2")
    machine = with_effects(shipped, parse_effects(",".join(FAULTS)))
    say("direct compensation")
    logs = tracked(machine, runs=FIG_8_RUNS)
    true = logs.true["center_of_mass_offset"].mean(axis=0)  # its masses stand at 0
    pairs = zip(logs.recordings, true, strict=True)
    ratio = np.array([_directly(shipped, log, moment) for log, moment in pairs])
    say("adaptive balancing")
    run = _adapting(machine, FIG_8_RUNS)
    end, adapted = _end(run)
    alone, sound = list[str](), 0.0
    for name in ("", *FAULTS):
        say(f"adaptive balancing with {name or 'no fault'} alone")
        item = parse_effects(name) if name else ()
        last, moment = _end(_adapting(with_effects(shipped, item), (0,)))
        torque = 1e3 * machine.gravity * moment.mean()
        alone.append(f"{torque:.3g} with {name.replace('_', ' ') or 'none of them'}")
        if not name:
            sound = 1e3 * float(last.true["stage_position"][..., 2].mean())
    first = np.linalg.norm(machine.center_of_mass_offset)
    torques = machine.gravity * np.array([adapted.mean(), ratio.mean(), first])
    stood = end.true["stage_position"].mean(axis=0)
    sides = np.abs(stood[:, :2]).max(axis=1)
    friction = next(e for e in effects_of(machine) if isinstance(e, GimbalFriction))
    short = friction.torque / friction.stiffness * shipped.rotors[0].momentum
    rows = {
        "000.fig8.adaptive_beats_direct": Ours(
            float(torques[0] / torques[1]),
            note=f"{1e3 * torques[0]:.3g} over {1e3 * torques[1]:.3g} mN m, from "
            f"{1e3 * torques[2]:.3g}: means of {len(FIG_8_RUNS)} runs, g abs(m r). The adaptive "
            f"law alone ends at {', '.join(alone)} [mN m]: what keeps the momentum from being "
            f"followed is taken for gravity. Friction of {friction.torque:g} N m makes a drive of "
            f"{friction.stiffness:g} N m s/rad without an integral fall short by {1e3 * short:.2g} "
            "mN m of the gyro's torque; a drive that holds its rate would not.",
        ),
        "000.fig9.vertical_mass_moves_most": Ours(
            float((np.abs(stood[:, 2]) / sides).mean()),
            note=f"{1e3 * stood[:, 2].mean():+.3g} mm, upwards positive, over "
            f"{1e3 * sides.mean():.3g} mm; {sound:+.3g} mm where no fault misleads the law.",
        ),
    }
    figures = {
        "Fig. 8: tilt during adaptive balancing": _tilt(run),
        "Fig. 9: momentum error and positions of the masses": _adapted(run),
    }
    return Computed(rows, figures)


def _adapting(machine: Platform, runs: Sequence[int]) -> Flown:
    law = load_controller("adaptive_balancing")
    return flown(machine, law, FIG_8_LENGTH, reference=RollPitch(), runs=runs)


def _end(run: Flown) -> tuple[Flown, Array]:
    """The last turn of the excitation, and abs(m r) of its mean, (n,) [kg m]."""
    end = run.between(run.time[-1] - SETTLED, np.inf)
    return end, np.linalg.norm(end.true["center_of_mass_offset"].mean(axis=0), axis=1)


def _directly(stated: Platform, log: Recording, true: Array) -> float:
    """abs(m r) that is left of the true one (3,) when the masses undo what the batch method says
    [kg m]."""
    identification = identify([log], stated, METHOD)
    slides = np.array([stage.mass * stage.axis for stage in stated.stages])
    moved = -np.linalg.solve(slides.T, identification.theta[6:9])
    travel = np.array([stage.travel for stage in stated.stages])
    moved = np.clip(moved, travel[:, 0], travel[:, 1])
    return float(np.linalg.norm(true + moved @ slides))


def _tilt(run: Flown) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.0))
        panel = figure.subplots()
        panel.plot(run.time, np.degrees(tilt(run.true["attitude"][:, 0])), color=PALETTE[0])
        panel.set_xlabel("time [s]")
        panel.set_ylabel("tilt [deg]")
        return svg(figure)


def _adapted(run: Flown) -> str:
    error = run.true["rate"][:, 0] - RollPitch().at(run.time).rate_body
    panels = {
        "momentum error [N m s]": error @ run.platform.inertia,
        "mass position [mm]": 1e3 * run.true["stage_position"][:, 0],
    }
    return side_by_side(run.time, panels)


FIG_8_PART = PaperPart(
    ("000.fig8.adaptive_beats_direct", "000.fig9.vertical_mass_moves_most"), fig_8_compute
)


PARTS: tuple[PaperPart, ...] = (FIG_3_PART, *EQ_43_PARTS, FIG_7_PART, FIG_8_PART)
