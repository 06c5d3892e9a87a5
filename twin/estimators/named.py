"""Estimators by the names that a command line takes."""

from twin.errors import UnknownName
from twin.estimators.attitude_filter import AttitudeFilter
from twin.estimators.estimator import Estimator, Passthrough
from twin.estimators.inclinometer import InclinometerDifferences
from twin.estimators.offset_filter import OffsetFilter
from twin.estimators.vertical_offset import VerticalOffsetFilter
from twin.platform import Platform

ESTIMATORS: dict[str, type[Estimator]] = {
    "filter": AttitudeFilter,
    "inclinometer": InclinometerDifferences,
    "offset": OffsetFilter,
    "passthrough": Passthrough,
    "vertical_offset": VerticalOffsetFilter,
}


def load_estimator(name: str) -> Estimator:
    """An estimator of `ESTIMATORS`, with its settings as they are.

    Raises:
        UnknownName: there is none of that name.
    """
    if name not in ESTIMATORS:
        raise UnknownName("estimator", name, ESTIMATORS)
    return ESTIMATORS[name]()


def usual_estimator(platform: Platform) -> str:
    """The filter for a machine that has what it needs; its inclinometer where nothing else tells
    the attitude; else the sensors as they are."""
    if {"gyro", "attitude"} <= set(platform.sensors):
        return "filter"
    told = {"attitude", "joint_angle"} & set(platform.sensors)
    return "inclinometer" if "inclinometer" in platform.sensors and not told else "passthrough"
