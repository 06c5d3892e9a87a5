"""How the runs of a campaign start, from its specification."""

import math
from collections.abc import Sequence
from dataclasses import replace

from twin.campaigns.distribution import Distribution, Normal, Uniform
from twin.campaigns.read_values import read_values
from twin.campaigns.spec import Arm, Factor, Initial
from twin.config import Table
from twin.platform import Platform
from twin.procedures.setup import REACH

_XYZ = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")

_ALLOWED = {
    "attitude": "the tilt stop allows {} (angles are in radians)",
    "stage_position": "its travel is {}",
    "wheel_speed": "its speeds are {}",
}

Row = tuple[str, tuple[str, ...]]


def known_starts(platform: Platform) -> dict[str, Row]:
    """What can be given of a start on that platform: unit and components, by key."""
    rows: dict[str, Row] = {"center_of_mass_offset": ("kg m", _XYZ)}
    if platform.base.kind == "hinge":
        rows |= {"joint_angle": ("rad", ("",)), "joint_rate": ("rad/s", ("",))}
    else:
        rows |= {"attitude": ("rad", _ANGLES), "rate": ("rad/s", _XYZ)}
    if platform.base.travels:
        rows["velocity"] = ("m/s", _XYZ)
    if platform.wheels:
        rows["wheel_speed"] = ("rad/s", tuple(wheel.name for wheel in platform.wheels))
    if platform.stages:
        rows["stage_position"] = ("m", tuple(stage.name for stage in platform.stages))
    if platform.gimbals:
        rows["gimbal_angle"] = ("rad", tuple(gimbal.name for gimbal in platform.gimbals))
    return rows


def read_initial(table: Table, arms: Sequence[Arm]) -> Initial:
    """The table [initial]; at rest and level without.

    Raises:
        CampaignError: keys or values that no such machine can start from.
    """
    own = table.table("initial", required=False)
    platform = arms[0].platform
    rows = known_starts(platform)
    hangs = own.raw("hangs", False)
    if not isinstance(hangs, bool):
        raise own.fail("hangs", f"is {hangs!r}", "give true or false")
    if hangs and platform.base.kind != "ball":
        raise own.fail("hangs", f"is true, but {platform.name} hangs on no ball", "remove it")
    factors: dict[str, tuple[Factor, ...]] = {}
    reach = isinstance(own.raw("center_of_mass_offset"), str)
    for key, (unit, names) in rows.items():
        # asked of every key, so that one that is misspelt is told which it may have meant
        if own.raw(key) is None or (key == "center_of_mass_offset" and reach):
            continue
        spread = read_values(own, key, len(names), unit=unit)
        bounds = _bounds(platform, key, hangs=hangs)
        if bounds:
            spread = tuple(
                _held(own, key, name, one, ends, unit)
                for name, one, ends in zip(names, spread, bounds, strict=True)
            )
        factors[key] = tuple(
            Factor(f"initial.{key}" + (f".{name}" if name else ""), unit, one)
            for name, one in zip(names, spread, strict=True)
        )
    if reach:
        own.text("center_of_mass_offset", among=("within_reach",))
        if not platform.stages:
            raise own.fail(
                "center_of_mass_offset", "is what masses reach, of which there are none", "give m r"
            )
        factors["center_of_mass_offset"] = tuple(
            Factor(f"initial.reach.{stage.name}", "1", Uniform(-REACH, REACH))
            for stage in platform.stages
        )
    own.close()
    return Initial(factors, hangs, reach)


def _bounds(platform: Platform, key: str, *, hangs: bool) -> list[tuple[float, float]]:
    """Between what each component of a start must lie, as far as the machine limits it."""
    if key == "attitude" and platform.base.kind == "ball" and math.isfinite(platform.stop_angle):
        # what hangs at the stop may begin at the other side's
        most = min((2.0 if hangs else 1.0) * platform.stop_angle, math.pi)
        every = (-math.inf, math.inf)
        tilted = (-most, most)
        if platform.pitch_stop is not None:
            return [every, every, every]
        return [tilted, tilted, every]
    if key == "stage_position":
        return [stage.travel for stage in platform.stages]
    if key == "wheel_speed":
        return [(-wheel.speed_limit, wheel.speed_limit) for wheel in platform.wheels]
    return []


def _held(
    table: Table, key: str, name: str, one: Distribution, ends: tuple[float, float], unit: str
) -> Distribution:
    """The distribution, refused beyond the ends; a normal one is cut off there."""
    low, high = ends
    least, most = one.ends
    if isinstance(one, Normal):
        # what is cut off should be its tails
        least, most = one.mean - one.deviation, one.mean + one.deviation
    for value in (least, most):
        if not low <= value <= high:
            raise table.fail(
                key,
                f"goes to {value:.4g} {unit} in {name}",
                _ALLOWED[key].format(f"{low:.4g} to {high:.4g} {unit}"),
            )
    return replace(one, low=low, high=high) if isinstance(one, Normal) else one
