"""How the runs of a campaign start, from its specification."""

from collections.abc import Sequence

from twin.campaign.distribution import Uniform
from twin.campaign.read_values import read_values
from twin.campaign.spec import Arm, Factor, Initial
from twin.config import Table
from twin.platform import Platform
from twin.procedures.setup import REACH

_XYZ = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")

Row = tuple[str, tuple[str, ...]]


def known_starts(platform: Platform) -> dict[str, Row]:
    """What can be given of a start on that platform: unit and components, by key."""
    rows: dict[str, Row] = {"center_of_mass_offset": ("kg m", _XYZ)}
    if platform.base.kind == "hinge":
        rows |= {"joint_angle": ("rad", ("",)), "joint_rate": ("rad/s", ("",))}
    else:
        rows |= {"attitude": ("rad", _ANGLES), "rate": ("rad/s", _XYZ)}
    if platform.base.kind == "free" or platform.base.planar:
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
        if key not in own or (key == "center_of_mass_offset" and reach):
            continue
        spread = read_values(own, key, len(names), unit=unit)
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
