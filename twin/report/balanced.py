"""What a balancing leaves, in lines for a terminal."""

from twin.interval import Interval
from twin.platform import Platform
from twin.procedures import Statement
from twin.report.words import pair
from twin.units import fitting, printed, three_digits


def balanced(statement: Statement, platform: Platform, target: float) -> list[str]:
    """Residual offset and torque with 95 % intervals, and where the masses stand."""
    per_um = 1e6 / platform.mass
    offset = ", ".join(
        pair(axis.value * per_um, 0.5 * (axis.high - axis.low) * per_um)
        for axis in statement.center_of_mass_offset
    )
    whole, plane = statement.residual_torque, statement.residual_torque_in_plane
    verdict = "keeps" if whole.high <= target else "misses"
    stands = ", ".join(
        f"{stage.name} {position * 1e3:.4g} mm"
        for stage, position in zip(platform.stages, statement.stage_position, strict=True)
    )
    lines = [
        "left, with 95 % intervals:",
        f"  CM from CR ({offset}) um of {platform.mass:g} kg",
        f"  gravity torque at the worst attitude {_torque(whole)}, which {verdict} the target of "
        f"{printed(target, 'N m')}",
        f"  of the level body {_torque(plane)}",
        "  95 % of the torque observed in free float stay below "
        f"{printed(statement.residual_torque_observed, 'N m')}, drag and gyro noise included",
        f"  masses at {stands}",
    ]
    misfit = statement.misfit
    if not misfit.is_noise:
        lines.append(
            f"  The model misses more than noise of this (chi2 per sample "
            f"{misfit.chi2_per_sample:.3f}, a true one keeps {misfit.low:.3f} to "
            f"{misfit.high:.3f}): the intervals hold only if what it lacks is a random torque. "
            "`twin diagnose` names causes."
        )
    return lines


def _torque(interval: Interval) -> str:
    """Both ends: near zero the interval is not the same to either side."""
    scale, unit = fitting(interval.value, "N m")
    value, low, high = (
        three_digits(number / scale) for number in (interval.value, interval.low, interval.high)
    )
    return f"{value} {unit} ({low} to {high})"
