"""What the paper leaves open: which mass moves, which way the field points, and what noise does."""

from dataclasses import replace

import numpy as np

from twin.effects import parse_effects, with_effects
from twin.platform import Platform
from twin.reproduce.flown import perfect
from twin.reproduce.paper_003.bench import (
    ALL_MOTORS,
    ONE_MOTOR,
    fly_tests,
    mechanical,
    mixed,
    ratio,
    table,
)
from twin.reproduce.part import Computed, Ours, PaperPart, Say

PLAY = 1e-5
"""Of the steppers as shipped [m]."""
DIPOLE = "residual_dipole=0.01/0/0"
"""Of the table itself: 6 uN m in the cage's field."""


def one_motor(say: Say) -> Computed:
    """Table 1 with the mass of section 2."""
    machine = table(-1.0, ONE_MOTOR)
    (value, low, high), alone, both = _compared(machine, say)
    wide = _with_play(machine, PLAY * ALL_MOTORS / ONE_MOTOR)
    say(f"with a play of {1e6 * PLAY * ALL_MOTORS / ONE_MOTOR:.0f} um")
    (wider, *_), *_ = _compared(wide, say)
    noise = float(np.linalg.norm(machine.sensors["attitude"].noise[:2]))
    note = (
        f"{both:.3g} over {alone:.3g}: with a third of the mass the same play moves the CM a third "
        f"as far, and both laws come to rest in the IMU's noise, {noise:.3g}. With three times the "
        f"play, {1e6 * PLAY * ALL_MOTORS / ONE_MOTOR:.0f} um, the ratio is {wider:.2f}: the play, "
        "which the paper does not print, decides."
    )
    return Computed({"003.mass.one_motor": Ours(value, low, high, note)})


def _compared(machine: Platform, say: Say) -> tuple[tuple[float, float, float], float, float]:
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
    apart = (both.steady.true["stage_position"] - other.steady.true["stage_position"])[..., :2]
    hidden = 1e6 * float(np.linalg.norm(apart.mean(axis=(0, 1)))) / 2.0
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


PARTS = (
    PaperPart(("003.mass.one_motor",), one_motor),
    PaperPart(("003.field.reversed",), field_reversed),
    PaperPart(("003.datasheet_noise",), datasheet_noise),
)
